"""The named scenes, one file per field of science; each has its source in its docstring.

Nothing heavy is imported here, so that listing the scenes is quick.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import TYPE_CHECKING

from gsp.errors import GspError, nearest

if TYPE_CHECKING:
    from gsp.mechanics import FrictionSystem, LagrangianSystem
    from gsp.scenes.scene import Scene

_SCENES = {
    "chaplygin_sleigh": ("nonholonomic", "Chaplygin sleigh: no slip as the limit of strong friction"),
    "sleigh_from_lagrangian": ("sliding", "Sleigh from its Lagrangian: spinning turned into motion ahead"),
    "sled": ("sliding", "Sled: a blade with dry friction, which holds until it lets go"),
    "knife_edge": ("sliding", "Knife edge on an incline: a cycloid across the slope, and a creep down it"),
    "nonholonomic_particle": ("sliding", "Nonholonomic particle: z' = y x' and its catenary"),
    "rolling_disc": ("rolling", "Rolling disc: circles, and spirals when it slips"),
    "falling_disc": ("rolling", "Falling disc: a coin that rolls, leans and turns"),
    "rolling_ball": ("rolling", "Rolling ball: from slipping to rolling, an exact reduction"),
    "ball_on_turntable": ("rolling", "Ball on a turntable: circles at two sevenths of the table's rate"),
    "car": ("vehicles", "Car: parking by rocking and steering"),
    "michaelis_menten": ("chemistry", "Michaelis-Menten: an enzyme, its substrate and their complex"),
    "davis_skodje": ("chemistry", "Davis-Skodje: a slow manifold known exactly"),
    "lindemann": ("chemistry", "Lindemann: unimolecular decay through an activated molecule"),
    "koper": ("chemistry", "Koper: an electrochemical oscillator with two slow variables"),
    "van_der_pol": ("oscillators", "Van der Pol: a relaxation oscillator between its jumps"),
    "shishkova": ("passages", "Shishkova: stability that is lost late, and the buffer point"),
    "fitzhugh_nagumo": ("neuroscience", "FitzHugh-Nagumo: a neuron that recovers after its spike"),
    "linear": ("linear", "Linear: the smallest slow-fast system, solved exactly"),
}
# The scenes that are derived from a Lagrangian: each has a function NAME_with_friction beside it.
_MECHANICAL = (
    "sleigh_from_lagrangian",
    "knife_edge",
    "nonholonomic_particle",
    "rolling_disc",
    "falling_disc",
    "rolling_ball",
    "ball_on_turntable",
    "car",
)
# Lagrangian systems without a small parameter, so without a scene.
_FREE = {"falling_particle": "free_motion", "rotating_frame": "free_motion"}


def names() -> tuple[str, ...]:
    """Names that `load` takes, the home example first.

    >>> names()[:2]
    ('chaplygin_sleigh', 'sleigh_from_lagrangian')
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
    module, line = _entry(name)
    scene: Scene = getattr(importlib.import_module(f"gsp.models.{module}"), name)()
    return replace(scene, name=name, title=line)


def mechanical() -> tuple[str, ...]:
    """Names that `lagrangian_system` takes: those of `friction_system`, then the systems that move freely.

    >>> mechanical()[-2:]
    ('falling_particle', 'rotating_frame')
    """
    return (*_MECHANICAL, *_FREE)


def lagrangian_system(name: str) -> LagrangianSystem:
    """The `LagrangianSystem` called `name`, without constraints; raises `GspError` for an unknown name.

    >>> lagrangian_system("falling_particle").lagrangian
    -g*m*z + m*(xdot**2 + ydot**2 + zdot**2)/2
    """
    _check_name(name)
    if name in _FREE:
        return getattr(importlib.import_module(f"gsp.models.{_FREE[name]}"), name)()
    if name not in _MECHANICAL:
        raise GspError.none_of(
            mechanical(), name, f'there is no mechanical system "{name}".', "The systems are"
        )
    return friction_system(name).system


def friction_system(name: str) -> FrictionSystem:
    """The `FrictionSystem` behind the scene called `name`: its Lagrangian, constraints, frame and limit.

    Raises `GspError` for a name that belongs to no such scene.

    >>> friction_system("knife_edge").constraints
    (-xdot*sin(phi) + ydot*cos(phi),)
    """
    _check_name(name)
    if name not in _MECHANICAL:
        raise GspError.none_of(
            _MECHANICAL, name, f'there is no system with friction "{name}".', "The systems are"
        )
    module = importlib.import_module(f"gsp.models.{_SCENES[name][0]}")
    return getattr(module, f"{name}_with_friction")()


def _check_name(name: object) -> None:
    if not isinstance(name, str):
        raise GspError("a name is a text.", got=f"{name!r:.200}", value=name)


def _entry(name: str) -> tuple[str, str]:
    _check_name(name)
    if name not in _SCENES:
        is_path = str(name).endswith(".toml") or "/" in str(name)
        hint = " A model file is read by gsp.load(path)." if is_path else nearest(str(name), _SCENES)
        raise GspError(f'there is no scene "{name}".', f"The scenes are {', '.join(_SCENES)}.{hint}")
    return _SCENES[name]
