"""Tasks that other processes import."""

from __future__ import annotations

import math
import os
import signal
import time
from pathlib import Path


def wave(x: float, k: float) -> dict[str, object]:
    """Two numbers and an array; nothing where x is negative."""
    if x < 0.0:
        raise ValueError(f"the root of {x} is not real")
    return {"root": math.sqrt(x), "powers": [x, x * k, x * k * k]}


def slow_wave(x: float, k: float) -> dict[str, object]:
    """The same, later."""
    time.sleep(0.002)
    return wave(x, k)


def counted(x: float, log: str) -> dict[str, float]:
    """x, with a line in a file for each call."""
    with open(log, "a", encoding="utf-8") as file:
        file.write(f"{x!r}\n")
    return {"value": x}


def deadly(x: float, home: int) -> dict[str, float]:
    """Takes its process with it at x = 3, unless it is the process `home`."""
    if x == 3.0 and os.getpid() != home:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"value": 2.0 * x}


def hanging(x: float, begun: str) -> dict[str, float]:
    """Never ends at x = 1, and says so; at x = 0 it does."""
    while x == 1.0:
        Path(begun).touch()
        time.sleep(1.0)
    return {"value": x}


def long_record(x: float) -> dict[str, object]:
    """More bytes than a short file holds, hardly to be compressed."""
    return {"values": [math.sin(x + k * k) for k in range(500)]}


def of_scene(scene) -> dict[str, float]:
    """What the scene was asked."""
    return {
        "asked": scene.epsilon,
        "wanted": scene.tolerance,
        "parameter": float(next(iter(scene.system.parameters.values()))),
        "begun": next(iter(scene.start.values())),
    }


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a sweep by its path."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def named(x: float) -> dict[str, float]:
    """A number under the name of an axis."""
    return {"x": 2.0 * x}
