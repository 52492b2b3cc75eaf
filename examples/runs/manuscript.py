"""
A manuscript of a model
=======================

`write_report` with `latex=True` writes the report as LaTeX too, with its figures as PDF and what it cites. Here a
receptor binds its ligand fast.
"""

import json
import tempfile
from pathlib import Path

import sympy as sp

import gsp

L, C, k_in, k_out, K_D, epsilon = sp.symbols("L C k_in k_out K_D epsilon")
system = gsp.SlowFastSystem(
    slow={L: k_in - k_out * (L - C)},
    fast={C: (L - C) * (1 - C) - K_D * C},
    epsilon=epsilon,
    parameters={k_in: sp.Rational(1, 5), k_out: sp.Rational(3, 10), K_D: sp.Rational(1, 2)},
)
scene = gsp.Scene(
    system,
    name="receptor",
    title="A receptor that binds its ligand fast",
    region={"L": (0.1, 2.0), "C": (0.0, 1.0)},
    start={"L": 0.2, "C": 0.0},
    span=(0, 5),
    epsilon=0.02,
)
analysis = gsp.analyse(scene, order=1)
folder = Path(tempfile.mkdtemp(), "receptor")
gsp.write_report(analysis, folder, latex=True)
text = (folder / "report.tex").read_text(encoding="utf-8")
print(text[text.index(r"\section{The reduced equations}") : text.index(r"\section{Methods}")])

# %%
# All its numbers are in report.json, which lists the files of the manuscript. `latexmk -pdf report.tex` compiles them.
content = json.loads((folder / "report.json").read_text(encoding="utf-8"))
print(*content["manuscript"], sep="\n")
slope = content["comparison"]["variables"]["slope"]["values"][1]
assert abs(slope - 2) < 0.1
assert f"& {slope:.2f}" in text

# %%
# One of its figures.
axes = gsp.charts.error_against_epsilon(analysis.comparison)
