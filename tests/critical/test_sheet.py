"""Sheets of the critical manifold and the curves of folds on them, against what is known of them."""

import numpy as np
import pytest
import sympy as sp

from gsp.critical.continuation.critical_sheet import critical_sheet
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.continuation.fold_curve import continue_folds
from gsp.critical.loss_kind import LossKind
from gsp.errors import BranchError, DeclarationError, Status
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems

eps = systems.epsilon
a, b, c, y, v, w, y1, y2, current = sp.symbols("a b c y v w y1 y2 I")


def over(g, fast=(y,), parameters=None) -> SlowFastSystem:
    """Two slow variables a and b."""
    rates = g if isinstance(g, (tuple, sp.MatrixBase)) else (g,)
    return SlowFastSystem(slow={a: sp.Integer(1), b: sp.Integer(1)}, fast=dict(zip(fast, rates)), epsilon=eps,
                          parameters=parameters or {})  # fmt: skip


CUSP = over(y**3 + a * y + b)
BOX = {"a": (-1, 1), "b": (-1, 1), "y": (-2, 2)}
# The cusp of CUSP and a contracting direction, in the variables u of y = T u.
T = sp.Matrix([[1, 2], [-1, 1]])
HIDDEN = T * sp.Matrix([y1, y2])
DISGUISED = over(
    T.inv() * sp.Matrix([HIDDEN[0] ** 3 + a * HIDDEN[0] + b, HIDDEN[0] ** 2 - HIDDEN[1]]), (y1, y2)
)
DISGUISED_START = dict(zip(("y1", "y2"), map(float, T.inv() * sp.Matrix([1, 1]))))


def discriminant(result) -> np.ndarray:
    return 4 * result["a"] ** 3 + 27 * result["b"] ** 2


def edges(sheet) -> tuple[np.ndarray, np.ndarray]:
    """The edges of the triangles, and how many triangles each has."""
    pairs = np.sort(sheet.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(pairs, axis=0, return_counts=True)


def euler(sheet) -> int:
    return len(np.unique(sheet.triangles)) - len(edges(sheet)[0]) + len(sheet.triangles)


# -- curves of folds -------------------------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "start", [{"a": -3, "b": 2, "y": 1}, {"a": -0.8, "b": 0.1, "y": 0.4}, {"a": 0, "b": 0, "y": 0}]
)
def test_the_curve_of_folds_of_the_cusp(start) -> None:
    folds = continue_folds(CUSP, start=start, bounds={"a": (-3, 1), "y": (-1, 1)})
    assert np.abs(discriminant(folds)).max() < 1e-12
    (point,) = folds.special
    assert point.kind is LossKind.CUSP
    assert [point["a"], point["b"], point["y"]] == pytest.approx([0, 0, 0], abs=1e-12)
    assert point.coefficients["c"] == pytest.approx(1, abs=1e-12)
    assert folds["a"][[0, -1]] == pytest.approx([-3, -3], abs=1e-12)
    assert folds.status is Status.BOUND_REACHED
    assert (np.diff(np.sign(np.delete(folds.coefficient, point.row))) != 0).sum() == 1
    assert (np.diff(folds.arclength) > 0).all()


@pytest.mark.exhaustive
def test_the_curve_of_folds_of_fitzhugh_nagumo_over_w_and_the_current() -> None:
    system = SlowFastSystem(
        slow={w: v - w}, fast={v: v - v**3 / 3 - w + current}, epsilon=eps, parameters={current: 0.5}
    )
    curve = continue_critical(system, start={"v": 2, "w": 0.2}, bounds={"v": (-2.5, 2.5)})
    for point in curve.special:
        folds = continue_folds(system, start=point.point, parameter=current, bounds={"I": (-2, 2)})
        sign = np.sign(point["v"])
        assert np.abs(folds["v"] - sign).max() < 1e-12
        assert np.abs(folds["w"] - 2 * sign / 3 - folds["I"]).max() < 1e-12
        assert sorted(folds["I"][[0, -1]]) == [-2, 2]
        assert folds.special == ()


@pytest.mark.parametrize("x", [1.2, -1.3])
def test_the_folds_of_koper_are_lines(x: float) -> None:
    folds = continue_folds(
        systems.koper(), start={"x": x, "y": 0.9, "z": 0.8}, bounds={"y": (-3, 3), "z": (-3, 3)}
    )
    assert np.abs(folds["x"] - np.sign(x)).max() < 1e-12
    assert np.abs(-10 * folds["y"] - folds["x"] ** 3 + 3 * folds["x"] + 7).max() < 1e-12
    assert sorted(folds["z"][[0, -1]]) == [-3, 3]


