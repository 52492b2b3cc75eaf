"""Combinations of states that are fast together: the simplest that are within what the gap between the rates tells."""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.reductions.fast_directions import _simplest_between, fast_directions
from gsp.reductions.reductions import find_reductions
from gsp.systems.system import VectorField

R, ONE = sp.Rational, sp.Integer(1)


def chain(masses: list[sp.Expr]) -> VectorField:
    """Masses on a line, joined by stiff springs and dampers, the first in a shallow well."""
    n = len(masses)
    x, v = (sp.symbols([f"{letter}{i}" for i in range(1, n + 1)]) for letter in "xv")
    pull = [2500 * (b - a) + 90 * (d - c) for a, b, c, d in zip(x, x[1:], v, v[1:])]
    force = [-sp.sin(x[0]) - v[0] / 5, *[R(0)] * (n - 1)]
    rates = {}
    for i in range(n):
        rates[x[i]] = v[i]
        here = (pull[i] if i < n - 1 else 0) - (pull[i - 1] if i else 0)
        rates[v[i]] = (force[i] + here) / masses[i]
    return VectorField(rates)


def scene_of(field: VectorField) -> gsp.Scene:
    start = {s.name: 1.0 if s.name.startswith("x") else 0.0 for s in field.states}
    region = dict.fromkeys(start, (-2.0, 2.0))
    return gsp.Scene(field, region, start, (0, 10), tolerance=1e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("masses", [[R(1), R(1, 2)], [R(1), R(2), R(1)], [R(1), R(3, 2), R(1, 2), R(2)]])
def test_masses_that_are_joined_stiffly_move_as_one(masses: list[sp.Expr]) -> None:
    """What stays is the centre of mass and its velocity: within 1/gap, and to the tolerance when it is run."""
    found = find_reductions(scene_of(chain(masses)))
    best = found.recommended
    assert best is not None
    assert best.name.startswith("quasi-steady state along")
    study = found.study
    assert study is not None
    assert len(study.system.x) == 2
    for name, letter in zip(study.system.x, "xv"):
        total = study.splitting.coordinates[name]
        numbers = [sp.diff(total, sp.Symbol(f"{letter}{i}")) for i in range(1, len(masses) + 1)]
        weights = np.array([float(n / numbers[0] / (m / masses[0])) for n, m in zip(numbers, masses)])
        assert np.abs(weights - 1.0).max() < 0.05
    assert best.error <= 1e-3


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("order", "length", "speed"),
    [([5, 4, 3, 2, 1, 0], 4, 6), ([0, 5, 3, 4, 2, 1], -3, 3), (range(6), 2, -3)],
)
def test_masses_move_as_one_in_any_order_and_in_other_units(order, length: int, speed: int) -> None:
    """A slow variable given by differences of positions times the stiffness ran in 78 steps, or to no end."""
    field = chain([R(1), R(2), R(1)])
    units = {s: sp.Integer(10) ** (length if s.name.startswith("x") else speed) for s in field.states}
    inner = {s: s * unit for s, unit in units.items()}
    states = [field.states[k] for k in order]
    other = VectorField({s: field.equations[s].xreplace(inner) / units[s] for s in states})
    plain = scene_of(field)
    start = {s.name: float(plain.start[s.name] / units[s]) for s in states}
    region = {s.name: tuple(float(end / units[s]) for end in plain.region[s.name]) for s in states}
    found = find_reductions(gsp.Scene(other, region, start, plain.span, tolerance=1e-3))
    assert found.recommended is not None
    assert found.recommended.name.startswith("quasi-steady state along")


def test_the_directions_are_those_of_the_masses() -> None:
    (part,) = fast_directions(chain([R(1), R(1, 2)]), np.zeros(4), 2, 80.0)
    assert set(map(frozenset, (d.items() for d in part.directions))) == {
        frozenset({(sp.Symbol(f"{s}1"), R(-1, 2)), (sp.Symbol(f"{s}2"), R(1))}) for s in "xv"
    }


