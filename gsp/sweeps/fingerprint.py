"""What the results of a sweep depend on besides its axes, by parts."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

from gsp.sweeps.tasks import source_of

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


PACKAGES = ("gsp-toolkit", "numpy", "scipy", "sympy", "numba")


def fingerprint_of(task: str, options: Mapping[str, object], scene: Scene | None) -> dict[str, str]:
    """By parts, what results depend on besides the axes."""
    found = {package: _version(package) for package in PACKAGES}
    found["task"] = source_of(task)
    found["options"] = json.dumps(options, sort_keys=True)
    if scene is not None:
        import sympy as sp

        flow = scene.full_flow
        parts = {
            "equations": {str(k): sp.srepr(v) for k, v in flow.equations.items()},
            "parameters": {str(k): sp.srepr(v) for k, v in flow.parameters.items()},
            "region": dict(scene.region),
            "start": dict(scene.full_start),
            "span": scene.span,
            "epsilon": scene.epsilon,
            "tolerance": scene.tolerance,
        }
        found |= {
            part: hashlib.sha256(json.dumps(value, default=str).encode()).hexdigest()
            for part, value in parts.items()
        }
    return found


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        import gsp

        return gsp.__version__
