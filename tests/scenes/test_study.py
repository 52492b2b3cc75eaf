"""A study: a scene in standard form, each stage computed once and kept, through every verb and a whole report."""

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
import gsp.cli
from gsp import models
from gsp.algebra.power_series import SeriesProgram
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError, SplittingError
from gsp.fibres.base_points import base_point_of
from gsp.fibres.inner_expansion import expand_inner
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.integration.restriction import restrict
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.expansion import Expansion
from gsp.splitting.splitting import split
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, eps = sp.symbols("x y z epsilon")


def scene(field, **changes) -> Scene:
    values = {
        "region": {"x": (-1, 1), "y": (-2, 2)},
        "start": {"x": 0.5, "y": 0.5},
        "span": (0, 1),
        "epsilon": 0.01,
        "epsilons": (0.02, 0.01),
        "tolerance": 1e-6,
    }
    return Scene(field, **{**values, **changes})


def test_the_sleigh_is_placed_in_its_slow_momentum() -> None:
    home = models.load("chaplygin_sleigh")
    study = study_of(home)
    omega, w = home.start["omega"], home.start["w"]
    assert study.start["p"] == pytest.approx(1.04 * omega + 0.2 * w)
    # p = J omega + m a w is linear, so the hull of the box is attained at its corners.
    low, high = study.region["p"]
    assert (low, high) == pytest.approx((-1.04 * 2 - 0.2, 1.04 * 2 + 0.2))
    assert study.region["w"] == (-1.0, 1.0)


@pytest.mark.exhaustive
def test_places_that_no_state_has_are_not_counted() -> None:
    # Around the image of (S, I, R) under (I + R + S, S exp(3 R)) a box has places without a state, and there the fast
    # equation has no root. On I = 0 the eigenvalue is 3 S - 1, of which S = 0.2 is the largest.
    S, I, R = sp.symbols("S I R")  # noqa: E741
    field = VectorField(
        {S: -3 * S * I / eps - S, I: 3 * S * I / eps - I / eps, R: I / eps + S}, epsilon=eps, name="vaccination"
    )
    region = {"S": (0.02, 0.2), "I": (0, 0.3), "R": (0.05, 0.6)}
    study = study_of(scene(field, region=region, start={"S": 0.15, "I": 0.1, "R": 0.1}, epsilon=0.001))
    assert any(e.has(sp.exp) for e in study.system.g)
    assert repr(study.region) == f"ImageBox({dict(study.region)})"
    found = study.hyperbolicity
    assert found.kind == "attracting"
    assert all(condition.holds for condition in found.conditions)
    assert found.gap == pytest.approx(0.4, rel=1e-3)
    # What is lost where no state is refutes nothing.
    assert found.with_proof(most_boxes=16).kind == "attracting"
    # With S up to 0.5 the fold S = 1/3 is among the states.
    assert (
        study_of(scene(field, region={**region, "S": (0.02, 0.5)}, start=study.scene.start)).hyperbolicity.kind
        == "lost"
    )


def test_a_standard_system_keeps_its_names_and_numbers() -> None:
    home = models.load("michaelis_menten")
    study = study_of(home)
    assert study.splitting is None
    assert study.start == home.start
    assert study.region == home.region


def test_the_sheet_is_the_one_nearest_to_the_start() -> None:
    left = replace(models.load("van_der_pol"), start={"x": 2.0, "y": 0.5})
    assert study_of(left).branch.points({"y": 0.5})[0] > 1


def test_a_nonlinear_slow_coordinate_gets_the_hull_of_sampled_points() -> None:
    field = VectorField({x: (y - x**2) / eps, y: x * (y - x**2) / eps + 1}, epsilon=eps)
    study = study_of(scene(field, region={"x": (0.5, 1), "y": (-2, 2)}, start={"x": 0.7, "y": 0.5}))
    assert study.region["p"] == pytest.approx((0.25 - 4, 1 + 4))


def test_a_raw_state_without_an_interval_is_named() -> None:
    field = VectorField({x: (y - x) / eps, y: (x - y) / eps - y}, epsilon=eps)
    with pytest.raises(DeclarationError, match=r"no interval for x.*p = x \+ y"):
        _ = study_of(scene(field, region={"y": (-2, 2)})).region


