"""Blow-ups: published weights, in whatever coordinates; charts by the chain rule; powers of epsilon by runs."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.algebra.algebraic_numbers import AlgebraicPoint
from gsp.critical.continuation.special_points import special_point
from gsp.critical.layer_problem import LayerProblem
from gsp.critical.loss_kind import LossKind
from gsp.singular.blow_up.local_form import BlowUpError
from gsp.singular.blow_up.nilpotent_points import nilpotent_point
from gsp.singular.blow_up.weights import diagram, least_weights

x, y, z, u, a, b, q, eps = sp.symbols("x y z u a b q epsilon")
v, w = sp.symbols("v w")
half = sp.Rational(1, 2)

# Name: slow rates, fast rates, parameters, weights by name, degree.
PUBLISHED: dict[str, tuple[dict, dict, dict, dict, int]] = {
    "fold": ({x: 1}, {y: x + y**2}, {}, {"y": 1, "x": 2, "epsilon": 3}, 1),
    "transcritical point": ({x: 1}, {y: x**2 - y**2 + half * eps}, {}, {"y": 1, "x": 1, "epsilon": 2}, 1),
    "pitchfork": ({x: 1}, {y: x * y - y**3 + half * eps}, {}, {"y": 1, "x": 2, "epsilon": 4}, 2),
    "canard point": ({x: y - a}, {y: x + y**2}, {a: 0}, {"y": 1, "x": 2, "epsilon": 2, "a": 1}, 1),
    "cusp": ({z: half, x: 1}, {y: x + z * y + y**3}, {}, {"y": 1, "z": 2, "x": 3, "epsilon": 5}, 2),
}


def system_of(slow: dict, fast: dict, parameters: dict | None = None) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=eps, parameters=parameters or {})


def at_origin(system: gsp.SlowFastSystem) -> gsp.BlowUp:
    return gsp.blow_up(system, near={s.name: 0 for s in system.states})


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_weights(name: str) -> None:
    *system, weights, degree = PUBLISHED[name]
    found = at_origin(system_of(*system))
    assert list(found.weights.items()) == list(weights.items())
    assert found.degree == degree


def transformed(name: str, seed: int) -> gsp.SlowFastSystem:
    """The system in coordinates s = L S + terms to the third degree, near the identity's like; the origin stays."""
    slow, fast, parameters, *_ = PUBLISHED[name]
    drawn = random.Random(seed)
    xs, (fast_state,) = list(slow), fast

    def polynomial(states: list[sp.Symbol], least: int) -> sp.Expr:
        powers = itertools.product(range(4), repeat=len(states))
        monomials = [p for p in powers if least <= sum(p) <= 3]
        return sp.Add(*(drawn.randint(-3, 3) * sp.prod(s**k for s, k in zip(states, p)) for p in monomials))

    lower = [drawn.choice((-2, -1, 1, 3)) * s + (xs[i - 1] if i else 0) for i, s in enumerate(xs)]
    old_slow = [linear + polynomial(xs, 2) for linear in lower]
    old_fast = drawn.choice((-3, -1, 2)) * fast_state + polynomial([*xs, fast_state], 2) + polynomial(xs, 1)
    put = dict(zip(xs, old_slow)) | {fast_state: old_fast}
    rates = (
        sp.Matrix(old_slow)
        .jacobian(xs)
        .LUsolve(sp.Matrix([sp.sympify(slow[s]).subs(put, simultaneous=True) for s in xs]))
    )
    carried = sum(old_fast.diff(s) * rate for s, rate in zip(xs, rates))
    g = (fast[fast_state].subs(put, simultaneous=True) - eps * carried) / old_fast.diff(fast_state)
    return system_of(dict(zip(xs, rates)), {fast_state: g}, parameters)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "seed"), list(itertools.product(PUBLISHED, (1, 2, 3))))
def test_no_polynomial_change_hides_the_weights(name: str, seed: int) -> None:
    *_, weights, degree = PUBLISHED[name]
    found = at_origin(transformed(name, seed))
    assert (sorted(found.weights.values()), found.degree) == (sorted(weights.values()), degree)
    assert {k: found.weights[k] for k in ("y", "epsilon")} == {k: weights[k] for k in ("y", "epsilon")}


