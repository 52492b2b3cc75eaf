"""The named scenes, one file per field of science; each has its source in its docstring.

Nothing heavy is imported here, so that listing the scenes is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from gsp.errors import GspError, nearest

if TYPE_CHECKING:
    from gsp.scene import Scene

_SCENES = {
    "chaplygin_sleigh": ("nonholonomic", "Chaplygin sleigh: no slip as the limit of strong friction"),
    "michaelis_menten": ("chemistry", "Michaelis-Menten: an enzyme, its substrate and their complex"),
    "davis_skodje": ("chemistry", "Davis-Skodje: a slow manifold known exactly"),
    "lindemann": ("chemistry", "Lindemann: unimolecular decay through an activated molecule"),
    "koper": ("chemistry", "Koper: an electrochemical oscillator with two slow variables"),
    "van_der_pol": ("oscillators", "Van der Pol: a relaxation oscillator between its jumps"),
    "fitzhugh_nagumo": ("neuroscience", "FitzHugh-Nagumo: a neuron that recovers after its spike"),
    "linear": ("linear", "Linear: the smallest slow-fast system, solved exactly"),
}


def names() -> tuple[str, ...]:
    """Names that `load` takes, the home example first.

    >>> names()[:2]
    ('chaplygin_sleigh', 'michaelis_menten')
    """
    return tuple(_SCENES)


def title(name: str) -> str:
    """One line on the scene called `name`; raises `GspError` for an unknown name."""
    return _entry(name)[1]


def summary() -> tuple[tuple[str, str], ...]:
    """Pairs (name, title) of all scenes, without loading any."""
    return tuple((name, line) for name, (_, line) in _SCENES.items())


def load(name: str) -> Scene:
    """The scene called `name`; raises `GspError` with the nearest name for an unknown one.

    >>> load("linear")
    Scene(linear: SlowFastSystem in y, x; epsilon=0.05, span=(0.0, 3.0), tolerance=1e-06)
    """
    module = importlib.import_module(f"gsp.models.{_entry(name)[0]}")
    return getattr(module, name)()


def _entry(name: str) -> tuple[str, str]:
    if name not in _SCENES:
        raise GspError(
            f'there is no scene "{name}". The scenes are {", ".join(_SCENES)}.' + nearest(str(name), _SCENES)
        )
    return _SCENES[name]
