"""Charts: each draws on every scene that it applies to, with labels, and touches no global state."""

from __future__ import annotations

import inspect
import itertools
import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp import SlowFastSystem, analyse, charts, compare, models
from gsp.charts.continuation import MARKERS
from gsp.charts.orbits import shrinks_in_proportion
from gsp.charts.streamlines import streamlines
from gsp.charts.style import LADDER, mathematics, plain
from gsp.comparison.method_table import method_table
from gsp.comparison.work_precision import WorkPrecision
from gsp.comparison.work_runs import WorkCurve, WorkKind, WorkPoint
from gsp.critical.continuation import special_points
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError
from gsp.fibres.composite_solution import composite
from gsp.scenes.scene import Scene
from tests.analyses import analysis_of
from tests.example_systems import saddle_scene


@pytest.fixture(scope="module")
def saddle():
    return analyse(saddle_scene())


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", models.names())
def test_every_chart_that_applies_draws_with_labels(name):
    drawn = charts.applicable(analysis_of(name))
    assert {"phase_portrait", "convergence", "error_against_epsilon", "manifold", "time_series"} <= set(drawn)
    for chart, draw in drawn.items():
        axes = draw(analysis_of(name))
        assert axes.get_xlabel(), chart
        assert axes.get_ylabel(), chart
        assert axes.lines or axes.collections, chart
        # Two Axes side by side share the figure's legend.
        legend = axes.get_legend() or next(iter(axes.figure.legends), None)
        assert legend is not None, chart
        assert all(text.get_text() for text in legend.get_texts()), chart


@pytest.mark.exhaustive
def test_a_saddle_draws_without_landing_runs(saddle):
    assert saddle.landing == ()
    drawn = charts.applicable(saddle)
    assert "distance" not in drawn
    for draw in drawn.values():
        assert charts.png(draw(saddle)).startswith(b"\x89PNG")
    with pytest.raises(DeclarationError, match="no run lands"):
        charts.distance(saddle)


@pytest.mark.exhaustive
def test_png_draws_the_figure_and_equal_figures_are_equal_files(tmp_path):
    first, second = (charts.png(charts.time_series(analysis_of("linear"))) for _ in range(2))
    assert first.startswith(b"\x89PNG")
    assert first == second
    written = charts.save(charts.time_series(analysis_of("linear")), tmp_path / "figure.png")
    assert written.read_bytes() == first


@pytest.mark.exhaustive
def test_given_axes_are_drawn_on():
    axes = Figure().add_subplot()
    assert charts.phase_portrait(analysis_of("linear"), axes) is axes
    assert axes.lines


def test_a_surface_refuses_plane_axes():
    with pytest.raises(DeclarationError, match="three-dimensional"):
        charts.manifold(analysis_of("chaplygin_sleigh"), Figure().add_subplot())


@pytest.mark.exhaustive
def test_style_does_not_leak():
    before = dict(matplotlib.rcParams)
    charts.png(charts.error_against_epsilon(analysis_of("linear").comparison))
    assert dict(matplotlib.rcParams) == before


@pytest.mark.exhaustive
def test_measured_and_expected_slopes_stand_in_the_legend():
    comparison = analysis_of("michaelis_menten").comparison
    texts = [t.get_text() for t in charts.error_against_epsilon(comparison).get_legend().get_texts()]
    assert f"order 2: slope {comparison.slopes[2]:.2f}, expected 3" in texts
    exact = charts.error_against_epsilon(analysis_of("davis_skodje").comparison)
    assert "order 0: exact to rounding" in [t.get_text() for t in exact.get_legend().get_texts()]


def test_the_sleigh_is_seen_in_its_raw_variables_and_in_the_plane():
    sleigh = analysis_of("chaplygin_sleigh")
    portrait, path = charts.phase_portrait(sleigh), charts.path(sleigh)
    assert (portrait.get_xlabel(), portrait.get_ylabel()) == ("$v$", r"$\omega$")
    assert portrait.get_aspect() == 1.0
    assert (path.get_xlabel(), path.get_ylabel()) == ("$x$", "$y$")
    assert charts.heading_of(sleigh) == "phi"


