"""What is said of a loss: verdicts on both sides of what decides them, orders along fibres, and parts that are cut."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.layer_problem import LayerProblem
from gsp.critical.loss_kind import LossKind
from gsp.hyperbolicity.losses import consequences as told
from gsp.hyperbolicity.losses.fibre import FibreOrder, bifurcation_function, order_along
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.roots import gauss_newton, gauss_newton_at_each
from gsp.hyperbolicity.losses.shrinking import MARGIN, _parts, largest_sub_region
from gsp.hyperbolicity.losses.whole_branch import _algebraic, _combination
from gsp.hyperbolicity.samples import Kind, kind_of
from gsp.systems.system import SlowFastSystem

u, x, y, eps = sp.symbols("u x y epsilon")

# A verdict, words of its consequence, and words of its remedy.
VERDICTS = [
    (told.fold({"kappa": 1e-300, "delay": 1.5}, 1), "1.5 epsilon^(2/3) later", "start again on the sheet"),
    (told.fold({"kappa": -1e-300}, 1), "none reaches it", "keep the region off"),
    (told.fold({"kappa": 0.0}, 1), "the slow flow vanishes here: canards", "canard_value"),
    (told.fold({"kappa": 0.0}, 2), "tangent to the fold", "folded_singularities"),
    (told.cusp({"c": -1e-300}, 1), "the fast fibre attracts only", "do not jump"),
    (told.cusp({"c": 0.0}, 1), "the fast fibre repels", "M0 goes on"),
    (told.cusp({"c": 1.0}, 2), "two folds meet; the fast", "integrate the full system"),
    (told.transcritical({}), "nothing passes", "move the region"),
    (told.transcritical({"lambda": 1 - 2e-6}), "change to the other", "errors"),
    (told.transcritical({"lambda": 1 - 9e-7}), "with delay", "entry_exit"),
    (told.transcritical({"lambda": 1 + 9e-7}), "with delay", "entry_exit"),
    (told.transcritical({"lambda": 1 + 2e-6}), "they jump", "stop the reduced"),
    (told.pitchfork({"c": 1.0}), "nothing passes", "move the region"),
    (told.pitchfork({"crossing": 1, "c": 1e-300}), "subcritical", "stop the reduced"),
    (told.pitchfork({"crossing": 1, "c": 0.0, "push": 0.0}), "where the branch is invariant", "entry_exit"),
    (told.pitchfork({"crossing": 1, "c": -1.0, "push": -1e-300}), "one of the two outer", "side of `push`"),
    (told.rank_change({}), "nothing passes", "move the region"),
    (told.rank_change({"crossing": -1e-300}), "gains its attraction", "attracting side"),
    (told.rank_change({"crossing": 0.0, "push": 0.0}), "leave with delay", "entry_exit"),
    (told.rank_change({"crossing": 1.0, "push": 1e-300}), "(epsilon ln(1/epsilon))^(1/2)", "stop the reduced"),
    (told.hopf({"l1": 1.0}), "does not cross", "move the region"),
    (told.hopf({"crossing": -1e-300, "l1": 1}), "from oscillating", "attracting side"),
    (told.hopf({"crossing": 1e-300, "l1": -1e-300}), "small cycles", "entry-exit function"),
    (told.hopf({"crossing": 1.0, "l1": 1.0}), "large oscillations", "entry-exit"),
    (told.hopf({"crossing": 1.0, "l1": 0.0}), "higher terms", "entry-exit"),
    (told.BOGDANOV_TAKENS, "epsilon^(4/5)", "stop the reduced"),
    (told.NEUTRAL_SADDLE, "nothing: one eigenvalue on each side", "no change"),
    (told.NILPOTENT, "no exponential rate", "rescale the fast"),
    (told.CENTRE, "neither decay nor grow", "average"),
    (told.DEGENERATE, "do not decide", "integrate the full system"),
    (told.JUMP, "jumps across the axis", "Filippov"),
    (told.BRANCH_POLE, "the branch goes to infinity", "side of the pole"),
    (told.FIELD_POLE, "the field goes to infinity", "side of the pole"),
]
# After which reduction goes on.
HARMLESS = {"change to the other", "one of the two outer", "nothing: one eigenvalue on each side"}


@pytest.mark.parametrize(("verdict", "consequence", "remedy"), VERDICTS, ids=[row[1] for row in VERDICTS])
def test_what_follows_is_decided_by_the_signs_of_its_coefficients(
    verdict, consequence: str, remedy: str
) -> None:
    assert consequence in verdict.consequence
    assert verdict.may_reduce is (consequence in HARMLESS)
    assert remedy in verdict.remedy


def test_the_jump_at_a_fold_is_late_by_the_zero_of_airys_function() -> None:
    from scipy.special import ai_zeros

    assert pytest.approx(-ai_zeros(1)[0][0], rel=1e-15) == told.OMEGA_0


@pytest.mark.parametrize(
    ("order", "plus", "minus", "words"),
    [
        (2.0, 1.5, 1.5, "v' = 1.5 v^2 along the null direction and attracts from one side only"),
        (2.0, -2.0, 2.0, "v' = -2 v |v| along the null direction and attracts: decay goes like tau^(-1)"),
        (3.0, -4.0, 4.0, "v' = -4 v^3 along the null direction and attracts: decay goes like tau^(-0.5)"),
        (3.0, 4.0, -4.0, "v' = 4 v^3 along the null direction and repels: orbits leave"),
        (3.0, 4.0, 4.0, "v' = 4 |v|^3 along the null direction and attracts from one side"),
        (1.5, -1.0, 1.0, "v' = -1 v |v|^0.5 along the null direction and attracts: decay goes like tau^(-2)"),
        (4.0, -1.0, 1.0, "v' = -1 v |v|^3 along the null direction and attracts: decay goes like tau^(-0.333)"),
    ],
)
def test_algebraic_decay_is_told_with_its_power_and_its_sides(order, plus, minus, words: str) -> None:
    verdict = _algebraic(FibreOrder(order, plus, minus, False), np.array([]))
    assert verdict.consequence.startswith("the layer problem is " + words)
    assert not verdict.may_reduce
    assert "epsilon^" not in verdict.consequence
    slow = _algebraic(FibreOrder(order, plus, minus, False), np.array([0.1, -0.25]))
    assert (
        f"; the rate of order epsilon, -0.25, decides below v ~ epsilon^(1/{order - 1:g}):" in slow.consequence
    )
    assert _algebraic(FibreOrder(order, plus, minus, False), np.zeros(2)) == verdict


def test_combinations_are_scaled_to_their_first_term_and_without_rounding() -> None:
    assert _combination(np.array([2.0, -4.0, 1e-9, 2.0]), ["a", "b", "c", "d"]) == "a - 2 b + d"
    assert _combination(np.array([1e-10, -3.0, 1.5]), ["a", "b", "c"]) == "b - 0.5 c"


# -- the fibre ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("phi", "order", "plus", "minus"),
    [
        (y**2 / 2, 2, 0.5, 0.5),
        (-3 * y**3, 3, -3.0, 3.0),
        (y**2 + 7 * y**3, 2, 1.0, 1.0),
        (-y * sp.Abs(y), 2, -1.0, 1.0),
        (y**4 - y**5, 4, 1.0, 1.0),
    ],
)
def test_the_order_along_the_fibre_and_its_sides(phi: sp.Expr, order: int, plus: float, minus: float) -> None:
    # Beside a regular direction that bends: u = x + y^2, whose share of phi is taken out again.
    system = SlowFastSystem(
        slow={x: sp.Integer(1)}, fast={y: phi + (u - y**2 - x) * y, u: -u + y**2 + x}, epsilon=eps
    )
    problem = LayerProblem(system, (x,), {})
    e = np.array([[1.0], [0.0]])
    found = order_along(problem, np.zeros(3), e, e, width=0.1, typical=1.0)
    assert found is not None
    assert not found.vanishes
    assert found.order == order
    assert (found.plus, found.minus) == pytest.approx((plus, minus), rel=0.02)
    assert found.attracts == (plus < 0, minus > 0)
    assert found.at(0.5) == pytest.approx(max(abs(found.plus), abs(found.minus)) * 0.5**order)
    value = bifurcation_function(problem, np.zeros(3), e, e, np.array([0.05]))
    assert value == pytest.approx([float(phi.subs(y, 0.05))], rel=1e-9)


def test_a_fibre_of_equilibria_vanishes_and_scales_do_not_matter_to_the_order() -> None:
    flat = LayerProblem(SlowFastSystem(slow={x: y}, fast={y: x * y}, epsilon=eps), (x,), {})
    e = np.ones((1, 1))
    found = order_along(flat, np.zeros(2), e, e, width=0.1, typical=1.0)
    assert found == FibreOrder(0.0, 0.0, 0.0, True)
    small = LayerProblem(
        SlowFastSystem(slow={x: y}, fast={y: sp.Rational(1, 10**8) * y**2}, epsilon=eps), (x,), {}
    )
    assert order_along(small, np.zeros(2), e, e, width=0.1, typical=1e-8).order == 2
    # Where the left vector points the other way, phi is still measured along the right one.
    turned = order_along(small, np.zeros(2), e, -e, width=0.1, typical=1e-8)
    assert turned.plus == pytest.approx(1e-8)


# -- zeros and parts ---------------------------------------------------------------------------------


@pytest.mark.parametrize("sparse", [False, True])
def test_the_nearest_zero_in_the_units_given_is_found(sparse: bool) -> None:
    def line(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([z[0] + 2 * z[1] - 5.0]), np.array([[1.0, 2.0]])

    assert gauss_newton(line, np.zeros(2), sparse=sparse) == pytest.approx([1.0, 2.0])
    # In units of (1, 100) a step along the second costs a hundredth.
    found = gauss_newton(line, np.zeros(2), sparse=sparse, scales=np.array([1.0, 100.0]))
    assert found == pytest.approx([5 / 40001, 2.5 * 40000 / 40001])


def test_a_search_without_a_zero_or_off_the_domain_ends_with_none() -> None:
    assert gauss_newton(lambda z: (z**2 + 1.0, 2 * z[:, None]), np.array([1.0])) is None
    assert (
        gauss_newton(lambda z: (np.log(z) if z > 0 else z * np.nan, 1 / z[:, None]), np.array([-1.0])) is None
    )
    # A multiple zero is approached by halves.
    assert gauss_newton(lambda z: (z**2, 2 * z[:, None]), np.array([1.0])) == pytest.approx([0.0], abs=1e-5)
    # Steps are at most half as long as one and the start together.
    visited = []

    def steep(z: np.ndarray):
        visited.append(float(z[0]))
        return z - 1000.0, np.ones((1, 1))

    assert gauss_newton(steep, np.array([3.0]), steps=5) is None
    assert np.diff(visited[:4]) == pytest.approx(2.0)


def test_searches_side_by_side_end_each_on_its_own() -> None:
    asked = []

    def evaluate(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(len(z))
        return np.log(z) * (z - 3.0), (np.log(z) + (z - 3.0) / z)[:, :, None]

    with np.errstate(invalid="ignore"):
        found = gauss_newton_at_each(evaluate, np.array([[1.0], [2.9], [-1.0], [0.9]]))
    assert found[2] is None
    ends = [point for point in found if point is not None]
    np.testing.assert_allclose(np.ravel(ends), [1.0, 3.0, 1.0], rtol=1e-12)
    # Who has arrived, or is lost, is asked no more.
    assert asked[:2] == [4, 2]
    assert len(asked) < 12


def test_the_type_is_told_by_how_many_are_unstable() -> None:
    assert [kind_of(k, 2) for k in (0, 1, 2)] == [Kind.ATTRACTING, Kind.SADDLE, Kind.REPELLING]
    assert kind_of(1, 1) is Kind.REPELLING


def loss(crossing: Contact = Contact.ZERO, **point: float) -> Loss:
    return Loss(point, 0j, crossing, LossKind.FOLD, "test", 0.0)


def test_parts_end_a_margin_before_losses_and_on_the_edges_without() -> None:
    (branch,) = solve_critical(SlowFastSystem(slow={x: y}, fast={y: x - y}, epsilon=eps)).branches
    region = {"x": (0.0, 10.0)}
    parts = list(_parts(branch, region, [loss(x=2.0), loss(x=6.0)]))
    # The longest first: (6, 10), (2, 6), (0, 2), of which ends at losses keep off them.
    expected = [(6 + 4 * MARGIN, 10.0), (2 + 4 * MARGIN, 6 - 4 * MARGIN), (0.0, 2 - 2 * MARGIN)]
    assert parts == [("x", pytest.approx(part)) for part in expected]
    # Too little to be worth naming, nothing at all, and a whole region without a loss.
    assert list(_parts(branch, region, [loss(x=0.1), loss(x=9.95)])) == [("x", pytest.approx((0.297, 9.753)))]
    assert list(_parts(branch, region, [])) == []
    everywhere = loss(Contact.PAIR_EVERYWHERE, x=5.0)
    assert everywhere.crossing.is_everywhere
    assert list(_parts(branch, region, [everywhere])) == []
    wide = Loss({"x": 5.0}, 0j, Contact.ZERO, LossKind.FOLD, "test", 0.0, extent={"x": (1.0, 6.0)})
    assert [part for _, part in _parts(branch, region, [wide])] == [
        pytest.approx((6 + 4 * MARGIN, 10.0)), pytest.approx((0.0, 1 - MARGIN)),
    ]  # fmt: skip


def test_the_longest_part_that_holds_is_named_and_an_attracting_one_of_half_its_length_before_it() -> None:
    (branch,) = solve_critical(SlowFastSystem(slow={x: y}, fast={y: x - y}, epsilon=eps)).branches
    region = {"x": (0.0, 10.0)}

    class Verdict:
        def __init__(self, holds: bool, kind: str) -> None:
            self.holds, self.kind = holds, kind

    def chosen(left: str, right: str, at: float = 6.0):
        def judge(_, *, region):
            kind = left if region["x"][0] < at else right
            return Verdict(kind != "lost", kind)

        found = largest_sub_region(branch, region, [loss(x=at)], judge=judge)
        return None if found is None else (found.kind, found.interval[0] == 0.0)

    assert chosen("attracting", "attracting") == ("attracting", True)
    assert chosen("repelling", "attracting") == ("attracting", False)
    assert chosen("repelling", "saddle") == ("repelling", True)
    assert chosen("lost", "repelling") == ("repelling", False)
    assert chosen("lost", "lost") is None
    # An attracting part of less than half the length is not preferred.
    assert chosen("repelling", "attracting", at=7.0) == ("repelling", True)
