"""Which sheet a start belongs to, told where that is not plain."""

import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.scenes.scene import Scene
from gsp.scenes.sheet import explain_sheet
from gsp.scenes.study import Study
from gsp.systems.system import SlowFastSystem

x, y, epsilon = sp.symbols("x y epsilon")
# A laser: dark, or with y (y - 2) = x - 3, whose fold is at (2, 1). The start is before it and above all sheets.
LASER = y * (x - 3 - y * (y - 2))
# Over |x| < 1 the only sheet is below y = -2, outside the bounds.
BELOW = x**2 - 1 - y**2 * (2 + y)


def study(rate: sp.Expr, start: dict, region: dict) -> Study:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: rate}, epsilon=epsilon)
    return Study(Scene(system=system, region=region, start=start, span=(0.0, 1.0), epsilon=0.01))


def said(found: Study) -> str:
    return "; ".join(explain_sheet(found.critical, found.branch, found.start, found.region))


@pytest.mark.parametrize(
    ("rate", "start", "bounds", "parts"),
    [
        (LASER, {"x": 1.5, "y": 4.0}, (0.0, 5.0), ["of 3 branches this is about y = 0"]),
        (
            LASER,
            {"x": 1.5, "y": 4.0},
            (0.5, 5.0),
            ["over x = 1.5 the one", "is at y = 0, outside y in [0.5, 5]"],
        ),
        (BELOW, {"x": 0.0, "y": 0.5}, (-1.5, 3.0), ["the start is over no sheet", "y = -2.20557, outside"]),
        (x - y, {"x": 0.0, "y": 0.5}, (-1.5, 3.0), []),
    ],
    ids=["above all sheets", "out of bounds", "implicit", "plain"],
)
def test_which_sheet_is_meant_is_said_where_it_is_not_plain(rate, start, bounds, parts) -> None:
    text = said(study(rate, start, {"x": (-3, 6), "y": bounds}))
    assert bool(text) == bool(parts)
    for part in parts:
        assert part in text


@pytest.mark.parametrize(
    ("rate", "start"),
    [(sp.Min(x - y, sp.Rational(1, 2)), {"x": 1, "y": -2}), (x - y**3 + 3 * y, {"x": 0, "y": 0.99})],
)
def test_newtons_method_from_the_start_has_no_say_in_which_sheet_its_run_belongs_to(rate, start) -> None:
    """From the flat of a minimum it came to no point, which ended `gsp check`; from beside a fold to another sheet."""
    assert said(study(rate, start, {"x": (-0.5, 1.5), "y": (-3 if rate.has(sp.Min) else 0.5, 3)})) == ""


def test_a_branch_outside_the_region_is_refused_with_the_others() -> None:
    found = study(LASER, {"x": 1.5, "y": 4.0}, {"x": (-3, 6), "y": (0.5, 5.0)})
    with pytest.raises(
        BranchError, match=r"y = 0 has no real point .*Other branches are y = .*, y = .*start near another"
    ):
        classify(found.branch, region=found.region)


def test_a_start_over_no_sheet_is_told_one_remedy() -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y**2}, epsilon=epsilon)
    with pytest.raises(BranchError) as refused:
        solve_critical(system).nearest({"x": -0.5, "y": 1.0})
    text = str(refused.value)
    assert text.count("Move") == 1
    assert text.endswith("Move the start's slow variables to where one is.")
    assert "1 of 1" not in text