@pytest.mark.exhaustive
def test_a_path_needs_a_scene_that_has_one():
    with pytest.raises(DeclarationError, match="draws no path"):
        charts.path(analysis_of("linear"))


@pytest.mark.exhaustive
def test_constant_eigenvalues_are_known():
    assert charts.has_constant_eigenvalues(analysis_of("chaplygin_sleigh"))
    assert not charts.has_constant_eigenvalues(analysis_of("van_der_pol"))
    assert "eigenvalues" not in charts.applicable(analysis_of("chaplygin_sleigh"))
    # In the complex plane, where there is nothing to see over the region.
    assert charts.eigenvalues(analysis_of("chaplygin_sleigh")).get_ylabel()


@pytest.mark.exhaustive
def test_names_that_matplotlib_cannot_set_become_plain_text():
    assert mathematics("omega") == r"$\omega$"
    assert mathematics("y1") == "$y_{1}$"
    assert plain("costs 5$") == r"costs 5\$"
    for name in ("xdot", "slow_rate", "xnorm", "lambda", "a__b_c", "Abs", "é"):
        axes = Figure().add_subplot()
        axes.set_xlabel(mathematics(name))
        charts.png(axes)


@pytest.mark.exhaustive
def test_the_axis_of_the_small_parameter_has_its_own_name():
    x, y, small = sp.symbols("x y TA")
    system = SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=small, name="lag")
    scene = Scene(
        system, region={"x": (-1, 1), "y": (-1, 1)}, start={"x": 1, "y": 0}, span=(0, 1), epsilon=0.02
    )
    analysis = analyse(scene)
    along = charts.error_against_epsilon(analysis.comparison)
    assert along.get_xlabel() == r"$\mathrm{TA}$"
    for draw in (charts.failures_along, charts.failures_by_tolerance):
        assert draw(analysis.failures).get_ylabel() == r"$\mathrm{TA}$"
    assert charts.method_errors(method_table(scene)).get_xlabel() == r"$\mathrm{TA}$"
    for chart, draw in charts.applicable(analysis).items():
        for axes in draw(analysis).figure.axes:
            said = axes.get_xlabel() + axes.get_ylabel()
            assert "epsilon" not in said.replace(r"M_\epsilon", "").replace(r"h_\epsilon", ""), chart


@pytest.mark.exhaustive
def test_streamlines_follow_the_field_and_stop_at_rest():
    axes = Figure().add_subplot()
    u = v = np.linspace(-1.0, 1.0, 81)
    x, y = (a.ravel() for a in np.meshgrid(u, v))
    # Rotation, with a line of equilibria on y = 0.
    streamlines(axes, u, v, np.stack([-y * y, x * y], axis=1), distance=0.1, colour="k")
    assert len(axes.lines) > 10
    for line in axes.lines:
        px, py = line.get_data()
        assert np.ptp(np.hypot(px, py)) < 0.02
        assert (py > -0.06).all() or (py < 0.06).all()


@pytest.mark.exhaustive
def test_critical_curves_and_sheets_show_their_special_points():
    curve = charts.surroundings(analysis_of("van_der_pol"))
    labels = [text.get_text() for text in curve.get_legend().get_texts()]
    assert {"attracting", "repelling", "fold"} <= set(labels)
    sheet = charts.surroundings(analysis_of("koper"))
    assert "folds" in [text.get_text() for text in sheet.get_legend().get_texts()]
    with pytest.raises(DeclarationError, match="explicit graph"):
        charts.surroundings(analysis_of("linear"))
    y, v, a, b = sp.symbols("y v a b")
    double = gsp.SlowFastSystem(
        slow={a: 1, b: 0}, fast={y: v, v: a + b * y + y**2 + y * v + y**3 / 3}, epsilon=sp.Symbol("epsilon")
    )
    bounds = {"a": (-1, 1), "b": (-1, 1), "y": (-1.5, 1.5)}
    found = gsp.critical_sheet(
        double, start={"a": -0.2, "b": -0.2, "y": 0.5, "v": 0}, bounds=bounds, resolution=8
    )
    labels = [text.get_text() for text in charts.critical_sheet(found).get_legend().get_texts()]
    assert {"cusp", "Bogdanov-Takens point"} <= set(labels)