def test_a_field_that_stays_non_standard_is_refused_with_its_leading_order() -> None:
    fast = x - y
    field = VectorField(
        {x: (y + x**2 + sp.sin(x * y) + 5) * fast / eps, y: (x**3 + sp.cos(y) + 9) * fast / eps + 1},
        epsilon=eps,
    )
    with pytest.raises(SplittingError, match="no standard form"):
        _ = study_of(scene(field)).system


def test_a_branch_that_has_vanished_is_refused() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: y**2 + x**2 + 1}, epsilon=eps)
    with pytest.raises(BranchError, match="no real"):
        _ = study_of(scene(system)).branch


def _everywhere(monkeypatch: pytest.MonkeyPatch, function: Callable, counted: Callable) -> None:
    """Put `counted` in place of `function` in every module of the package that imported it."""
    for name, module in list(sys.modules.items()):
        # A singular orbit restricts to the sheets that it lands on, whoever has a flow over one of them.
        if name.startswith("gsp.") and name != "gsp.singular.slow_pieces" and isinstance(module, ModuleType):
            for attribute, value in list(vars(module).items()):
                if value is function:
                    monkeypatch.setattr(module, attribute, counted)


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter:
    """How often each stage was computed, by its name and by what it was computed of."""
    found: Counter = Counter()
    keys: dict[Callable, Callable] = {
        split: lambda field, **_: (),
        solve_critical: lambda system, **_: (),
        classify: lambda branch, region, **_: (branch, tuple(sorted(region.items()))),
        restrict: lambda series, order=None, reconstruction=None: (
            series.branch,
            series.order if order is None else order,
            bool(reconstruction),
        ),
        expand_inner: lambda branch, start, order, **_: (branch, tuple(sorted(start.items())), order),
        base_point_of: lambda inner, epsilon, order: (epsilon, order),
    }
    _ = gsp.analyse, gsp.simulate, gsp.write_report
    for stage, key in keys.items():

        def counted(*args, _stage=stage, _key=key, **kwargs):
            found[_stage.__name__, *_key(*args, **kwargs)] += 1
            return _stage(*args, **kwargs)

        _everywhere(monkeypatch, stage, counted)
    own = Expansion._next

    def step(expansion: Expansion) -> None:
        branch = replace(expansion.branch, seed=None)
        found["expansion", branch, expansion.symbolic, (expansion._known or 0) + 1] += 1
        own(expansion)

    monkeypatch.setattr(Expansion, "_next", step)
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["chaplygin_sleigh", "van_der_pol"])
def test_a_whole_report_computes_every_stage_once(name: str, counts: Counter, tmp_path) -> None:
    result = CliRunner().invoke(gsp.cli.cli, ["report", name, "-o", str(tmp_path), "--order", "2"])
    assert result.exit_code == 0, result.output
    stages = {key[0] for key in counts}
    assert {"solve_critical", "classify", "restrict", "expand_inner", "expansion", "base_point_of"} <= stages
    assert ("split" in stages) == (name == "chaplygin_sleigh")
    assert not {key: n for key, n in counts.items() if n > 1}


@pytest.mark.exhaustive
def test_verbs_take_a_study_and_hand_it_on(counts: Counter) -> None:
    whole = gsp.study(models.load("michaelis_menten"))
    found = gsp.compare(whole, orders=(0, 1))
    choice = gsp.choose(whole, orders=(0, 1), tolerance=1e-3)
    assert gsp.simulate(whole, choice=choice).choice is choice
    assert found.scene is whole.scene
    assert choice.tolerance == 1e-3
    assert not {key: n for key, n in counts.items() if n > 1}
    assert counts["solve_critical",] == 1


def test_the_series_grows_by_the_orders_that_it_lacks(counts: Counter) -> None:
    whole = gsp.study(models.load("michaelis_menten"))
    orders = [whole.series(order).order for order in (1, 4, 2)]
    assert orders == [1, 4, 2]
    assert whole.series(4).coefficients == gsp.expand(whole.branch, order=4).coefficients
    steps = [key[3] for key, n in counts.items() if key[0] == "expansion" and key[2] for _ in range(n)]
    # Four of the study's, and four of the comparison's own.
    assert sorted(steps) == sorted([1, 2, 3, 4] * 2)


