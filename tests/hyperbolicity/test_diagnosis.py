"""What names of losses are decided by: derivatives at a point, extents along fibres, jumps, and rates far apart."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses.consequences import JUMP
from gsp.hyperbolicity.losses.diagnosis import EDGE, Diagnosis
from gsp.hyperbolicity.losses.examination import _spread_rates
from gsp.hyperbolicity.losses.kinds import Contact
from gsp.hyperbolicity.losses.switching import _jumps
from gsp.systems.system import SlowFastSystem

u, x, y, a, eps = sp.symbols("u x y a epsilon")
FAST = {x: u**2 - 2 * x + a * y**2 / 2 + 3 * eps * u * y, y: u - 3 * y + x * y - 5 * eps * x**2}


def diagnosis(samples: np.ndarray, box: dict, *, slow: sp.Expr = u * y, fast: dict | None = None) -> Diagnosis:
    system = SlowFastSystem(
        slow={u: slow}, fast=fast or FAST, epsilon=eps, parameters={a: 4} if fast is None else {}
    )
    return Diagnosis(Sampler(solve_critical(system).branches[0]), box, 5.0, samples)


SAMPLES = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, -0.25], [2.0, -1.5, 1.0], [3.0, np.nan, 9.0]])
BOX = {"u": (0.0, 4.0)}


def test_derivatives_at_a_point_are_those_of_the_limit_and_of_the_first_order() -> None:
    own = diagnosis(SAMPLES, BOX)
    local = own.local(np.array([1.0, 0.5, -0.25]))
    # g = (u^2 - 2 x + 2 y^2, u - 3 y + x y), g_1 = (3 u y, -5 x^2), f = u y.
    assert local.A.tolist() == [[-2.0, -1.0], [-0.25, -2.5]]
    assert local.g_x.tolist() == [[2.0], [1.0]]
    assert local.g_yy.tolist() == [[[0.0, 0.0], [0.0, 4.0]], [[0.0, 1.0], [1.0, 0.0]]]
    assert local.second[0][0].tolist() == [2.0, 0.0, 0.0]
    assert not local.third.values.any()
    assert local.slow == pytest.approx([-0.25])
    assert local.push == pytest.approx([-0.75, -1.25])
    assert local.is_finite
    assert own.push_jacobian(np.array([1.0, 0.5, -0.25])) == pytest.approx(np.array([[0.0, 3.0], [-5.0, 0.0]]))
    assert own.widths.tolist() == [4.0]
    # The largest of |u y| where it is a number.
    assert own.fastest == pytest.approx([27.0])


def test_the_extent_along_a_fibre_is_that_of_the_branch_or_of_the_bounds() -> None:
    own = diagnosis(SAMPLES, BOX)
    left = np.array([1.0, -2.0])
    # x - 2 y is 0, 1 and -3.5 on the samples that are finite.
    assert own.extent(np.zeros(3), left) == pytest.approx(3.5)
    assert own.extent(np.array([0.0, 0.5, -0.25]), left) == pytest.approx(4.5)
    assert own.spread(left) == pytest.approx(2.0 + 2 * 1.25)
    flat = np.array([[0.0, 1.0, 2.0], [1.0, 1.0, 2.0]])
    assert diagnosis(flat, BOX).spread(left) == 0.0
    assert diagnosis(flat, BOX).extent(np.array([0.0, 1.0, 2.0]), left) == 0.0
    bounded = diagnosis(flat, {**BOX, "x": (0.0, 3.0), "y": (-1.0, 1.0)})
    assert bounded.extent(np.array([0.0, 1.0, 2.0]), left) == pytest.approx(3.0 + 2 * 2.0)
    half = diagnosis(flat, {**BOX, "x": (0.0, 3.0)})
    assert half.extent(np.array([0.0, 1.0, 2.0]), left) == 0.0
    # Rounding in the samples is no extent.
    noisy = diagnosis(flat + np.array([[0, 0, 0], [0, 1e-12, 0]]), BOX)
    assert noisy.spread(np.array([1.0, 0.0])) == 0.0
    assert diagnosis(np.full((2, 3), np.nan), BOX).spread(left) == 0.0


def test_a_loss_has_the_eigenvalue_nearest_to_the_axis_as_it_touches_it() -> None:
    # -1/10 and -1/100 +- 3i: the real one is nearer to 0, the pair nearer to the axis.
    z = sp.Symbol("z")
    fast = {x: u - x / 10, y: -y / 100 - 3 * z, z: 3 * y - z / 100}
    own = diagnosis(np.zeros((2, 4)), {"u": (0.0, 2.0), "z": (-1.0, 1.0)}, slow=sp.Integer(1), fast=fast)

    def loss(crossing: Contact, at: float = 1.0, other: float = 0.0):
        point = np.array([at, 0.0, 0.0, other])
        return own.loss(
            point, crossing, LossKind.NON_SMOOTH, "test", 2.0, JUMP, coefficients={"c": 1.0}, note="so"
        )

    assert loss(Contact.ZERO).eigenvalue == pytest.approx(-0.1)
    assert loss(Contact.PAIR).eigenvalue.real == pytest.approx(-0.01)
    assert loss(Contact.PAIR_EVERYWHERE).eigenvalue.real == pytest.approx(-0.01)
    found = loss(Contact.ZERO)
    assert (found.consequence, found.may_reduce, found.remedy) == tuple(JUMP)
    assert (found.point["u"], found.value, dict(found.coefficients), found.note) == (1.0, 2.0, {"c": 1.0}, "so")
    edges = {0.0: True, EDGE: True, 4 * EDGE: False, 1.0: False, 2.0 - EDGE: True, 2.0 - 4 * EDGE: False}
    assert {at: loss(Contact.ZERO, at).on_edge for at in edges} == edges
    assert loss(Contact.ZERO, 1.0, -1.0).on_edge
    assert not loss(Contact.PAIR_EVERYWHERE, 0.0).on_edge


@pytest.mark.parametrize(
    ("rate", "jump", "kink"),
    [
        (u - 2 * y, 0.0, 0.0),
        (u - 2 * y + 3 * sp.sign(y), 6.0, 0.0),
        (u - 2 * y + 3 * sp.Abs(y), 0.0, 6.0),
        (u - 2 * y + y * sp.Abs(y), 0.0, 0.0),
    ],
)
def test_jumps_are_told_from_what_smoothness_explains(rate: sp.Expr, jump: float, kink: float) -> None:
    own = diagnosis(np.zeros((2, 2)), {"u": (-1.0, 1.0)}, slow=sp.Integer(1), fast={y: rate})
    step = np.array([0.0, 1e-6])
    assert _jumps(own, -step, step) == pytest.approx((jump, kink), abs=1e-5)
    assert _jumps(own, -step, step * np.nan) == (0.0, 0.0)


def test_rates_further_apart_than_epsilon_are_noted_with_what_the_slowest_is_beside() -> None:
    values = np.array([[-1.0, -200.0], [-2.0, -100.0]], dtype=complex)
    z = np.zeros((2, 1))

    def notes(epsilon: float | None, rate: float, eigenvalues: np.ndarray = values) -> list[str]:
        sampler = SimpleNamespace(tangential_rate=lambda _: rate)
        return _spread_rates(sampler, z, eigenvalues, epsilon)  # pyright: ignore[reportArgumentType]

    # The ratio is 1/200; the slowest rate in slow time is 1/epsilon = 100.
    assert notes(0.004, 0.0) == []
    assert notes(None, 0.0) == []
    assert notes(1.0, 0.0) == []
    assert notes(0.01, 0.0, values[:, :1]) == []
    assert notes(0.01, 0.0, np.array([[0.0, -1.0]], dtype=complex)) == []
    (slow,), (fast,) = notes(0.01, 100.0), notes(0.01, 99.0)
    assert slow.startswith(
        "the fast rates differ by a factor 200, more than 1/epsilon = 100: at this epsilon the slowest"
    )
    assert "three time scales, and the slowest fast direction is still faster" in fast
    assert notes(0.005, 0.0) != []