@pytest.mark.exhaustive
def test_every_kind_that_a_curve_may_name_has_a_marker_of_its_own():
    named = set(re.findall(r"LossKind\.([A-Z_]+)", inspect.getsource(special_points))) - {"NEUTRAL_SADDLE"}
    assert {kind.name for kind in MARKERS} == named
    # An onset of slip is a fold.
    assert len({(style["marker"], style["mfc"]) for style in MARKERS.values()}) == len(MARKERS) - 1


@pytest.mark.parametrize("unit", [1, sp.Rational(1, 1000)])
def test_a_curve_that_leaves_for_infinity_does_not_set_the_scale(unit):
    # The folds are at w = +-2, v = -+1; beside w = 10 v has no bound.
    w, v, epsilon = sp.symbols("w v epsilon")
    u, s = v / unit, w / unit
    system = SlowFastSystem(slow={w: -w}, fast={v: (3 * u - u**3 - s) * (10 - s) + u / 100}, epsilon=epsilon)
    curve = continue_critical(system, start={"w": 0, "v": 2 * unit}, bounds={"w": (-20 * unit, 30 * unit)})
    assert np.ptp(curve["v"]) > 1e4 * unit
    low, high = charts.critical_curve(curve).get_ylim()
    folds = [point["v"] for point in curve.of_kind(LossKind.FOLD)]
    assert low < min(folds)
    assert high > max(folds)
    assert high - low < 30 * unit


def test_methods_and_composites_are_drawn_with_their_parts():
    scene = analysis_of("michaelis_menten").scene
    table = method_table(scene, refinements=(0, 1), iterates=(1,), orders=(0, 1))
    axes = charts.method_errors(table)
    colours = {(row.method, line.get_color()) for row, line in zip(table.rows, axes.get_lines(), strict=True)}
    assert len(colours) == len(dict(colours)) == len({colour for _, colour in colours})
    study = analysis_of("michaelis_menten").study
    solution = composite(analysis_of("michaelis_menten").series, study.start, span=scene.span, epsilon=0.05)
    axes = charts.composite(solution, name="c", full=analysis_of("michaelis_menten").full)
    labels = {text.get_text() for text in axes.get_legend().get_texts()}
    assert labels == {"full run", "outer: slow flow", "inner: layer", "composite"}


@pytest.mark.exhaustive
def test_runs_that_go_to_another_sheet_do_not_hide_those_that_land():
    x, y, u, w, epsilon = sp.symbols("x y u w epsilon")
    system = SlowFastSystem(
        slow={x: sp.Rational(1, 2) - u, y: u - y}, fast={u: x + u - u**3 / 3 - w, w: y / 4 - w}, epsilon=epsilon
    )
    scene = Scene(
        system,
        region={"x": (-0.1, 1), "y": (-1, 2), "u": (-3, 3)},
        start={"x": 0.7, "y": 0.5, "u": 2, "w": 0},
        span=(0, 0.6),
        epsilon=0.01,
        epsilons=(0.02, 0.01),
        tolerance=1e-4,
    )
    axes = charts.manifold(analyse(scene))
    low, high = axes.get_xlim()
    assert low == 0.0
    assert high > 5.0
    assert axes.get_ylim()[0] < 1e-3
    labels = {text.get_text() for text in axes.get_legend().get_texts()}
    assert "runs that have not landed on it" in labels