def test_an_interrupted_expansion_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = gsp.study(models.load("michaelis_menten"))
    known = whole.series(1).coefficients
    own = SeriesProgram.extend
    calls = iter([False, True])

    def interrupted(self, k: int) -> None:
        if next(calls):
            raise KeyboardInterrupt
        own(self, k)

    with monkeypatch.context() as patched:
        patched.setattr(SeriesProgram, "extend", interrupted)
        with pytest.raises(KeyboardInterrupt):
            whole.series(2)
    expected = gsp.expand(whole.branch, order=2)
    assert whole.series(2).coefficients == expected.coefficients
    assert whole.series(2).reduced_field == expected.reduced_field
    assert whole.series(1).coefficients == known


def test_another_epsilon_shares_what_does_not_depend_on_it() -> None:
    whole = gsp.study(models.load("michaelis_menten"))
    other = whole.asking(epsilon=0.5 * whole.scene.epsilon)
    assert other.branch is whole.branch
    assert other.series(2) is whole.series(2)
    assert other.base_point(1)["s"] != whole.base_point(1)["s"]
    assert whole.base_point(1) is whole.base_point(1)
    assert whole.full(0.1) is other.full(0.1)


def test_a_study_tells_what_it_knows() -> None:
    whole = gsp.study(models.load("michaelis_menten"))
    assert repr(whole) == "Study(michaelis_menten: nothing computed yet)"
    whole.series(1)
    assert "branch, series" in repr(whole)
    assert "series 1" in str(whole)


@pytest.mark.exhaustive
def test_a_start_off_a_sheet_that_repels_is_reduced_to_the_sheet_where_its_layer_settles() -> None:
    """y' = y - y^3 + x/10 from y = 0.15: y = 0 is nearest and repels, and the run goes to y = 1."""
    system = SlowFastSystem(slow={x: -x + y / 2}, fast={y: y - y**3 + x / 10}, epsilon=eps)

    def asked(**others) -> Study:
        given = {"region": {"x": (-1, 1), "y": (-1.5, 1.5)}, "start": {"x": 0.1, "y": 0.15}, **others}
        return study_of(Scene(system, span=(0, 3), epsilon=0.01, tolerance=1e-3, **given))

    settled = asked()
    assert settled.branch.points(np.array([[0.1]]))[0, 0] == pytest.approx(1.005, abs=1e-3)
    full = settled.full(0.01)
    assert gsp.simulate(settled)["x"][-1] == pytest.approx(full["x"][-1], rel=1e-3)
    # Whoever bounds the fast variable, or starts on the sheet, means the sheet that repels.
    bounded = asked(region={"x": (-1, 1), "y": (-0.5, 0.5)})
    on_it = asked(start={"x": 0.1, "y": -0.01})
    for study in (bounded, on_it):
        assert abs(study.branch.points(np.array([[0.1]]))[0, 0]) < 0.1


@pytest.mark.exhaustive
def test_a_start_off_a_saddle_settles_where_its_layer_does() -> None:
    """Hindmarsh and Rose, between the saddle and the sheet at rest, which is further away in the states' sizes."""
    u, v, z = sp.symbols("u v z")
    bursting = VectorField(
        {
            u: v - u**3 + 3 * u**2 - z + sp.Rational(13, 10),
            v: 1 - 5 * u**2 - v,
            z: eps * (4 * (u + sp.Rational(8, 5)) - z),
        },
        epsilon=eps,
    )
    region = {"u": (-2, -0.5), "v": (-20, 0), "z": (0.5, 2)}
    study = study_of(Scene(bursting, region, {"u": -1.2, "v": -6.2, "z": 1.4}, (0, 500), 1e-3, tolerance=1e-3))
    (point,) = study.branch.points(np.array([[1.4]]))
    root = min(np.roots([1, 2, 0, -0.9]).real)
    assert dict(zip(map(str, study.system.y), point)) == pytest.approx({"u": root, "v": 1 - 5 * root**2})
    # The run comes to the fold at z = 1.115 and leaves it.
    assert gsp.choose(study).partial.order is not None


def test_a_slow_coordinate_that_is_infinite_in_the_region_is_named() -> None:
    """An epidemic's S + I - log(S)/3, where the region holds S = 0."""
    s, i = sp.symbols("S I")
    epidemic = VectorField({s: (1 - s) - 3 * s * i / eps, i: 3 * s * i / eps - i / eps - i}, epsilon=eps)
    given = Scene(epidemic, {"S": (0, 1), "I": (0, 1)}, {"S": 0.9, "I": 0.05}, (0, 1), 0.01)
    with pytest.raises(DeclarationError, match=r"no finite value in a place of the region\. Got S = 0, I = 0"):
        _ = study_of(given).region
