"""Elimination takes apart what was put together, says of each part what it is, and tells what has no real point."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import pytest
import sympy as sp

from gsp.critical import elimination
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.elimination import (
    Pieces,
    _has_no_zero,
    _has_sign,
    _is_nowhere_positive,
    _linear_step,
    _never_real,
    _quadratic,
    _square_root,
    _stays_small,
    _undefined,
    pieces,
)
from gsp.systems.system import SlowFastSystem

x, y, z, w, s, a, eps = sp.symbols("x y z w s a epsilon")
R = sp.Rational
ORDERS = list(itertools.permutations(range(3)))


PLACES = [{x: R(2, 7), a: 2}, {x: R(-5, 3), a: 2}]


def system(*fast: sp.Expr, names: tuple = (y, z, w)) -> SlowFastSystem:
    parameters = {a: R(2)} if any(e.has(a) for e in fast) else {}
    return SlowFastSystem(
        slow={x: sp.Integer(1)}, fast=dict(zip(names, fast)), epsilon=eps, parameters=parameters
    )


def values(heights: Iterable[sp.Expr]) -> tuple[sp.Expr, ...]:
    """Heights at two places, exactly."""
    return tuple(sp.sympify(h).subs(at) for h in heights for at in PLACES)


def graphs(found: Pieces) -> list[tuple[sp.Expr, ...]]:
    return sorted(
        values(graph[s] for s in sorted(graph, key=str)) for _, graph in found.solved if graph is not None
    )


# Heights of one fast variable: all of them are found, each once, whatever the product is multiplied out to.
HEIGHTS = [[x], [x, -x], [x, 2 - x, x**2], [R(0), x / 3, x**3 - 1], [1 / (1 + x**2), x], [a * x, x / a]]


@pytest.mark.exhaustive
@pytest.mark.parametrize("heights", HEIGHTS, ids=str)
@pytest.mark.parametrize("expanded", [False, True])
def test_the_heights_that_were_multiplied_are_found(heights: list[sp.Expr], expanded: bool) -> None:
    product = sp.prod([sp.numer(sp.together(y - h)) for h in heights])
    found = pieces(system((sp.expand(product) if expanded else product) + eps * x * y))
    assert graphs(found) == sorted(values([h]) for h in heights)
    assert not found.unsolved
    for equations, graph in found.solved:
        assert graph is not None
        assert not any(v for e in equations for v in values([e.subs(y, graph[y])]))


@pytest.mark.parametrize(
    ("rate", "middle", "square"),
    [
        (y**2 + 2 * x * y - 1, -x, x**2 + 1),
        (3 * y**2 - x * y - 2, x / 6, (x**2 + 24) / 36),
        (a * y**2 - y - 4, R(1, 4), R(33, 16)),
    ],
    ids=str,
)
def test_both_heights_of_a_quadratic_are_found(rate: sp.Expr, middle: sp.Expr, square: sp.Expr) -> None:
    found = pieces(system(rate))
    heights = [graph[y] for _, graph in found.solved if graph is not None]
    one, two = heights
    for at in PLACES:
        assert sp.expand((one + two).subs(at)) == 2 * middle.subs(at)
        assert sp.expand(((one - two) ** 2).subs(at)) == 4 * square.subs(at)
    assert [e for (e,), _ in found.solved] == [y - height for height in heights]


@pytest.mark.parametrize("order", ORDERS, ids=str)
def test_equations_that_lean_on_one_another_are_solved_in_any_order(order: tuple[int, ...]) -> None:
    # y = x or 1 - x; z = y^2 - x; w from a coefficient that depends on x.
    rates = [(y - x) * (y - 1 + x), z - y**2 + x, (1 + x**2) * w - z * y]
    names = (y, z, w)
    turned = system(*(rates[k] for k in order), names=tuple(names[k] for k in order))
    found = pieces(turned)
    # w, y and z.
    known = [((h**2 - x) * h / (1 + x**2), h, h**2 - x) for h in (x, 1 - x)]
    assert graphs(found) == sorted(map(values, known))
    assert not found.unsolved


def test_what_is_no_graph_over_the_slow_variables_is_kept_beside_what_is() -> None:
    # A vertical piece, a piece of one dimension more, and one without a real point.
    found = pieces(system((x - 3) * (y - x) * (y**2 + 1)))
    assert graphs(found) == [values([x])]
    assert found.unsolved == [x - 3]
    assert found.vanished == [y**2 + 1]
    found = pieces(system((y - z) * (y - 3), (y - z) * (z - 4 * x)))
    assert graphs(found) == [values([3, 4 * x])]
    assert [e.equals(y - z) or e.equals(z - y) for e in found.unsolved] == [True]
    found = pieces(system((y - z) * (y - 3), (z - y) * (z - 4 * x)))
    assert graphs(found) == [values([3, 4 * x])]
    found = pieces(system(y**2 + x**2 + 1))
    assert not found.solved
    assert found.vanished
    found = pieces(system(y**6 + x**2 * y**4 + 1))
    assert not found.solved
    assert found.vanished
    # One equation of two: a line of zeros over each x.
    found = pieces(system(y + z - x, 2 * y + 2 * z - 2 * x))
    assert not found.solved
    assert len(found.unsolved) == 1
    # No zero at all.
    found = pieces(system(y + z - x, y + z - x - 1))
    assert not found.solved
    assert not found.unsolved
    # Over x = 0 only.
    found = pieces(system(y + z - x, y + z + x))
    assert not found.solved
    (left,) = found.unsolved
    assert [e.subs({x: 0, y: 3, z: -3}) for e in left] == [0] * len(left)
    assert any(e.subs({x: 1, y: 3, z: -3}) for e in left)


@pytest.mark.parametrize("rate", [y**3 + y - x, y**5 - y - x, y * sp.exp(y) + sp.sin(y) - x])
def test_what_has_no_formula_stays_an_equation(rate: sp.Expr) -> None:
    ((equations, graph),) = pieces(system(rate)).solved
    assert graph is None
    assert sp.simplify(equations[0] / rate).is_number


@pytest.mark.parametrize(
    ("rate", "height"),
    [(sp.exp(y) - 2 - x**2, sp.log(x**2 + 2)), (sp.tanh(y - x) - R(1, 2), x + sp.atanh(R(1, 2)))],
)
def test_one_inverse_is_a_formula(rate: sp.Expr, height: sp.Expr) -> None:
    ((_, graph),) = pieces(system(rate)).solved
    assert graph is not None
    assert float((graph[y] - height).subs(x, R(1, 3))) == pytest.approx(0.0, abs=1e-12)


QUADRATICS = [
    (R(1), -2 * x, -R(1)),
    (R(-3), x, R(2)),
    (a, x, -R(5)),
    (x, R(3), -x),
    (x, R(-3), -x),
    (1 + x**2, a, -x),
    (a - 2, R(3), -x),
]


@pytest.mark.parametrize("row", QUADRATICS, ids=str)
def test_both_roots_of_a_quadratic_satisfy_it_and_stay_finite(row: tuple[sp.Expr, ...]) -> None:
    top, middle, last = row
    roots = _quadratic(row, sp.expand(middle**2 - 4 * top * last), system(a * y - x))
    assert roots is not None
    for place in (R(2, 7), R(0)) if top.has(x) else (R(2, 7),):
        at = {x: place, a: 2}
        found = [complex(root.subs(at)) for root in roots[-1 if not place else 0 :]]
        coefficients = [complex(sp.sympify(e).subs(at)) for e in row]
        for value in found:
            assert abs(sum(c * value**k for k, c in zip((2, 1, 0), coefficients))) < 1e-12
        # One root goes through where the first coefficient vanishes, and is alone where it vanishes everywhere.
        assert len(found) == (1 if top == a - 2 or not place else 2)
        assert len(found) == 1 or abs(found[0] - found[1]) > 1e-3


def test_a_quadratic_without_a_sign_has_no_formula() -> None:
    of = system(a * y - x)
    assert _quadratic((x, x - 1, R(1)), (x - 1) ** 2 - 4 * x, of) is None
    assert _quadratic((x, a - 2, R(1)), (a - 2) ** 2 - 4 * x, of) is None


@pytest.mark.parametrize(
    "root", [x, x * (x - 1) ** 2, (1 + x**2) ** 3 * 4, x**5 * 9 / (x + 1) ** 2, R(2) * x**2]
)
def test_a_square_root_is_smooth_where_even_powers_vanish(root: sp.Expr) -> None:
    found = _square_root(sp.expand(sp.numer(root)))
    assert sp.expand(found**2 - sp.numer(root)) == 0
    inside = [piece.base for piece in found.atoms(sp.Pow) if piece.exp == R(1, 2)]
    assert all(power == 1 for piece in inside for _, power in sp.factor_list(piece)[1])


SIGNS = [
    # Visibly without a real zero, visibly never positive.
    (x**2 + 1, True, False),
    (-(x**2) - y**4 - 3, True, True),
    (x**2 + y**2, False, False),
    (-(x**2) - y**2, False, True),
    (x**2 - 1, False, False),
    (x**2 + x + 1, True, False),
    (-(x**2) - x - 1, True, True),
    (x**3 + 1, False, False),
    (-(x**2) + x, False, False),
    (sp.Integer(3), True, False),
    (sp.Integer(-3), True, True),
    (a * x**2 + 1, True, False),
    ((1 - a) * x**2 - 1, True, True),
    (sp.sin(x) + 3, False, False),
    (1 / (1 + x**2), True, False),
    (sp.cosh(x / 8 + y), True, False),
    (sp.exp(x) + a * sp.exp(y), True, False),
    (sp.exp(x) - 1, False, False),
    (x + x**2 * y**2 + 9, False, False),
    (x**2 / 3 + R(1, 7), True, False),
    (-x, False, False),
    (-(x**2) * (x - 1) ** 2 - 1, True, True),
]


@pytest.mark.parametrize(("expression", "nowhere", "never"), SIGNS, ids=str)
def test_signs_that_can_be_seen_are_told(expression: sp.Expr, nowhere: bool, never: bool) -> None:
    of = system(a * y - x)
    assert bool(_has_no_zero(sp.expand(expression), of)) is nowhere
    assert bool(_is_nowhere_positive(sp.expand(expression), of)) is never


def test_a_sign_is_that_of_every_term() -> None:
    for terms, sign, said in (
        (x**2 + y**4, 1, True),
        (x**2 + y**4, -1, False),
        (-(x**2) - 1, -1, True),
        (x**2 + y, 1, False),
        (x**2 - 1, 1, False),
    ):
        assert bool(_has_sign(sp.Poly(terms, x, y), sign)) is said


def test_the_coefficient_of_a_step_is_a_number_if_there_is_one_then_a_parameter() -> None:
    of = system(x * y - 1, a * z - y, w - z**2)
    assert _linear_step([x * y - 1, a * z - y, 3 * w - z**2], (y, z, w), of) == (1, y, a * z)
    assert _linear_step([x * y - 1, a * z - x, w * z - 1], (y, z, w), of) == (1, z, x / a)
    assert _linear_step([x * y - 1, z**2 - x], (y, z), of) == (0, y, 1 / x)
    assert _linear_step([(a - 2) * y - 1, z * y - x], (y, z), of) is None
    assert _linear_step([sp.Abs(y) - x, z**2 - x], (y, z), of) is None


def test_a_substitution_that_multiplies_degrees_is_not_made() -> None:
    of = system(y - z**3, y**3 - z, w - y)
    assert _stays_small([y - z**3, y**3 - z], 0, y, z**3, of)
    assert not _stays_small([y - z**4, y**3 - z], 0, y, z**4, of)
    assert _stays_small([y - z**4, z - x], 0, y, z**4, of)
    assert not _stays_small([y - z**4, z - x, y**2 - 1, y**3], 0, y, z**4, of)
    assert _stays_small([y - sp.exp(z), y**3 - z], 0, y, sp.exp(z), of)
    long = sum(sp.exp(k * z) for k in range(1, 80))
    assert not _stays_small([y - long, y**3 - z], 0, y, long, of)


def test_equations_that_a_substitution_makes_long_are_not_solved_for_one_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Six states of a channel at a switched voltage: a step made 2,000 operations 175,000, the next took minutes."""
    channel = sp.symbols("c1:7")
    voltage = -80 + sum(k * (sp.sign(x - k) + 1) * (sp.sign(k + 2 - x) + 1) for k in range(1, 6))
    up = [1 / (sp.exp(-voltage / (10 + k)) / 10 + sp.exp(-voltage / (150 + k)) / 5) for k in range(6)]
    down = [sp.exp(-voltage / (20 + k)) / 5 for k in range(6)]
    rates = [
        x + up[k] * channel[k - 1] + down[k] * channel[(k + 1) % 6] - (up[k - 1] + 2 * down[k - 3]) * channel[k]
        for k in range(6)
    ]
    lengths, going_on = [], elimination._branching

    def counted(equations: list[sp.Expr], *others: Any) -> Any:
        lengths.append(sum(map(sp.count_ops, equations)))
        return going_on(equations, *others)

    monkeypatch.setattr(elimination, "_branching", counted)
    ((equations, graph),) = pieces(system(*rates, names=channel)).solved
    assert graph is None
    assert max(lengths, default=0) <= sum(map(sp.count_ops, equations))


