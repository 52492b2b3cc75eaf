"""XPPAUT run on a text without its windows: what it prints of the equations, and the values it writes."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest


def run(text: str) -> tuple[np.ndarray, str]:
    """Rows of (t, states, aux quantities) in single precision, and what was printed; skips where XPPAUT is missing."""
    if shutil.which("xppaut") is None:
        pytest.skip("xppaut is not installed")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "model.ode").write_text(text, encoding="utf-8")
        done = subprocess.run(
            ["xppaut", "model.ode", "-silent"],
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=60,
        )
        written = Path(folder, "output.dat")
        printed = done.stdout + done.stderr
        assert written.is_file(), printed
        assert "ERROR" not in printed, printed
        return np.loadtxt(written, ndmin=2), printed


def values(text: str, expressions: list[str], sizes: list[float]) -> list[float]:
    """Expressions at the start of a file, to 14 digits of `sizes`: in two parts, as XPPAUT writes eight digits."""
    lines = []
    scales = [2.0 ** (22 - math.frexp(size or 1.0)[1]) for size in sizes]
    for i, (expression, scale) in enumerate(zip(expressions, scales)):
        lines += [f"qx{i}={scale!r}*({expression})", f"aux qw{i}=flr(qx{i})", f"aux qr{i}=qx{i}-flr(qx{i})"]
    body = re.sub(r"(?m)^(@.*|done|d)\s*$", "", text)
    rows, _ = run("\n".join([body, *lines, "@ meth=euler, dt=1e-6, total=1e-6", "done", ""]))
    parts = rows[0, -2 * len(expressions) :].reshape(-1, 2)
    return [(whole + rest) / scale for (whole, rest), scale in zip(parts.tolist(), scales)]