def test_a_bogdanov_takens_point_is_told_from_a_cusp() -> None:
    system = over((y2, a + b * y2 + y1**2 + y1 * y2), (y1, y2))
    folds = continue_folds(system, start={"a": 0.1, "b": -1, "y1": 0, "y2": 0}, bounds={"b": (-2, 2)})
    (point,) = folds.special
    assert point.kind is LossKind.BOGDANOV_TAKENS
    assert point.unknowns == pytest.approx(0, abs=1e-12)
    assert np.abs(point.eigenvalues).max() < 1e-6


@pytest.mark.parametrize(
    ("g", "start"),
    [
        (y**4 + a * y + b, {"a": -4, "b": 3, "y": 1}),
        (y**6 + a * y**2 + b, {"a": -3, "b": 2, "y": 1}),
        (y**5 + a * y**2 + b, {"a": -2.5, "b": 1.5, "y": 1}),
        (y**4 + a * y**2 + b, {"a": -1, "b": 0, "y": 0}),
    ],
    ids=["order 4", "order 6", "order 5", "a line across the curve"],
)
def test_a_fold_of_higher_order_on_a_curve_of_folds_is_degenerate(g: sp.Expr, start: dict) -> None:
    """The fold coefficient touches zero there, or changes its sign where another curve of folds crosses."""
    folds = continue_folds(over(g), start=start, bounds={"a": (-5, 5), "b": (-5, 5), "y": (-2, 2)})
    (point,) = folds.special
    assert point.kind is LossKind.DEGENERATE
    assert max(abs(point[name]) for name in ("a", "b", "y")) < 1e-4


@pytest.mark.exhaustive
def test_a_closed_curve_of_folds_closes() -> None:
    folds = continue_folds(over(1 - a**2 - 2 * b**2 - y**2), start={"a": 0.9, "b": 0, "y": 0})
    assert folds.status is Status.CLOSED
    assert np.abs(folds["a"] ** 2 + 2 * folds["b"] ** 2 - 1).max() < 1e-12
    assert np.abs(folds["y"]).max() < 1e-12


@pytest.mark.exhaustive
def test_the_units_of_the_variables_do_not_move_the_folds() -> None:
    k = 10**4
    scaled = over((y / k) ** 3 + a * y / k + b * k)
    folds = continue_folds(
        scaled, start={"a": -3, "b": 2 / k, "y": k}, bounds={"a": (-3, 1), "y": (-k, k), "b": (-3 / k, 3 / k)}
    )
    assert np.abs(4 * folds["a"] ** 3 + 27 * (k * folds["b"]) ** 2).max() < 1e-10
    assert [p.kind for p in folds.special] == [LossKind.CUSP]


@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-40])
def test_a_curve_of_folds_in_a_plane_of_symmetry_is_followed_from_any_rounding(off: float) -> None:
    # The outer equator of a torus: g_y itself is what vanishes, and it fell to 1e-172 in three steps.
    r2 = a**2 + b**2
    torus = over(16 * r2 - (r2 + y**2 + 3) ** 2)
    start = {"a": -2.9705289, "b": -0.4194961, "y": off}
    curve = continue_folds(torus, start=start, bounds={"a": (-4, 4), "b": (-4, 4), "y": (-2, 2)})
    assert curve.status is Status.CLOSED
    assert np.hypot(curve["a"], curve["b"]) == pytest.approx(3.0)