def test_formulas_of_complex_numbers_and_places_without_a_field_are_set_aside() -> None:
    of = system(y * sp.log(y) - x)
    for value, said in (
        (sp.sqrt(-(x**2) - 1), True),
        (sp.sqrt(x), False),
        (sp.log(-(x**2)), True),
        (sp.log(x), False),
        (sp.I * x, True),
        (x + sp.zoo, True),
        (x, False),
        ((-(x**2) - 1) ** R(1, 3), False),
    ):
        assert bool(_never_real({y: value}, of)) is said, value
    assert _undefined({y: sp.Integer(0)}, of)
    assert not _undefined({y: x}, of)


x1, y1, y2, y3 = sp.symbols("x1 y1 y2 y3")


@pytest.mark.parametrize(
    "rates",
    [
        # y1 = 2 is solved for; to solve for y2 makes what is left longer and is undone; y1 - 2 stays beside the rest.
        (2 - y1, x1 * y3 + x1**3 + x1**2 / 7 + x1 + 1 - y2, x1 * y2 * y3 + y2 - y3**5 - y1 * y3),
        # y1 and y2 are solved for, y3 has no formula.
        (y3 - y1, 1 - y1 * y3 - y2 + y3**2, x1 + 3 * y1 - y3**5 - 2 * y3),
    ],
)
def test_equations_of_a_branch_hold_where_the_field_has_an_equilibrium(rates: tuple[sp.Expr, ...]) -> None:
    fast = dict(zip((y1, y2, y3), rates))
    manifold = solve_critical(SlowFastSystem(slow={x1: -x1}, fast=fast, epsilon=sp.Symbol("epsilon")))
    (branch,) = manifold.branches
    assert not branch.is_explicit
    at = {x1: sp.Rational(1, 2)}
    root = sp.nsolve([rate.xreplace(at) for rate in rates], (y1, y2, y3), (2, 1.5, 0.5), prec=30)
    place = {**at, **dict(zip((y1, y2, y3), root))}
    assert [abs(e.xreplace(place)) < 1e-25 for e in branch.equations] == [True] * 3


def test_a_factor_without_real_zeros_makes_no_branch() -> None:
    """Rates of gating variables are (n_infinity - n) cosh(...): M0 had a branch cosh(...) = 0."""
    system = SlowFastSystem(
        slow={x: -y},
        fast={y: x - y - z**3, z: (1 / (1 + sp.exp(-y)) - z) * sp.cosh(y / 8 + 1)},
        epsilon=sp.Symbol("epsilon"),
    )
    (branch,) = solve_critical(system).branches
    assert not any(e.has(sp.cosh) for e in branch.equations)