@pytest.mark.exhaustive
def test_the_values_of_epsilon_stand_beside_each_other_and_nothing_among_them():
    comparison = analysis_of("michaelis_menten").comparison
    epsilons = tuple(1 / 90 / 2**k for k in range(len(comparison.epsilons)))
    axes = charts.error_against_epsilon(replace(comparison, epsilons=epsilons))
    axes.figure.canvas.draw()
    labels = [*axes.get_xticklabels(), *axes.get_xticklabels(minor=True)]
    assert sorted(filter(None, (t.get_text() for t in labels))) == sorted(f"{e:.3g}" for e in epsilons)
    boxes = sorted((t.get_window_extent() for t in labels if t.get_text()), key=lambda box: box.x0)
    assert all(a.x1 < b.x0 for a, b in itertools.pairwise(boxes))


def test_bands_and_orders_are_told_apart():
    axes = charts.error_against_epsilon(analysis_of("michaelis_menten").comparison)
    assert "bands: expected slopes" in {text.get_text() for text in axes.get_legend().get_texts()}
    assert len(set(LADDER)) == 5


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("kinked", "smooth"),
    [
        (lambda x: sp.Abs(x) + x * sp.sign(x), lambda x: 2 * x),
        (lambda x: sp.Max(x**2, x / 4), lambda x: x**2),
    ],
)
def test_a_scene_off_a_kink_is_that_of_the_smooth_field_on_its_side(kinked, smooth):
    x, y, epsilon = sp.symbols("x y epsilon")
    scene = Scene(
        SlowFastSystem(slow={x: -y}, fast={y: kinked(x) - y}, epsilon=epsilon),
        region={"x": (0.5, 2)},
        start={"x": 1.5, "y": 0},
        span=(0, 0.4),
        epsilon=0.02,
        epsilons=(0.02, 0.01),
        tolerance=1e-6,
    )
    found = analyse(scene)
    twin = replace(scene, system=SlowFastSystem(slow={x: -y}, fast={y: smooth(x) - y}, epsilon=epsilon))
    for order, errors in compare(twin).errors.items():
        assert found.comparison.errors[order] == pytest.approx(errors, rel=1e-4, abs=1e-13)
    assert method_table(scene)["series 3"].errors == pytest.approx(
        method_table(twin)["series 3"].errors, rel=1e-3
    )
    for draw in charts.applicable(found).values():
        assert draw(found).has_data()


# What the command line and the report ask of a scene, and files of figures.
NOT_CHARTS = {
    *(
        "applicable",
        "check_chart_name",
        "drawn",
        "has_constant_eigenvalues",
        "heading_of",
        "png",
        "save",
        "shape",
    ),
    "slow_ends",
}


@pytest.mark.parametrize("name", sorted(set(charts.__all__) - NOT_CHARTS))
@pytest.mark.parametrize("noun", [None, 3, "koper", [1, 2], object()])
def test_a_chart_of_a_wrong_noun_is_refused_by_name(name, noun):
    arguments = {"view": ("course",)}.get(name, ())
    keywords = {"spread": {"name": "x"}, "composite": {"name": "x"}, "fold_passage": {"exits": []}}.get(
        name, {}
    )
    with pytest.raises(DeclarationError, match=f"(charts.)?{name} takes an? |no chart of a"):
        getattr(charts, name)(noun, *arguments, **keywords)


def test_a_chart_on_what_is_no_axes_is_refused():
    run = gsp.integrate(models.load("linear").system, start={"x": 1, "y": 1}, span=(0, 1), epsilon=0.1)
    with pytest.raises(DeclarationError, match="matplotlib's Axes"):
        charts.trajectory(run, 3)


def curve_of(label: str, kind: WorkKind, errors: list[float], seconds: list[float]) -> WorkCurve:
    points = tuple(
        WorkPoint(10.0**-k, e, e, s, steps=10, field_calls=60)
        for k, (e, s) in enumerate(zip(errors, seconds), 3)
    )
    return WorkCurve(label, kind, points, order=int(label[-1]) if label.startswith("order") else None)


