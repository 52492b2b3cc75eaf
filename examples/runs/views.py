"""
Views that a model names
========================

A scene says which quantities its readers should see against which. The report and the demo show these views, and so
does `gsp.charts.view`.
"""

from dataclasses import replace

import gsp
from gsp.scenes.view import View

scene = gsp.models.load("michaelis_menten")
scene = replace(
    scene,
    views={
        "course": View("t", "s", title="The substrate is used up", ranges={"t": (0, 4)}),
        "layer": View("s", "c", title="The complex rises first, and then follows the substrate"),
    },
    units={"s": "mM", "c": "mM", "t": "s"},
)

# %%
# The units stand on the axes of both.
analysis = gsp.analyse(scene)
axes = gsp.charts.view(analysis, "course")
assert axes.get_xlim() == (0, 4)
assert "mM" in axes.get_ylabel()

# %%
# The second view.
axes = gsp.charts.view(analysis, "layer")
assert "mM" in axes.get_xlabel()