@pytest.mark.parametrize("edge", [0.0, 1e-8, 1e-3, -0.5])
@pytest.mark.parametrize("tilt", [0, 2, sp.Rational(21, 10)])
def test_a_curve_of_folds_that_runs_into_a_pole_stays_on_the_folds(edge: float, tilt: sp.Rational) -> None:
    """Where c/(1 + (r/2)^5) is 0/0 the field has no value, and no bound beside it is reached by a mere number."""
    r, c, m, u = sp.symbols("r c m u")
    bent = u**3 / 50 * (r + tilt) if tilt else 0
    rise = (sp.Rational(1, 10) + u**2) / (1 + u**2)
    rates = {m: 4 * c * rise / (1 + (r / 2) ** 5) - m, u: 2 * m - u - bent}
    system = SlowFastSystem(slow={r: (u - r) / 4, c: u / 3 - c}, fast=rates, epsilon=sp.Symbol("epsilon"))
    start, bounds = {"r": 0.5, "c": 0.3, "m": 0.22, "u": 0.447}, {"r": (-2 + edge, 3), "c": (-6, 10)}
    folds = continue_folds(system, start=start, bounds=bounds)
    for point in folds.points[:, [folds.names.index(n) for n in "rcmu"]]:
        slope = folds.problem.jacobian(point)
        # As near as points are corrected to, where everything changes faster and faster.
        off = 1e-9 * abs(slope).max()
        assert abs(folds.problem.residual(point)).max() < off
        assert abs(np.linalg.det(slope[:, 2:])) < off
    # With 2 m = u + u^3 (r + tilt)/50 the folds meet in pairs once for r > -2.
    kinds = [point.kind for point in folds.special]
    assert kinds == ([LossKind.CUSP] if tilt else [])
    if not tilt:
        assert "m = 0.223607 throughout" in str(folds)
    if edge == 0.0:
        assert "NON_FINITE" in folds.message


def test_fewer_points_than_needed_is_an_ending() -> None:
    folds = continue_folds(CUSP, start={"a": -3, "b": 2, "y": 1}, max_points=5)
    assert folds.status is Status.TOO_MANY_POINTS
    assert len(folds) == 9


@pytest.mark.parametrize(
    ("system", "options", "error", "message"),
    [
        (CUSP, {"start": {"a": 1, "b": 1}}, DeclarationError, "no value for y"),
        (CUSP, {"start": {"a": 1, "b": 1, "y": 1}, "free": ("a",)}, DeclarationError, "two different variables"),
        (CUSP, {"start": {"a": 1, "b": 1, "y": 1}, "free": ("a", "a")}, DeclarationError, "two different"),
        (systems.van_der_pol(), {"start": {"y": 0.6, "x": 1}}, DeclarationError, "one slow variable and parameter"),
        (systems.van_der_pol(), {"start": {"y": 0.6, "x": 1}, "parameter": "k"}, DeclarationError, "parameter is one"),
        (over(y - a - b), {"start": {"a": 0, "b": 0, "y": 0}}, BranchError, "no fold near start"),
        (CUSP, {"start": {"a": -3, "b": 2, "y": 1}, "bounds": {"a": (0, 1)}}, DeclarationError, "outside the bounds"),
    ],
)  # fmt: skip
def test_a_wrong_call_for_folds_is_named(system, options, error, message) -> None:
    with pytest.raises(error, match=message):
        continue_folds(system, **options)


# -- sheets ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cusp_sheet():
    return critical_sheet(CUSP, start={"a": -1, "b": 0, "y": 1}, bounds=BOX, resolution=16)


@pytest.mark.exhaustive
def test_the_sheet_of_the_cusp_is_on_the_manifold_and_in_the_box(cusp_sheet) -> None:
    sheet = cusp_sheet
    assert sheet.status is Status.COMPLETE
    assert np.abs(sheet["y"] ** 3 + sheet["a"] * sheet["y"] + sheet["b"]).max() < 1e-13
    assert sheet.residual < 1e-13
    for name, (low, high) in BOX.items():
        assert (sheet[name] >= low).all()
        assert (sheet[name] <= high).all()
    assert sheet["a"].min() == -1
    assert sheet["b"].max() == 1


@pytest.mark.exhaustive
def test_the_sheet_of_the_cusp_is_a_disc_with_its_edge_on_the_bounds(cusp_sheet) -> None:
    pairs, count = edges(cusp_sheet)
    assert euler(cusp_sheet) == 1
    assert set(count) == {1, 2}
    rim = np.unique(pairs[count == 1])
    on_bound = (np.abs(cusp_sheet["a"][rim]) == 1) | (np.abs(cusp_sheet["b"][rim]) == 1)
    assert on_bound.all()


def test_the_triangles_end_at_the_fold_and_have_one_stability_each(cusp_sheet) -> None:
    sheet = cusp_sheet
    assert sheet.on_fold.any()
    assert np.abs(discriminant(sheet)[sheet.on_fold]).max() < 1e-12
    slope = 3 * sheet["y"] ** 2 + sheet["a"]
    for triangle, unstable in zip(sheet.triangles, sheet.triangle_unstable):
        off = triangle[~sheet.on_fold[triangle]]
        assert (sheet.unstable[off] == unstable).all()
        assert ((slope[off] > 0) == unstable).all()
    (folds,) = sheet.folds
    assert [p.kind for p in folds.special] == [LossKind.CUSP]
    assert np.abs(discriminant(folds)).max() < 1e-12