def speed(*reduced: WorkCurve) -> WorkPrecision:
    full = curve_of("default", WorkKind.FULL, [1e-3, 1e-5, 1e-7], [1e-5, 2e-5, 4e-5])
    scene = models.load("linear")
    return WorkPrecision(scene, 0.01, np.array([0.0, 1.0]), (full, *reduced), 1e-13, "from the start", {}, {})


def test_models_that_lie_on_one_point_are_told_apart_and_said_to_be_equal() -> None:
    same = [curve_of(f"order {k}", WorkKind.REDUCED, [1e-4, 1e-6, 1e-8], [2e-6, 4e-6, 8e-6]) for k in (1, 2)]
    axes = charts.draw(speed(*same))
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "order 2, as exact as order 1" in names
    one, other = (line for line in axes.lines if str(line.get_label()).startswith("order"))
    assert other.get_markersize() > one.get_markersize()
    assert other.get_markerfacecolor() == "none"
    apart = curve_of("order 2", WorkKind.REDUCED, [1e-5, 1e-7, 1e-9], [2e-6, 4e-6, 8e-6])
    names = [text.get_text() for text in charts.draw(speed(same[0], apart)).get_legend().get_texts()]
    assert "order 2" in names


@pytest.mark.parametrize(("seconds", "told"), [(1e-6, "a factor of 2"), (1e-3, "reducing saves nothing here")])
def test_a_chart_says_what_reducing_saves(seconds: float, told: str) -> None:
    found = speed(curve_of("order 0", WorkKind.REDUCED, [1e-5], [seconds]))
    assert found.saving == pytest.approx(2e-5 / seconds)
    assert told in str(found)
    assert any(told in text.get_text() for text in charts.draw(found).texts)


def test_the_axis_of_time_scales_ends_where_a_mode_stands_still() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    # The second mode is slow beyond all bounds: its rate is rounding.
    field = gsp.VectorField({x: -x / epsilon, y: -sp.Rational(1, 10**13) * y}, epsilon=epsilon)
    scales = gsp.time_scales(field, start={"x": 1, "y": 1}, span=(0, 2), epsilon=0.1)
    assert np.nanmax(scales.times) > 1e12
    low, high = charts.time_scales(scales).get_ylim()
    assert low < 0.1 < high <= 2000


@pytest.mark.exhaustive
@pytest.mark.parametrize(("infected", "shrinks"), [(0.1, True), (0, False)])
def test_full_runs_come_nearer_in_proportion_where_the_limit_is_theirs(infected: float, shrinks: bool) -> None:
    """Without a single one infected the limit stays where it is, and every full run goes off with the virions."""
    T, ill, V, epsilon = sp.symbols("T ill V epsilon")
    spread = T * V / 50
    system = SlowFastSystem(
        slow={T: 1 - T - spread, ill: spread - ill}, fast={V: 200 * ill - V}, epsilon=epsilon
    )
    region = {"T": (0, 2), "ill": (0, 2), "V": (0, 400)}
    scene = Scene(system, region, {"T": 1, "ill": infected, "V": 1}, (0, 3), 0.02)
    assert shrinks_in_proportion(analyse(scene, orders=(0, 1), order=1)) is shrinks


class Ended(dict):
    """A run that ended at its first point."""

    t = np.array([0.0])


@pytest.mark.exhaustive
def test_states_over_time_are_seen_where_the_reduced_run_ends_where_it_starts():
    """A series past its reach at the base point has any size there, which is no part of the picture."""
    found = analysis_of("michaelis_menten")
    at_once = {name.name: np.array([1e6]) for name in found.scene.system.states}
    lost = replace(found, reduced=Ended(at_once))
    axes = charts.time_series(lost)
    assert axes.get_ylim()[1] < 2.0
    assert not any("reduced" in text.get_text() for text in axes.get_legend().get_texts())


