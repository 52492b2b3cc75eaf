"""What segments of orbits are made of: interpolants exact for polynomials, and tracks that end before a fold."""

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.slow.orbit_segments import SCHEME, SegmentSolver
from gsp.slow.slow_track import LEFT, _least_norms, follow_slow_flow
from gsp.systems.system import SlowFastSystem
from tests.example_systems import epsilon, x, y


@pytest.fixture(scope="module")
def solver() -> SegmentSolver:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y}, epsilon=epsilon)
    return SegmentSolver(solve_critical(system).branches[0], epsilon=0.1, unstable=0, tolerance=1e-10)


def test_an_element_in_halves_has_the_same_polynomial(solver: SegmentSolver) -> None:
    places = np.append(0.0, SCHEME.c)
    for degree in range(len(places)):
        values = solver.halving @ (1.0 + places) ** degree
        halves = np.concatenate([SCHEME.c / 2, [0.5], 0.5 + SCHEME.c / 2])
        assert values == pytest.approx((1.0 + halves) ** degree, rel=1e-12)


def test_guesses_inside_an_element_are_exact_for_a_cubic(solver: SegmentSolver) -> None:
    def curve(t):
        return np.stack([1 - 2 * t + 3 * t**2 - 4 * t**3, 5 * t**3 - t], axis=-1)

    def slope(t):
        return np.stack([-2 + 6 * t - 12 * t**2, 15 * t**2 - 1], axis=-1)

    ends, lengths = np.array([[0.5, 0.75, 2.0]]), np.array([[0.25, 1.25]])
    inside = ends[:, :-1, None] + lengths[:, :, None] * SCHEME.c
    assert solver._stages(lengths, curve(ends), slope(ends)) == pytest.approx(curve(inside), rel=1e-12)


def test_a_track_that_is_cut_at_a_fold_ends_where_what_is_felt_of_it_is_least() -> None:
    # On y = -sqrt(x) of x' = 1, epsilon y' = y^2 - x the decay from x_0 back to x is 4/3 (x_0^(3/2) - x^(3/2))/epsilon;
    # the drift epsilon/(4 x) is infinite at the fold, x = 0, which is upstream.
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: y**2 - x}, epsilon=epsilon)
    branch = solve_critical(system).nearest({"x": 1.0, "y": -1.0})
    value, first = 0.01, 0.5
    track = follow_slow_flow(
        branch,
        np.array([[first]]),
        np.array([[-(first**0.5)]]),
        epsilon=value,
        goal=np.array([400.0]),
        side=LEFT,
        unstable=0,
    )
    assert track.is_cut_short[0]
    last = track.states[0, track.counts[0], 0]
    decay = 4 / 3 * (first**1.5 - last**1.5) / value
    assert track.decayed[0] == pytest.approx(decay, rel=0.2)
    assert track.drift[0] == pytest.approx(value / (4 * last), rel=1e-6)
    # -ln x - decay is least where x^(3/2) = epsilon/2, and the steps are as long as that.
    assert 0.25 < last / (value / 2) ** (2 / 3) < 4


@pytest.mark.exhaustive
def test_segments_of_the_reversed_flow_are_the_same_and_so_are_their_errors() -> None:
    # With time reversed the stable direction is unstable, and what was fixed upstream is fixed downstream.
    places = np.array([[0.1], [0.25]])
    found = []
    for sign, unstable in ((1, 0), (-1, 1)):
        system = SlowFastSystem(slow={x: sp.Integer(sign)}, fast={y: sign * (y**2 - x)}, epsilon=epsilon)
        branch = solve_critical(system).nearest({"x": 1.0, "y": -1.0})
        found.append(
            SegmentSolver(branch, epsilon=0.01, unstable=unstable, tolerance=1e-8).solve(places, -(places**0.5))
        )
    forward, backward = found
    # Next to the fold the segment is cut short, and its end is felt.
    assert forward.is_cut_short.all()
    assert backward.is_cut_short.all()
    assert forward.selection[0] > 1e3 * forward.selection[1] > 0
    np.testing.assert_allclose(backward.y, forward.y, rtol=1e-9)
    np.testing.assert_allclose(backward.selection, forward.selection, rtol=1e-3)
    np.testing.assert_allclose(backward.discretisation, forward.discretisation, rtol=0.1, atol=1e-13)
    np.testing.assert_allclose(backward.ends, forward.ends, rtol=1e-6)


@pytest.mark.parametrize("c", [1e-3, 0.7, 1e3])
def test_elements_are_as_long_in_any_units(c: float) -> None:
    """An oscillator of frequency 1, whose rates have the size of its units: five powers of e go on each element."""
    u, v = sp.symbols("u v")
    number = sp.Rational(c).limit_denominator()
    system = SlowFastSystem(slow={u: number * v, v: -u / number}, fast={y: u - y}, epsilon=epsilon)
    track = follow_slow_flow(
        solve_critical(system).branches[0],
        np.array([[c, 1.0]]),
        np.array([[c]]),
        epsilon=0.01,
        goal=np.array([20.0]),
        side=LEFT,
        unstable=0,
    )
    assert track.decayed[0] >= 20.0
    assert track.lengths[0, :4] == pytest.approx(0.05, rel=1e-6)


def test_a_norm_in_no_units_is_the_least_of_all() -> None:
    rng = np.random.default_rng(3)
    plain = rng.normal(size=(40, 3, 3))
    units = 10.0 ** rng.uniform(-6, 6, (40, 3))
    least = _least_norms(plain)
    assert _least_norms(plain * units[:, :, None] / units[:, None, :]) == pytest.approx(least, rel=1e-2)
    eigenvalues = np.linalg.eigvals(plain)
    assert (least >= np.sqrt((np.abs(eigenvalues) ** 2).sum(axis=1)) * (1 - 1e-12)).all()
    assert (least <= np.linalg.norm(plain, axis=(1, 2)) * (1 + 1e-12)).all()
    # What is driven and drives nothing adds nothing; two that drive one another count by their product.
    driven = np.array([[[-1.0, 1e6], [0.0, -2.0]], [[-1.0, 0.0], [1e-6, -2.0]], [[0.0, 1e5], [-1e-5, 0.0]]])
    assert _least_norms(driven) == pytest.approx([5**0.5, 5**0.5, 2**0.5], rel=1e-6)
    assert _least_norms(np.array([[[-3.0]]])) == pytest.approx([3.0])