@pytest.mark.parametrize("resolution", [8, 16])
def test_where_y_has_no_bounds_cubes_are_two_sizes_of_the_start_over_the_resolution_high(
    resolution: int,
) -> None:
    sheet = critical_sheet(
        over(y - 3 * a - 1 + a * b), start={"a": 0, "b": 0, "y": 1}, bounds={"a": (-1, 1), "b": (-1, 1)},
        resolution=resolution,
    )  # fmt: skip
    ends = sheet.points[edges(sheet)[0]]
    # Vertices leave their cubes by the square of their size.
    assert np.abs(ends[:, 0] - ends[:, 1])[:, 2].max() == pytest.approx(2 / resolution, rel=0.02)
    # Newton's method within each face is enough where the sheet is smooth.
    assert sheet.stats.repaired == 0
    assert np.abs(sheet["y"] - (1 + sheet["a"] * (3 - sheet["b"]))).max() < 1e-14


@pytest.mark.parametrize("unit", [1, 1000])
def test_triangles_cover_a_graph_once(unit: int) -> None:
    # Each vertex went its own way within its face: this sheet was covered 1.003 times, others 1.4.
    sheet = critical_sheet(
        over((a * b + b**2 / 2 - y, unit * y**2 + y * v / 2 - v), fast=(y, v)),
        start={"a": 0.5, "b": 0.5, "y": 0.375, "v": unit * 0.17},
        bounds={"a": (-1, 1), "b": (-1, 1), "y": (-1, 2), "v": (-unit, 10 * unit)},
        resolution=12,
    )
    corners = np.stack([sheet["a"], sheet["b"]], axis=1)[sheet.triangles]
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    covered = np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum() / 2
    assert covered == pytest.approx(4, rel=1e-9)