@pytest.mark.exhaustive
def test_a_run_is_labelled_by_the_name_of_its_small_parameter() -> None:
    x, y, nu = sp.symbols("x y nu")
    system = gsp.SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=nu)
    scene = gsp.Scene(system, {"x": (0, 1)}, {"x": 1, "y": 0}, (0, 1), 0.1)
    axes = gsp.charts.phase_portrait(gsp.analyse(scene))
    labels = axes.get_legend_handles_labels()[1]
    assert any(r"\nu" in label and "0.1" in label for label in labels)
    assert not any(r"\epsilon =" in label for label in labels)
    assert "nu = 0.1" in str(gsp.choose(scene))
    assert "nu = 0.1" in str(gsp.integrate(system, start={"x": 1, "y": 0}, span=(0, 1), epsilon=0.1))


# Eight fast variables; time is counted in years from 2020 on.
YEARS = """
[slow]
x = "-x"
year = 1
[fast]
%s
[region]
x = [0.5, 2]
year = [2020, 2021]
[start]
x = 1
year = 2020
%s
[scene]
span = [2020, 2020.5]
epsilon = 0.01
"""


def test_all_states_are_drawn_over_time_but_the_time_itself(tmp_path):
    names = [f"y{k}" for k in range(8)]
    rates, starts = ("\n".join(map(text.format, names)) for text in ('{0} = "x - {0}"', "{0} = 0"))
    (tmp_path / "years.toml").write_text(YEARS % (rates, starts), encoding="utf-8")
    scene = gsp.load(tmp_path / "years.toml")
    axes = charts.time_series(analyse(scene))
    labelled = {line.get_label(): line for line in axes.lines if str(line.get_label()).endswith(", full")}
    assert set(labelled) == {f"{mathematics(name)}, full" for name in ("x", *names)}
    assert len({(line.get_color(), line.get_linestyle()) for line in labelled.values()}) == 9
    assert axes.get_ylim()[1] < 2


def test_years_are_numbers_of_an_axis_as_they_are():
    x = sp.Symbol("x")
    axes = charts.trajectory(gsp.integrate(gsp.VectorField({x: -x}), start={"x": 1}, span=(2020.25, 2020.75)))
    charts.png(axes)
    assert axes.xaxis.get_offset_text().get_text() == ""
    assert "2020.5" in [label.get_text() for label in axes.get_xticklabels()]


def test_long_names_stay_within_the_figure_and_one_point_is_seen():
    names = [
        f"the_{ordinal}_of_the_quantities_that_nobody_wants_to_read_twice" for ordinal in ("first", "other")
    ]
    first, other = sp.symbols(names)
    field = gsp.VectorField({first: -first, other: -other})
    start = dict.fromkeys(names, 1)
    point = charts.trajectory(gsp.integrate(field, start=start, span=(0, 1), at=[0.5]))
    assert [line.get_marker() for line in point.lines] == ["o", "o"]
    ensemble = gsp.integrate_many(
        field, starts=dict.fromkeys(names, np.array([1.0, 2.0])), span=(0, 1), at=[0, 1]
    )
    for axes in (point, charts.spread(ensemble, name=names[0])):
        axes.figure.canvas.draw()
        for part in (axes.get_legend(), axes.xaxis.label, axes.yaxis.label):
            box, figure = part.get_window_extent(), axes.figure.bbox
            assert min(box.x0, box.y0) >= 0
            assert box.x1 <= figure.x1
            assert box.y1 <= figure.y1