@pytest.mark.parametrize("powers", [(3, 0, -3, 0), (-2, 2, 3, -3), (0, 4, 0, -5)])
def test_in_other_units_of_each_state_the_directions_are_the_same_within_the_gap(powers) -> None:
    field = chain([R(1), R(3, 7)])
    units = {s: sp.Integer(10) ** power for s, power in zip(field.states, powers)}
    scaled = {s: s * unit for s, unit in units.items()}
    other = VectorField({s: rate.xreplace(scaled) / units[s] for s, rate in field.equations.items()})
    spans = []
    for of, sizes in ((field, dict.fromkeys(field.states, ONE)), (other, units)):
        (part,) = fast_directions(of, np.zeros(4), 2, 80.0)
        N = np.array([[float(d.get(s, 0) * sizes[s]) for d in part.directions] for s in field.states])
        # Velocities in units of lengths times the rate of the joint, so that all parts count.
        spans.append(np.linalg.qr(N / np.array([[1.0], [50.0], [1.0], [50.0]]))[0])
    first, second = spans
    assert np.linalg.norm(second - first @ (first.T @ second), 2) < 4.0 / 80.0


def test_of_the_numbers_between_two_that_of_the_least_denominator_is_taken() -> None:
    rng = np.random.default_rng(0)
    for middle, width in zip(rng.normal(size=200).tolist(), rng.exponential(0.02, size=200).tolist()):
        low, high = Fraction(middle) - Fraction(width), Fraction(middle) + Fraction(width)
        found = _simplest_between(low, high)
        assert low <= found <= high
        for denominator in range(1, found.denominator):
            assert math.ceil(low * denominator) > high * denominator


@pytest.mark.exhaustive
def test_a_gap_is_that_over_half_of_the_span_and_not_of_the_steps() -> None:
    """Most steps of a motor on a stiff shaft lie in its first moments, when friction is as fast as the shaft."""
    i, w, th, ph, q = sp.symbols("i w th ph q")
    shaft = 5000 * (th - ph) + 120 * (w - q)
    field = VectorField(
        {
            i: 500 * (12 - R(3, 2) * i - R(3, 5) * w),
            w: (R(3, 5) * i - shaft - w / 20) * R(5, 4),
            th: w,
            ph: q,
            q: (shaft - R(3, 10) * q - 2 * sp.tanh(10 * q)) * R(5, 6),
        }
    )
    start = dict.fromkeys(["i", "w", "th", "ph", "q"], 0.0)
    region = {"i": (-1, 10), "w": (-1, 6), "th": (-1, 15), "ph": (-1, 15), "q": (-1, 6)}
    found = find_reductions(gsp.Scene(field, region, start, (0, 5), tolerance=1e-3))
    assert found.recommended is not None
    assert found.recommended.name == "quasi-steady state along i, -2*q/3 + w, -2*ph/3 + th"


def test_what_is_conserved_is_so_along_the_directions() -> None:
    """Beside the substrate the enzyme is little: to the gap alone it stayed free while the complex formed."""
    S, E, C, P = states = sp.symbols("S E C P")
    binding = 10 * S * E - 5 * C
    field = VectorField({S: -binding, E: 10 * C - binding, C: binding - 10 * C, P: 10 * C})
    (part,) = fast_directions(field, np.array([1e-6, 0.01, 1e-8, 1.0]), 1, 200.0)
    (direction,) = part.directions
    moved = [direction.get(s, 0) for s in states]
    assert moved[1] + moved[2] == 0
    assert moved[0] + moved[2] + moved[3] == 0
    # S is replaced by C at the share 5/15 and P made at 10/15, to the gap.
    assert [float(m / direction[C]) for m in moved] == pytest.approx([-1 / 3, -1, 1, -2 / 3], abs=0.01)