def test_neighbouring_triangles_are_turned_alike(cusp_sheet) -> None:
    directed = cusp_sheet.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    corners = cusp_sheet.points[cusp_sheet.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    good = np.repeat(area > 1e-8, 3)
    seen, count = np.unique(directed[good], axis=0, return_counts=True)
    assert (count == 1).mean() > 0.99
    assert len(seen) > 1000


@pytest.mark.exhaustive
def test_a_closed_surface_is_closed_and_its_area_converges() -> None:
    errors = []
    for resolution in (12, 24):
        sheet = critical_sheet(
            over(1 - a**2 - b**2 - y**2), start={"a": 0, "b": 0, "y": 1}, resolution=resolution,
            bounds={"a": (-2, 2), "b": (-2, 2)},
        )  # fmt: skip
        assert euler(sheet) == 2
        assert set(edges(sheet)[1]) == {2}
        corners = sheet.points[sheet.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        errors.append(4 * np.pi - np.linalg.norm(normals, axis=1).sum() / 2)
        (folds,) = sheet.folds
        assert folds.is_closed
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.25)


def test_the_sheet_of_koper_has_its_two_lines_of_folds() -> None:
    sheet = critical_sheet(
        systems.koper(), start={"x": 2, "y": 0.5, "z": 0.8}, bounds={"y": (-3, 3), "z": (-3, 3)}, resolution=12
    )
    assert sorted(float(f["x"].mean()) for f in sheet.folds) == pytest.approx([-1, 1], abs=1e-12)
    assert np.abs(np.abs(sheet["x"][sheet.on_fold]) - 1).max() < 1e-12
    assert sheet["z"].min() == -3
    assert euler(sheet) == 1


@pytest.mark.exhaustive
def test_sheets_that_cross_have_no_fold_there() -> None:
    # The prey of a food chain: x = 0, and a graph that folds at x = 1/3, y = 4/15 and crosses x = 0 at y = 1/5.
    sheet = critical_sheet(
        over(y * (1 - y) - 5 * y * a / (1 + 3 * y)), start={"a": 0.1, "b": 0, "y": 0.9}, resolution=16,
        bounds={"a": (-0.4, 0.5), "b": (-1, 1), "y": (-0.25, 1.5)},
    )  # fmt: skip
    (folds,) = sheet.folds
    assert folds["a"] == pytest.approx(4 / 15, abs=1e-12)
    assert sheet["a"][sheet.on_crossing] == pytest.approx(0.2, abs=1e-12)
    assert sheet["y"][sheet.on_crossing] == pytest.approx(0.0, abs=1e-12)
    assert sheet["a"][sheet.on_fold] == pytest.approx(4 / 15, abs=1e-12)
    assert "another sheet crosses it at a = 0.2, b from -1 to 1, y = 0" in sheet.message
    # A fold next to a crossing that is not quite one stays a fold.
    apart = critical_sheet(
        over(y * (a - y) - sp.Rational(1, 10**6)), start={"a": 1, "b": 0, "y": 1}, resolution=8,
        bounds={"a": (-0.9, 1), "b": (-1, 1), "y": (-2, 2)},
    )  # fmt: skip
    assert not apart.on_crossing.any()
    assert [float(fold["a"].mean()) for fold in apart.folds] == pytest.approx([2e-3], abs=1e-9)


@pytest.mark.exhaustive
def test_a_sheet_in_two_fast_variables_is_the_same_in_disguise() -> None:
    sheet = critical_sheet(
        DISGUISED,
        start={"a": -1, "b": 0, **DISGUISED_START},
        bounds={"a": (-1, 1), "b": (-1, 1)},
        resolution=10,
    )
    hidden = np.array(T, dtype=float) @ np.stack([sheet["y1"], sheet["y2"]])
    assert np.abs(hidden[0] ** 3 + sheet["a"] * hidden[0] + sheet["b"]).max() < 1e-12
    assert np.abs(hidden[1] - hidden[0] ** 2).max() < 1e-12
    assert euler(sheet) == 1
    assert set(edges(sheet)[1]) == {1, 2}
    assert set(sheet.triangle_unstable) == {0, 1}
    assert any([p.kind for p in f.special] == [LossKind.CUSP] for f in sheet.folds)
    assert max(np.abs(discriminant(f)).max() for f in sheet.folds) < 1e-11
    assert (np.abs(sheet["a"]) <= 1).all()


@pytest.mark.exhaustive
def test_a_sheet_in_four_fast_variables_is_a_disc_with_the_folds_of_one() -> None:
    # Behind the cusp three directions contract, each onto a bent graph.
    g = (y**3 + a * y + b, y**2 - y1, a * y - y2, y1 - w)
    sheet = critical_sheet(
        over(g, (y, y1, y2, w)), start={"a": -1, "b": 0, "y": 1, "y1": 1, "y2": -1, "w": 1},
        bounds=BOX | {"y1": (-1, 5), "y2": (-3, 3), "w": (-1, 5)}, resolution=6,
    )  # fmt: skip
    assert sheet.status is Status.COMPLETE
    assert euler(sheet) == 1
    assert sheet.residual < 1e-12
    assert np.abs(discriminant(sheet)[sheet.on_fold]).max() < 1e-10
    assert np.abs(sheet["y1"] - sheet["y"] ** 2).max() < 1e-10
    assert set(sheet.triangle_unstable.tolist()) == {0, 1}


def test_a_sheet_over_a_slow_variable_and_a_parameter() -> None:
    system = SlowFastSystem(
        slow={w: v}, fast={v: v - v**3 / 3 - w + current}, epsilon=eps, parameters={current: 0}
    )
    sheet = critical_sheet(
        system, start={"v": 2, "w": -0.6}, parameter=current, bounds={"w": (-1, 1), "I": (-1, 1)}, resolution=10
    )
    assert sheet.names == ("w", "v", "I")
    assert sheet.free == ("w", "I")
    assert sorted(float(f["v"].mean()) for f in sheet.folds) == pytest.approx([-1, 1], abs=1e-12)


def test_a_sheet_that_is_too_large_is_a_part() -> None:
    sheet = critical_sheet(CUSP, start={"a": -1, "b": 0, "y": 1}, bounds=BOX, resolution=16, max_points=50)
    assert sheet.status is Status.TOO_MANY_POINTS
    assert "raise max_points" in sheet.message
    assert 50 <= sheet.stats.cells < 200


def test_a_sheet_ends_where_g_is_not_finite() -> None:
    sheet = critical_sheet(over(y - sp.sqrt(a) - b), start={"a": 1, "b": 0, "y": 1}, resolution=8,
                           bounds={"a": (-1, 1), "b": (-1, 1)})  # fmt: skip
    assert sheet.status is Status.NON_FINITE
    assert sheet.stats.skipped > 0
    assert np.isfinite(sheet.points).all()
    assert sheet.residual < 1e-12


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [-6, 0, 6])
def test_vertices_beside_a_pole_that_are_not_on_the_manifold_are_left_out_in_any_units(power: int) -> None:
    """Budworms y on foliage a: cubes on the bound have their corners where the capacity y/(355 a) has no size."""
    unit = sp.Integer(10) ** power
    g = (
        y * (1 - y / (355 * a)) * 38 / 25 - y**2 * 849 / (500 * (sp.Rational(111, 100) ** 2 * a**2 + y**2))
    ) + 0 * b
    scaled = unit * g.xreplace({s: s / unit for s in (a, y)})
    number = float(unit)
    bounds = {"a": (-(2.0**-53) * number, 1.6 * number), "b": (0, 1), "y": (-290 * number, 750 * number)}
    start = {"a": 0.9 * number, "b": 0.5, "y": 318 * number}
    sheet = critical_sheet(over(scaled), start=start, bounds=bounds)
    assert sheet.status is Status.NON_FINITE
    assert sheet.residual < 1e-12
    values = sp.lambdify([a, y], g)(sheet["a"] / number, sheet["y"] / number)
    assert np.abs(values).max() < 1e-9
    assert np.array_equal(np.unique(sheet.triangles), np.arange(len(sheet.points)))


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [-6, 0, 6])
@pytest.mark.parametrize("edge", [-(2.0**-53), 0.0])
def test_a_fold_beside_a_pole_on_the_bound_is_found_on_either_side_of_rounding(edge: float, power: int) -> None:
    """Budworms y = a t on foliage a, folded where a = B/(r (1 - t/355) t) is least, t = 355/2 without saturation."""
    unit = sp.Integer(10) ** power
    r, B = sp.Rational(38, 25), sp.Rational(849, 500)
    g = (r * y * (1 - y / (355 * a)) - B * y**2 / (a**2 / 10**12 + y**2)) + 0 * b
    number = float(unit)
    sheet = critical_sheet(
        over(unit * g.xreplace({s: s / unit for s in (a, y)})),
        start={"a": 0.9 * number, "b": 0.5, "y": 318 * number},
        bounds={"a": (edge * number, 1.6 * number), "b": (0, 1), "y": (-290 * number, 750 * number)},
    )
    (fold,) = sheet.folds
    assert fold["a"] / number == pytest.approx(float(4 * B / (355 * r)), rel=1e-9)