@pytest.mark.parametrize("far", [0, 300])
def test_states_of_different_sizes_are_drawn_over_their_own_ranges(far: int) -> None:
    """A concentration beside a temperature, and a temperature beside a pressure, were flat lines."""
    x, y, epsilon = sp.symbols("x y epsilon")
    rates = -x, 10**6 * x + far - y
    system = SlowFastSystem(slow={x: rates[0]}, fast={y: rates[1]}, epsilon=epsilon)
    scene = Scene(system, {"x": (0, 2e-6)}, {"x": 1e-6, "y": far}, (0, 2), 0.02)
    axes = charts.time_series(analyse(scene, orders=(0, 1), order=1))
    drawn = [line.get_ydata() for line in axes.lines if "full" in str(line.get_label())]
    low, high = axes.get_ylim()
    assert len(drawn) == 2
    assert all(np.ptp(values) > 0.5 * (high - low) for values in drawn)
    assert "over its range" in axes.get_ylabel()
    assert any("1.353e-07 to" in str(line.get_label()) for line in axes.lines)


def _enzyme_like():
    x, y, epsilon = sp.symbols("x y epsilon")
    return SlowFastSystem(slow={x: -x}, fast={y: x**2 - y}, epsilon=epsilon)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"name": 3}, "name of charts.composite is a name. Got 3."),
        ({"name": "z"}, "name is that of a variable of the expansion. They are x, y."),
        (
            {"name": "y", "full": 3},
            "full of charts.composite is a Trajectory. Got 3. Give one, or leave it out.",
        ),
    ],
)
def test_an_option_of_a_chart_is_what_it_says(given: dict, words: str) -> None:
    series = gsp.expand(gsp.solve_critical(_enzyme_like()).branches[0], order=1)
    solution = gsp.composite(series, {"x": 1, "y": 0}, span=(0, 1), epsilon=0.02)
    with pytest.raises(DeclarationError) as refused:
        charts.composite(solution, **given)
    assert words in str(refused.value)


def test_names_of_axes_are_a_pair_and_exits_are_some() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    fold = gsp.fold_passage(system, {"x": 1, "y": -2 / 3})
    for exits, words in (
        (3, "is a list of FoldExit"),
        ([None], "is a list of FoldExit"),
        ([], "exits are empty"),
    ):
        with pytest.raises(DeclarationError, match=words):
            charts.fold_passage(fold, exits=exits)
    orbit = gsp.singular_orbit(gsp.solve_critical(system).nearest({"x": 2, "y": 0.6}), {"x": 2, "y": 0.6})
    for names in ("x", ("x",), ("x", "y", "x"), 1.0):
        with pytest.raises(DeclarationError, match=r"names of charts\.singular_orbit is a pair of names"):
            charts.singular_orbit(orbit, names=names)


def test_what_helps_to_draw_says_what_it_takes() -> None:
    for helper in (charts.applicable, charts.shape, charts.slow_ends, charts.heading_of, charts.png):
        with pytest.raises(DeclarationError, match="takes an"):
            helper(3)
    run = gsp.integrate(_enzyme_like(), start={"x": 1, "y": 0}, span=(0, 1), epsilon=0.02)
    polar = Figure().add_subplot(projection="polar")
    with pytest.raises(DeclarationError, match="Got polar Axes"):
        charts.trajectory(run, polar)
    with pytest.raises(DeclarationError, match="path is the name of a file"):
        charts.save(charts.trajectory(run), None)
    with pytest.raises(DeclarationError, match="There are png, pdf, svg"):
        charts.drawn(charts.trajectory(run), "xyz")


def test_sheets_beyond_a_pole_do_not_make_a_portrait_wider() -> None:
    """A sheet at y = -9, where no orbit comes to, took three quarters of the picture."""
    x, y, epsilon = sp.symbols("x y epsilon")
    rate = x - y + 5 / (y + sp.Rational(1, 2)) - y**3 / 100
    scene = gsp.Scene(
        gsp.SlowFastSystem(slow={x: -x}, fast={y: rate}, epsilon=epsilon),
        region={"x": (0, 1), "y": (1, 4)},
        start={"x": 1, "y": 2},
        span=(0, 1),
        epsilon=0.01,
    )
    axes = gsp.charts.phase_portrait(gsp.analyse(scene))
    assert axes.get_ylim()[0] > -0.5