OTHERS: dict[str, tuple[dict, dict, dict, dict, dict]] = {
    "van der Pol's fold": (
        {y: a - x}, {x: y - x**3 / 3 + x}, {a: half}, {"x": 1, "y": -2 / 3}, {"x": 1, "y": 2, "epsilon": 3},
    ),
    "van der Pol's canard point": (
        {y: a - x}, {x: y - x**3 / 3 + x}, {a: half}, {"x": 1, "y": -2 / 3, "a": 1},
        {"x": 1, "y": 2, "epsilon": 2, "a": 1},
    ),
    "a fold without a formula": (
        {x: -1}, {y: x - sp.exp(y) + b * y}, {b: 2}, {"y": 0.6931, "x": 0.6137}, {"y": 1, "x": 2, "epsilon": 3},
    ),
    "a fold at roots": (
        {y: q}, {x: y - x**3 + 2 * x}, {q: 1}, {"x": 0.8165, "y": -1.0887}, {"x": 1, "y": 2, "epsilon": 3},
    ),
    "a fold of two fast variables": (
        {x: a}, {v: x - v - w, w: -2 * v - 2 * w - w**2 + 3 * w * v - x}, {a: 1}, {"x": 0, "v": 0, "w": 0},
        {"w": 1, "x": 2, "epsilon": 3},
    ),
    "a fold along a curve": (
        {x: 1 + z, z: y}, {y: x + y**2 + z * y + 3 * z**2 + a * z**3}, {a: 5}, {"x": 0, "z": 0, "y": 0},
        {"y": 1, "x": 2, "epsilon": 3},
    ),
    "a folded node": (
        {x: a * z - 10 * y / 9, z: 1}, {y: x + y**2 - z**2 + 2 * z * y}, {a: sp.Rational(1, 18)},
        {"x": 0, "z": 0, "y": 0}, {"y": 1, "x": 2, "z": 1, "epsilon": 2},
    ),
    "a logistic transcritical point": (
        {x: b}, {y: y * (x - 2 * y) * (1 - y) + eps * sp.cos(y)}, {b: 3}, {"x": 0, "y": 0},
        {"y": 1, "x": 1, "epsilon": 2},
    ),
    "an unfolded transcritical point": (
        {x: 1}, {y: x**2 - y**2 + a}, {a: 0}, {"x": 0, "y": 0}, {"y": 1, "x": 1, "epsilon": 2, "a": 2},
    ),
    "a laser's pitchfork": (
        {x: 1}, {y: (x - q) * y / (1 + y**2) - y**3}, {q: 2}, {"x": 2, "y": 0}, {"y": 1, "x": 2, "epsilon": 4},
    ),
    "an unfolded pitchfork": (
        {x: 1}, {y: x * y - sp.sin(y) ** 3 + a + b * y**2}, {a: 0, b: 0}, {"x": 0, "y": 0},
        {"y": 1, "x": 2, "epsilon": 4, "a": 3, "b": 1},
    ),
    "a fold of the third order": ({x: a}, {y: x - y**3}, {a: 1}, {"x": 0, "y": 0}, {"y": 1, "x": 3, "epsilon": 5}),
    "a swallowtail": (
        {x: 1, z: 1, u: 1}, {y: x + z + u + z * y + (u - x) * y**2 + a * y**4}, {a: 2},
        {"x": 0, "z": 0, "u": 0, "y": 0}, {"y": 1, "x": 4, "z": 3, "u": 2, "epsilon": 7},
    ),
    # Sheets y = x^2 and y = -x^2: beyond degree three x gets a weight only, as the low powers do not hold it.
    "a transcritical point of sheets that touch": (
        {x: 1}, {y: y**2 - a * x**4}, {a: 1}, {"x": 0, "y": 0}, {"y": 2, "x": 1, "epsilon": 3},
    ),
    "sheets that touch in other coordinates": (
        {x: 1 + x}, {y: y * (y - x**2) + a * eps}, {a: 2}, {"x": 0, "y": 0}, {"y": 2, "x": 1, "epsilon": 4},
    ),
    "a cusp unfolded by a fourth power": (
        {x: 1, z: 1}, {y: x + a * z**4 * y + y**3}, {a: 1}, {"x": 0, "z": 0, "y": 0},
        {"y": 2, "x": 6, "z": 1, "epsilon": 10},
    ),
    "a Bogdanov-Takens point": (
        {x: 1, z: 1}, {v: w + a * v**2, w: x + z * w + v**2 + v * w}, {a: 3}, {"x": 0, "z": 0, "v": 0, "w": 0},
        {"v": 2, "w": 3, "x": 4, "z": 1, "epsilon": 5},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_weights_with_parameters_and_off_the_origin(name: str) -> None:
    slow, fast, parameters, near, weights = OTHERS[name]
    assert dict(gsp.blow_up(system_of(slow, fast, parameters), near=near).weights) == weights


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_least_weights_keep_the_most_monomials(name: str) -> None:
    """Second route: all whole weights to 6 and degrees to 3 that keep the power of y, counted."""
    slow, fast, parameters, weights, degree = PUBLISHED[name]
    names = [*fast, *slow, *parameters, eps]
    rates = [*fast.values(), *(eps * sp.sympify(f) for f in slow.values())]
    monomials = [(i, list(sp.Poly(e, *names).as_dict())) for i, e in enumerate(rates)]
    points = [(*m[:i], m[i] - 1, *m[i + 1 :]) for i, own in monomials for m in own]
    power = next(p for p in points if p[0] > 0 and not any(p[1:]))

    def values(w: tuple[int, ...]) -> list[int]:
        return [sum(i * j for i, j in zip(w, p)) for p in points]

    best = []
    for candidate in itertools.product(range(1, 7), repeat=len(names)):
        k = sum(i * j for i, j in zip(candidate, power))
        if k <= 3 and min(values(candidate)) >= k:
            best.append((-values(candidate).count(k), sum(candidate), candidate, k))
    _, _, found, k = min(best)
    assert ({s.name: own for s, own in zip(names, found)}, k) == (weights, degree)
    fast_at, slow_at = range(len(fast)), range(len(fast), len(fast) + len(slow))
    assert least_weights(diagram(monomials), (fast_at, slow_at, (len(names) - 1,))) == (found, k)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", [*PUBLISHED, "a folded node", "a swallowtail", "a Bogdanov-Takens point"])
def test_charts_are_the_leading_field_by_the_chain_rule(name: str) -> None:
    if name in PUBLISHED:
        found = at_origin(system_of(*PUBLISHED[name][:3]))
    else:
        slow, fast, parameters, near, _ = OTHERS[name]
        found = gsp.blow_up(system_of(slow, fast, parameters), near=near)
    for chart in found.charts:
        for state, image in chart.substitution.items():
            rate = sum(image.diff(Z) * own for Z, own in chart.rates.items())
            field = found.field.rates[state].subs(dict(chart.substitution), simultaneous=True)
            assert sp.expand(chart.radius**found.degree * rate - field) == 0


def test_charts_of_the_fold_have_the_published_eigenvalues() -> None:
    """Krupa and Szmolyan 2001, section 2: -2 where the attracting sheet arrives, 1, -2, -3 where orbits leave."""
    found = at_origin(system_of(*PUBLISHED["fold"][:3]))
    charts = {chart.title: chart for chart in found.charts}
    arriving = charts["x = -r_3^2"].equilibria
    assert [rest.eigenvalues for rest in arriving] == [(0, -2, 0), (0, 2, 0)]
    (leaving,) = charts["y = r_4"].equilibria
    assert sorted(leaving.eigenvalues) == [-3, -2, 1]
    assert charts["x = r_2^2"].equilibria == ()
    assert charts["epsilon = r_1^3"].equilibria == ()


def test_the_rescaled_canard_point_is_a_centre() -> None:
    found = gsp.blow_up(system_of({y: 1 - x}, {x: y - x**3 / 3 + x}), near={"x": 1, "y": -2 / 3})
    (centre,) = found.charts[0].equilibria
    assert centre.eigenvalues == (0, -sp.I, sp.I)
    rates = dict(found.charts[0].rates)
    energy = sp.Symbol("x_1", real=True) ** 2 - sp.Symbol("y_1", real=True) - half
    first = sp.exp(-2 * sp.Symbol("y_1", real=True)) * energy
    assert sp.simplify(sum(first.diff(Z) * rate for Z, rate in rates.items())) == 0


@pytest.mark.parametrize(
    "name", ["van der Pol's fold", "a fold of two fast variables", "a fold without a formula"]
)
def test_coefficients_are_those_of_the_passage(name: str) -> None:
    slow, fast, parameters, near, _ = OTHERS[name]
    system = system_of(slow, fast, parameters)
    found, passage = gsp.blow_up(system, near=near), gsp.fold_passage(system, near)
    (fast_name, slow_name, small) = (sp.Symbol(n, real=True) for n in found.weights)
    bent = float(
        found.leading[fast_name.name].coeff(fast_name, 2) * found.leading[fast_name.name].coeff(slow_name)
    )
    moved = float(found.leading[slow_name.name].coeff(small))
    # a b is the same for all lengths of r.
    assert bent * moved == pytest.approx(passage.a * passage.b, rel=1e-9)


EPSILONS = (1e-6, 1e-7)
PASSAGES: dict[str, tuple[dict, dict, dict, str]] = {
    "a fold": ({x: 1 + x / 2}, {y: x + y**2 - y**3}, {"x": -1, "y": -0.7549}, "y"),
    "a transcritical point": ({x: 1 + y}, {y: x**2 - y**2 + half * eps + x**3}, {"x": -1, "y": 0.05}, "y"),
    "a pitchfork": ({x: -1 - x * y}, {y: x * y - y**3 + y**4 / 9 + half * eps}, {"x": 1, "y": 1}, "y"),
    "a fold of the third order": ({x: 1 + y**2}, {y: x - y**3 + x * y}, {"x": -1, "y": -1}, "y"),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", PASSAGES)
def test_runs_pass_with_the_powers_of_epsilon(name: str) -> None:
    """The fast variable where x is that of the point is as large as the rescaling chart says."""
    slow, fast, start, state = PASSAGES[name]
    system = system_of(slow, fast)
    scaling = at_origin(system).scaling
    ends = []
    for small in EPSILONS:
        run = gsp.integrate(
            system, start=start, span=(0.0, 5.0), epsilon=small, rtol=1e-10, atol=1e-13,
            events=[gsp.Event(x, terminal=True)],
        )  # fmt: skip
        ends.append(abs(float(run[state][-1])))
    slope = np.log(ends[0] / ends[1]) / np.log(EPSILONS[0] / EPSILONS[1])
    assert slope == pytest.approx(float(scaling.exponents[state]), abs=0.02)


def test_the_delay_of_a_fold_has_the_power_of_its_slow_variable() -> None:
    system = system_of({y: -x}, {x: y - x**3 / 3 + x})
    near = {"x": 1, "y": -2 / 3}
    passage = gsp.fold_passage(system, near)
    late = [abs(gsp.fold_exit(passage, epsilon=e).point["y"] + 2 / 3) for e in EPSILONS]
    slope = np.log(late[0] / late[1]) / np.log(EPSILONS[0] / EPSILONS[1])
    assert slope == pytest.approx(float(gsp.blow_up(system, near=near).scaling.slow_time), abs=0.02)


@pytest.mark.exhaustive
def test_losses_and_special_points_and_folded_singularities_are_places() -> None:
    system = system_of({y: half - x}, {x: y - x**3 / 3 + x})
    branch = gsp.solve_critical(system).nearest({"x": 2, "y": 2 / 3})
    (loss,) = gsp.classify(branch, region={"y": (-1, 1)}).losses
    curve = gsp.continue_critical(system, start={"x": 2, "y": 2 / 3}, bounds={"x": (-3, 3), "y": (-2, 2)})
    (special,) = (p for p in curve.special if p["x"] > 0)
    assert gsp.blow_up(system, near=loss).weights == gsp.blow_up(system, near=special).weights
    assert loss.weights == (1, 2, 3)
    node = system_of({x: z / 18 - 10 * y / 9, z: 1}, {y: x + y**2})
    (folded,) = gsp.folded_singularities(node, region={"y": (-1, 1)})
    assert dict(gsp.blow_up(folded).weights) == {"y": 1, "x": 2, "z": 1, "epsilon": 2}


@pytest.mark.parametrize(
    ("slow", "fast", "kind"),
    [
        ({x: 1}, {y: x + y**2}, LossKind.FOLD),
        ({x: y}, {y: x + y**2}, LossKind.FOLD),
        pytest.param({x: 1}, {y: x - y**3}, LossKind.CUSP, marks=pytest.mark.exhaustive),
        ({x: 1}, {y: y * (x - y) + eps / 3}, LossKind.TRANSCRITICAL),
        ({x: 1}, {y: x * y - y**3 + eps / 3}, LossKind.PITCHFORK),
        ({x: 1, z: 1}, {v: w, w: x + z * w + v**2 + v * w}, LossKind.BOGDANOV_TAKENS),
    ],
)
def test_losses_carry_the_weights_that_are_computed(slow: dict, fast: dict, kind: LossKind) -> None:
    system = system_of(slow, fast)
    region = dict.fromkeys(("x", "z") if z in slow else ("x",), (-0.6, 1.0)) | {
        s.name: (-1.0, 1.0) for s in fast
    }
    losses = [
        loss
        for branch in gsp.solve_critical(system).branches
        for loss in gsp.classify(branch, region=region).losses
        if loss.kind is kind
    ]
    found = at_origin(system)
    first, small = next(iter(fast)).name, found.weights["epsilon"]
    assert losses[0].weights == (found.weights[first], found.weights["x"], small)
    exponents = f"v ~ epsilon^({found.scaling.exponents[first]})"
    assert exponents in str(losses[0])


def test_a_hopf_point_is_not_nilpotent() -> None:
    system = system_of({x: 1}, {v: x * v - w - v * (v**2 + w**2), w: v + x * w})
    with pytest.raises(BlowUpError, match=r"no nilpotent point near x = 0.* regular there.*0\+1j"):
        at_origin(system)
    region = {"x": (-1, 1), "v": (-1, 1), "w": (-1, 1)}
    losses = gsp.classify(gsp.solve_critical(system).branches[0], region=region).losses
    (hopf,) = (loss for loss in losses if loss.kind is LossKind.HOPF)
    assert hopf.weights is None
    with pytest.raises(BlowUpError, match=r"a Hopf point is not nilpotent.*entry_exit"):
        gsp.blow_up(system, near=hopf)


@pytest.mark.parametrize(
    ("slow", "fast", "said"),
    [
        ({x: 1}, {y: x * y + eps}, "no power below the 9th"),
        ({x: 1}, {y: x + y**2 * sp.Abs(y)}, "not smooth"),
        ({x: 1}, {v: x + v**2, w: x + w**2}, "2 null vectors"),
        ({x: 0}, {y: x + y**2}, "epsilon moves nothing"),
        ({x: 1}, {y: x + y**2, v: -2 * w + v * y, w: 2 * v + w * y}, r"imaginary pair.*\+-2i"),
    ],
)
def test_what_is_not_blown_up_is_refused_by_name(slow: dict, fast: dict, said: str) -> None:
    with pytest.raises(BlowUpError, match=said):
        at_origin(system_of(slow, fast))


def test_what_is_printed_and_set() -> None:
    found = at_origin(system_of(*PUBLISHED["fold"][:3]))
    assert found.line == (
        "weights y 1, x 2, epsilon 3; degree 1; so y ~ epsilon^(1/3), x ~ epsilon^(2/3), slow time ~ epsilon^(2/3)"
    )
    assert str(found).splitlines()[:4] == [
        "blow-up of the nilpotent point x = 0, y = 0",
        "  weights  y 1, x 2, epsilon 3; degree 1",
        "  leading  y' = x + y**2",
        "  leading  x' = epsilon",
    ]
    mu, slow, fast = (
        sp.Symbol("mu"),
        dict(zip(found.system.x, found.system.f)),
        dict(zip(found.system.y, found.system.g)),
    )
    renamed = at_origin(gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=mu))
    assert (
        renamed.line == "weights y 1, x 2, mu 3; degree 1; so y ~ mu^(1/3), x ~ mu^(2/3), slow time ~ mu^(2/3)"
    )
    latex = found._repr_latex_()
    assert latex is not None
    for chart in found.charts:
        own = chart._repr_latex_()
        assert own is not None
        assert own.removeprefix(r"$\displaystyle \begin{aligned}").removesuffix(r"\end{aligned}$") in latex


@pytest.mark.parametrize("side", [1, -1])
def test_a_fold_persists_so_that_no_parameter_has_a_weight_also_among_functions(side: int) -> None:
    """Rounding of 1e-81 in terms that cancel gave parameters weights, on the two sides different ones."""
    slip = v - b
    friction = sp.tanh(slip / w) / (1 + a * sp.sqrt(slip**2 + w**2))
    system = system_of({x: v}, {v: -x - friction}, {a: 3, b: sp.Rational(1, 5), w: sp.Rational(1, 20)})
    curve = gsp.continue_critical(system, start={"x": 0, "v": 0.2}, bounds={"x": (-1, 1), "v": (0, 0.4)})
    (fold,) = (point for point in curve.special if side * (point.point["v"] - 0.2) > 0)
    found = gsp.blow_up(system, near=fold, parameters=["a", "b", "w"])
    assert {str(s): weight for s, weight in found.weights.items() if weight} == {"v": 1, "x": 2, "epsilon": 3}


def coupled(c: str) -> gsp.SlowFastSystem:
    """Two oscillators: over y1 = y2 they move alike, and lose that in a cusp where x^2 = 1 - 2 c."""
    x1, x2, y1, y2 = sp.symbols("x1 x2 y1 y2")
    pull = sp.Rational(c) * (x2 - x1)
    fast = {x1: y1 + x1 - x1**3 / 3 + pull, x2: y2 + x2 - x2**3 / 3 - pull}
    return gsp.SlowFastSystem(
        slow={y1: sp.Rational(2, 5) - x1, y2: sp.Rational(2, 5) - x2}, fast=fast, epsilon=eps
    )


@pytest.mark.exhaustive
def test_a_cusp_of_two_fast_directions_is_found_where_it_is() -> None:
    """Along the diagonal y ~ t passes the pitchfork v' = y v - v^3 + d, d' = v: (1, 2, 3; 4) for v, y, d and epsilon.

    Beside the cusp, where the double that names it is a fold, epsilon^(1/3) and epsilon^(1/6) were told.
    """
    system = coupled("1/5")
    x = -math.sqrt(0.6)
    y = x**3 / 3 - x
    problem = LayerProblem(system, system.x, {})
    cusp = special_point(problem, np.array([y, y, x, x]), LossKind.CUSP)
    point = nilpotent_point(system, cusp.point, LossKind.CUSP)
    values = point.numbers() if isinstance(point, AlgebraicPoint) else {s: float(v) for s, v in point.items()}
    assert {s.name: float(v) for s, v in values.items()} == pytest.approx(dict(cusp.point), rel=1e-15)
    found = gsp.blow_up(system, near=cusp)
    assert found.weights == {"x2": 1, "y1": 3, "y2": 2, "epsilon": 4}


@pytest.mark.exhaustive
def test_a_folded_singularity_of_two_fast_directions_is_where_the_flow_turns() -> None:
    """On the fold of x1 far from that of x2 the desingularised flow rests where <l, g_x f> = 0, l its null vector."""
    system = coupled("1/10")
    states = sp.symbols("x1 x2 y1 y2")

    def l_g_x_f(values) -> float:
        x1, x2, *_ = (float(values[s]) for s in states)
        jacobian = np.array([[1 - x1**2 - 0.1, 0.1], [0.1, 1 - x2**2 - 0.1]])
        left = np.linalg.svd(jacobian.T)[2][-1]
        assert abs(np.linalg.det(jacobian)) < 1e-12
        return float(left @ [0.4 - x1, 0.4 - x2])

    x1, x2 = math.sqrt(0.9 - 0.01 / 0.65), -0.5
    near = {"x1": x1, "x2": x2, "y1": x1**3 / 3 - x1 - 0.1 * (x2 - x1), "y2": x2**3 / 3 - x2 + 0.1 * (x2 - x1)}
    plain = nilpotent_point(system, near)
    assert not isinstance(plain, AlgebraicPoint)
    assert abs(l_g_x_f(plain)) > 0.01
    turning = {"x1": 0.96876806, "x2": -1.07687617, "y1": -0.4611369645, "y2": 0.4560408535}
    turned = nilpotent_point(system, turning, LossKind.FOLDED_SINGULARITY)
    held = turned.near(200) if isinstance(turned, AlgebraicPoint) else turned
    assert abs(l_g_x_f(held)) < 1e-12


def test_a_point_that_only_looks_rational_is_not_simplified_for_ever() -> None:
    """At 305 of some unit a fold is near fractions, at which exp and tanh of long numbers are not 0."""
    film, basin = sp.symbols("F B")
    rate = basin - film - sp.Rational(12, 5) * (sp.exp((film - 300) / 25) - 1) + 6 * sp.tanh((film - 305) / 4)
    system = gsp.SlowFastSystem(slow={basin: film - basin}, fast={film: rate}, epsilon=sp.Symbol("epsilon"))
    found = gsp.blow_up(system, near={"F": 307.18664917, "B": 304.99787082})
    assert dict(found.weights) == {"F": 1, "B": 2, "epsilon": 3}