def test_a_sheet_reports_its_progress_and_shows_itself() -> None:
    shares = []
    sheet = critical_sheet(
        CUSP, start={"a": -1, "b": 0, "y": 1}, bounds=BOX, resolution=6, progress=shares.append
    )
    assert shares
    assert all(0 < share <= 1 for share in shares)
    assert repr(sheet).startswith(f"CriticalSheet({len(sheet.points)} points, ")
    assert "fold: FoldCurve(" in str(sheet)
    with pytest.raises(DeclarationError, match='no column "x"'):
        sheet["x"]
    with pytest.raises(ValueError, match="read-only"):
        sheet.points[0, 0] = 0.0


@pytest.mark.parametrize(
    ("system", "options", "error", "message"),
    [
        (CUSP, {"start": {"a": -1, "b": 0, "y": 1}, "bounds": {"a": (-1, 1)}}, DeclarationError, "interval for b"),
        (CUSP, {"start": {"a": -1, "b": 0, "y": 3}, "bounds": BOX}, DeclarationError, "outside the bounds: y = 3"),
        (CUSP, {"start": {"a": -1, "b": 0}, "bounds": BOX}, DeclarationError, "no value for y"),
        (CUSP, {"start": {"a": -1, "b": 0, "y": 1}, "bounds": BOX, "resolution": 1}, DeclarationError, "resolution"),
        (systems.van_der_pol(), {"start": {"y": 0, "x": 0}, "bounds": {}}, DeclarationError, "two different"),
        (over(y**2 + 1), {"start": {"a": 0, "b": 0, "y": 0.5}, "bounds": BOX}, BranchError, "not on the critical"),
        (CUSP, {"start": {"a": -1, "b": 0, "y": 1}, "bounds": BOX, "max_points": 1}, DeclarationError, "max_points"),
        (
            over((a * b - y, 1000 * y**2 - v), fast=(y, v)),
            {"start": {"a": 0, "b": 0, "y": 0, "v": 0}, "bounds": {"a": (-1, 1), "b": (-1, 1)}, "resolution": 12},
            BranchError, "none of the cubes next to start is crossed",
        ),
    ],
)  # fmt: skip
def test_a_wrong_call_for_a_sheet_is_named(system, options, error, message) -> None:
    with pytest.raises(error, match=message):
        critical_sheet(system, **options)
