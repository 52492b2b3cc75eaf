"""Averaging over a fast phase: published coefficients, measured orders, and what is refused by name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import DeclarationError, GspError, SplittingError, UnsupportedFunctionError
from tests.cases import sampled

u, v, w, q, p, x, y, r, theta, psi = sp.symbols("u v w q p x y r theta psi")
epsilon, alpha, c, f, sigma = sp.symbols("epsilon alpha c f sigma")
VAN_DER_POL = gsp.VectorField({u: v / epsilon, v: -u / epsilon + (1 - u**2) * v}, epsilon=epsilon)
DUFFING = gsp.VectorField({u: v / epsilon, v: -u / epsilon - u**3}, epsilon=epsilon)
FORCED = gsp.VectorField(
    {u: v / epsilon, v: -u / epsilon - c * v - alpha * u**3 + f * sp.cos(psi), psi: 1 / epsilon + sigma},
    epsilon=epsilon,
    parameters={c: 0.2, f: 1, sigma: 0.5, alpha: 1},
)
PENDULUM = gsp.VectorField(
    {q: p, p: (1 + alpha * sp.cos(theta) / epsilon) * sp.sin(q) - c * p, theta: 1 / epsilon},
    epsilon=epsilon,
    parameters={alpha: 2, c: 0.2},
)
# The phase turns at a rate that depends on what moves slowly, and depends on the phase at the next order.
PULLED = gsp.VectorField(
    {
        x: -x + y * sp.cos(theta) + epsilon * sp.sin(2 * theta),
        y: x * sp.sin(theta),
        theta: (1 + x**2) / epsilon + y * sp.sin(theta),
    },
    epsilon=epsilon,
)

# The pair turns at sqrt(w^2), which is w, and so does the forcing: the other way round.
FOLLOWED = gsp.VectorField(
    {
        u: -4 * w * v / epsilon,
        v: w * u / (4 * epsilon) - v / 5 + sp.cos(psi),
        w: u**2 - w,
        psi: w / epsilon + w / 3,
    },
    epsilon=epsilon,
)
MOVED = gsp.VectorField({u: v / epsilon, v: -(1 + w) * u / epsilon - u**3 * w, w: -w}, epsilon=epsilon)
BACK = gsp.SlowFastSystem(
    slow={x: sp.cos(theta) ** 2 - x}, fast={theta: -2 - x**2 + epsilon * sp.sin(theta)}, epsilon=epsilon
)


def scene(
    field: gsp.VectorField | gsp.SlowFastSystem, phase: gsp.FastPhase, start: dict[str, float], **others
) -> gsp.Scene:
    given = {"region": {next(iter(start)): (-3, 3)}, "span": (0, 2), "epsilon": 0.01, **others}
    return gsp.Scene(field, start=start, phase=phase, **given)


PAIR = gsp.FastPhase(pair=("u", "v"))
SCENES = {
    "van der Pol": scene(VAN_DER_POL, PAIR, {"u": 1, "v": 0}, span=(0, 3), epsilon=0.025),
    "Duffing": scene(DUFFING, PAIR, {"u": 1, "v": 0}, epsilon=0.025),
    "near resonance": scene(
        FORCED, gsp.FastPhase("psi", ("u", "v")), {"u": 0.5, "v": 0, "psi": 0}, epsilon=0.025
    ),
    "vibrated pendulum": scene(PENDULUM, gsp.FastPhase("theta"), {"q": 0.5, "p": 0, "theta": 0}),
    "a frequency that moves": scene(
        MOVED, PAIR, {"u": 1, "v": 0.2, "w": 1}, region={"w": (-0.5, 3)}, span=(0, 1)
    ),
    "a fast variable that turns back": scene(
        BACK, gsp.FastPhase("theta"), {"x": 1, "theta": 0.2}, region={"x": (0, 3)}
    ),
    "near a resonance that moves": scene(
        FOLLOWED,
        gsp.FastPhase("psi", ("u", "v")),
        {"u": 0.5, "v": 0.1, "w": 1, "psi": 0},
        span=(0, 1),
        region={"w": (0.5, 2)},
    ),
    "rate of the phase": scene(PULLED, gsp.FastPhase("theta"), {"x": 1, "y": 1, "theta": 0.3}),
}


@pytest.mark.parametrize("name", sampled(SCENES, always=["vibrated pendulum"]))
def test_the_error_of_each_order_falls_with_its_power_of_epsilon(name: str) -> None:
    found = gsp.compare_averaged(gsp.average(SCENES[name], order=3))
    for order in range(4):
        if name == "Duffing" and order == 0:
            continue
        assert found.slopes[order] == pytest.approx(order + 1, abs=0.12), str(found)


def summed(terms) -> sp.Expr:
    """sum of epsilon^k times the terms."""
    return sp.Add(*[epsilon**k * term for k, term in enumerate(terms)])


def before(found: gsp.Averaging, *symbols: sp.Symbol, order: int) -> dict[sp.Symbol, sp.Expr]:
    """The slow variables and the phase before averaging."""
    return {s: summed([s, *(row[s] for row in found.transformation[:order])]) for s in symbols}


def series(expression: sp.Expr, order: int) -> sp.Expr:
    """The Taylor polynomial in epsilon."""
    terms = []
    for k in range(order + 1):
        terms.append(sp.expand(expression.subs(epsilon, 0)) / sp.factorial(k))
        expression = sp.diff(expression, epsilon)
    return sp.expand(summed(terms))


@pytest.mark.exhaustive
def test_van_der_pol_has_the_published_limit_cycle() -> None:
    """C. M. Andersen and J. F. Geer, SIAM J. Appl. Math. 42 (1982) 678-693: frequency and amplitude."""
    found = gsp.average(VAN_DER_POL, pair=(u, v), order=3)
    assert sp.expand(found.averaged_field[0][r] - r / 2 * (1 - r**2 / 4)) == 0
    a = sp.Symbol("a")
    rate = summed(row[r] for row in found.averaged_field)
    (bent,) = sp.solve(sp.expand(rate.subs(r, 2 + a * epsilon**2)).coeff(epsilon, 2), a)
    cycle = 2 + bent * epsilon**2
    frequency = summed(found.frequency).subs(r, cycle)
    assert sp.expand(series(frequency, 4) - (1 - epsilon**2 / 16 + sp.Rational(17, 3072) * epsilon**4)) == 0
    # The maximum of u over the cycle, near phase 0.
    first, second = sp.symbols("first second")
    moved = before(found, r, theta, order=2)
    wave = (moved[r] * sp.cos(moved[theta])).subs(r, cycle)
    near = wave.subs(theta, first * epsilon + second * epsilon**2)
    slope = series(sp.diff(wave, theta).subs(theta, first * epsilon + second * epsilon**2), 1)
    (turn,) = sp.solve(sp.expand(slope).coeff(epsilon, 1), first)
    assert sp.expand(series(near, 2).subs(first, turn) - (2 + epsilon**2 / 96)) == 0


@pytest.mark.exhaustive
def test_duffing_has_the_published_frequency_in_both_conventions() -> None:
    """A. H. Nayfeh, Introduction to Perturbation Techniques (1981), section 4: by u(0), and by the first harmonic."""
    found = gsp.average(DUFFING, pair=(u, v), order=3)
    assert all(row[r] == 0 for row in found.averaged_field)
    frequency = summed(found.frequency)
    a, unknown = sp.Symbol("A", positive=True), sp.symbols("k1:4")

    def by(amplitude: sp.Expr, order: int) -> sp.Expr:
        """The frequency by an amplitude that is r (1 + ...)."""
        radius = a * (1 + sum(k * epsilon ** (i + 1) for i, k in enumerate(unknown[:order])))
        defect = sp.expand(series(amplitude.subs(r, radius) - a, order))
        found: dict = {}
        for i, k in enumerate(unknown[:order]):
            found[k] = sp.solve(defect.coeff(epsilon, i + 1).subs(found), k)[0]
        return sp.expand(series(frequency.subs(r, radius.subs(found)), order))

    at_rest = before(found, r, order=3)[r].subs(theta, 0)
    e = epsilon
    wanted = 1 + 3 * e * a**2 / 8 - 21 * e**2 * a**4 / 256 + 81 * e**3 * a**6 / 2048
    assert sp.expand(by(at_rest, 3) - wanted) == 0
    full = before(found, r, theta, order=2)
    wave = series(full[r] * sp.cos(full[theta]), 2)
    harmonic = (
        sp.integrate(sp.expand(sp.expand(wave * sp.cos(theta)).rewrite(sp.exp)), (theta, 0, 2 * sp.pi)) / sp.pi
    )
    assert sp.expand(by(sp.expand(harmonic), 2) - (1 + 3 * e * a**2 / 8 - 15 * e**2 * a**4 / 256)) == 0


def test_duffing_beside_its_elliptic_integral() -> None:
    found = gsp.average(DUFFING, pair=(u, v), order=3)
    errors = []
    for value in (0.04, 0.02):
        point = found.base_point({"u": 1, "v": 0}, epsilon=value)
        turning = float(sum(value**k * g.subs(r, point["r"]) for k, g in enumerate(found.frequency)))
        exact = mpmath.pi * mpmath.sqrt(1 + value) / (2 * mpmath.ellipk(value / (2 * (1 + value))))
        errors.append(abs(turning - float(exact)))
    # The frequency is known through epsilon^4, and the amplitude that it is taken at through epsilon^3.
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5, abs=0.3)


def test_a_forced_oscillator_near_resonance_has_the_published_response() -> None:
    """Nayfeh, section 11: ((sigma - 3 alpha a^2/8)^2 + c^2/4) a^2 = f^2/4 with amplitude a of the response."""
    found = gsp.average(FORCED, phase=psi, pair=(u, v), order=1)
    A, B = found.form.rates
    rest = sp.solve([found.averaged_field[0][s] for s in (A, B)], [c, f], dict=True)[0]
    a2 = A**2 + B**2
    response = ((-sigma - 3 * -alpha * a2 / 8) ** 2 + c**2 / 4) * a2 - f**2 / 4
    assert sp.simplify(response.subs(rest)) == 0


@pytest.mark.parametrize("strength", [1.2, 1.7])
def test_a_pendulum_stands_upright_where_its_averaged_potential_says_so(strength: float) -> None:
    """Kapitza: q'' = sin q - alpha^2 sin(2 q)/4, upright q = 0 stable for alpha^2 > 2."""
    field = PENDULUM.with_parameters(alpha=strength)
    found = gsp.average(field, phase="theta", order=1)
    slow = next(s for s in found.form.rates if s != q)
    force = found.averaged_field[0][slow] + c * slow
    assert sp.simplify(force - sp.sin(q) + alpha**2 * sp.sin(2 * q) / 4) == 0
    upright = sp.diff(force, q).subs(q, 0).subs(alpha, strength) < 0
    assert upright == (strength**2 > 2)
    run = gsp.integrate(field, start={"q": 0.05, "p": 0, "theta": 0}, span=(0, 12), epsilon=0.01)
    assert (np.abs(run["q"]).max() < 0.3) == upright


@pytest.mark.parametrize(
    ("gain", "mean"),
    [
        (1 / (1 + u**2 + 9 * v**2) - sp.Rational(1, 5), 1 / (1 + r**2) - sp.Rational(1, 5)),
        (1 - sp.sqrt(u**2 + 9 * v**2), 1 - r),
        (-sp.log(1 + sp.sqrt(u**2 + 9 * v**2)), -sp.log(1 + r)),
    ],
    ids=["a saturable gain", "a root", "a logarithm"],
)
def test_functions_of_the_amplitude_are_constant_along_the_phase(gain: sp.Expr, mean: sp.Expr) -> None:
    field = gsp.VectorField({u: 3 * v / epsilon + gain * u, v: -u / (3 * epsilon)}, epsilon=epsilon)
    found = gsp.average(scene(field, PAIR, {"u": 1, "v": 0.1}, epsilon=0.05), order=1)
    assert sp.simplify(found.averaged_field[0][r] - r * mean / 2) == 0
    assert gsp.compare_averaged(found).slopes[1] == pytest.approx(2, abs=0.12)


def test_energy_over_frequency_stays_where_the_frequency_moves() -> None:
    field = gsp.VectorField({u: v / epsilon, v: -(w**2) * u / epsilon, w: 1}, epsilon=epsilon)
    found = gsp.average(field, pair=(u, v), region={"w": (1, 2)}, order=2)
    # r^2 w, the energy over the frequency.
    leading = found.averaged_field[0]
    assert sp.expand(2 * r * w * leading[r] + r**2 * leading[w]) == 0
    assert found.frequency[0] == w


@pytest.mark.exhaustive
def test_the_transformed_field_is_the_field_by_a_second_route() -> None:
    """The series put into the equations of motion leaves epsilon^(order + 1), with SymPy's derivatives."""
    found = gsp.average(PULLED, phase=theta, region={"x": (-2, 2)}, order=2)
    full = before(found, x, y, theta, order=2)
    rates = {s: summed([0, *(row[s] for row in found.averaged_field)]) for s in (x, y)}
    rates[theta] = summed(found.frequency)
    at = {x: sp.Rational(3, 10), y: sp.Rational(-7, 10), theta: sp.Rational(9, 10)}
    left: dict = {}
    for value in (1e-3, 5e-4):
        point = {**at, epsilon: sp.Rational(value)}
        for s, rate in zip((x, y, theta), PULLED.rates):
            along = sp.Add(*[sp.diff(full[s], z) * rate for z, rate in rates.items()])
            wanted = (epsilon * rate).subs(full, simultaneous=True)
            left.setdefault(s, []).append(abs(sp.N((along - wanted).subs(point), 40)))
    for s, (coarse, fine) in left.items():
        # In fast time: the next term of x' is epsilon^4 times omega u_3, that of theta' epsilon^3 times omega v_3.
        assert float(sp.log(coarse / fine, 2)) == pytest.approx(3, abs=0.1), s


def test_states_come_back_from_an_averaged_run() -> None:
    asked = SCENES["van der Pol"]
    found = gsp.average(asked, order=3)
    at = np.linspace(0, 3, 50)
    full = gsp.integrate(asked, at=at, rtol=1e-11, atol=1e-12)
    base = found.base_point(asked.start, epsilon=asked.epsilon)
    run = gsp.integrate(
        found.with_phase(), start=base, span=(0, 3), epsilon=asked.epsilon, at=at, rtol=1e-11, atol=1e-12
    )
    back = found.restored(run)
    assert max(np.abs(back[z] - full[z]).max() for z in "uv") < asked.epsilon**4
    slow = gsp.integrate(found.averaged(), start={"r": base["r"]}, span=(0, 3), epsilon=asked.epsilon, at=at)
    assert np.abs(slow["r"] - run["r"]).max() < 1e-7


def test_the_table_has_a_row_for_each_variable_and_power() -> None:
    rows = gsp.average(VAN_DER_POL, pair=(u, v), order=1).as_rows()
    assert [(row["variable"], row["power"]) for row in rows] == [
        (s, k) for s in ("r", "theta") for k in range(3)
    ]
    assert rows[0]["rate"] == "-r*(r - 2)*(r + 2)/8"
    assert rows[2]["rate"] == ""
    assert rows[5]["rate"] == "-11*r**4/256 + 3*r**2/16 - 1/8"
    assert "sin(2*theta)" in str(rows[1]["shift"])


def test_values_may_be_put_in_first() -> None:
    by_symbols = gsp.average(FORCED, phase=psi, pair=(u, v), order=2)
    by_values = gsp.average(FORCED, phase=psi, pair=(u, v), order=2, symbolic=False)
    for one, two in zip(by_symbols.averaged_field, by_values.averaged_field, strict=True):
        for s in one:
            assert sp.expand(one[s].subs(FORCED.parameters) - two[s]) == 0


def turning(rate: sp.Expr, slow: sp.Expr = -x, **others) -> gsp.VectorField:
    return gsp.VectorField({x: slow, theta: rate}, epsilon=epsilon, **others)


def test_across_a_jump_of_the_rates_no_power_is_expected_from_order_one_on() -> None:
    field = gsp.VectorField(
        {x: sp.Heaviside(y - sp.Rational(1, 2)) * (1 + sp.sin(theta)) - x, y: sp.S.One, theta: 1 / epsilon},
        epsilon=epsilon,
    )
    whole = scene(field, gsp.FastPhase(name="theta"), {"x": 1, "y": 0, "theta": 0.3}, epsilon=0.04)
    found = gsp.compare_averaged(gsp.average(whole, order=1), epsilons=(0.04, 0.01))
    assert found.expected == {0: 1, 1: None}
    assert found.slopes[1] == pytest.approx(1.0, abs=0.2)
    assert found.crossed == ("y - 1/2",)
    before = gsp.compare_averaged(gsp.average(replace(whole, span=(0, 0.4)), order=1), epsilons=(0.04, 0.01))
    assert before.expected == {0: 1, 1: 2}
    assert not before.crossed


REFUSED = {
    "a phase that stops": (
        turning((x - 1) / epsilon), {"phase": "theta", "region": {"x": (0, 2)}},
        SplittingError, "omega = x - 1, which is 0 or changes its sign over the region",
    ),
    "a phase without a region": (turning(x / epsilon), {"phase": "theta"}, SplittingError, "no region bounds x"),
    "a slow phase": (
        turning(1 + epsilon), {"phase": "theta"},
        SplittingError, "theta is epsilon + 1, which is not that of a fast phase",
    ),
    "a phase that depends on itself": (
        turning((2 + sp.cos(theta)) / epsilon), {"phase": "theta"}, SplittingError, "depends on itself",
    ),
    "a fast variable": (
        turning(1 / epsilon, -x / epsilon), {"phase": "theta"}, SplittingError, "put what it is attracted to in",
    ),
    "a vibration with a mean": (
        turning(1 / epsilon, sp.cos(theta) ** 2 / epsilon), {"phase": "theta"}, SplittingError, "has mean zero",
    ),
    "a vibration that is too fast": (
        turning(1 / epsilon, x * sp.cos(theta) / epsilon**2), {"phase": "theta"},
        SplittingError, "leading part (x*cos(theta))/epsilon**2",
    ),
    "a phase that stands": (
        gsp.VectorField({x: sp.cos(theta), theta: alpha / epsilon}, epsilon=epsilon, parameters={alpha: 0}),
        {"phase": "theta"}, SplittingError, "omega = alpha, which is 0 at the parameters' values",
    ),
    "infinitely many harmonics": (
        turning(1 / epsilon, x * sp.exp(sp.cos(theta))), {"phase": "theta"},
        UnsupportedFunctionError, "exp(cos(theta)) has no finite Fourier series in theta",
    ),
    "a saddle": (
        gsp.VectorField({u: v / epsilon, v: u / epsilon}, epsilon=epsilon), {"pair": ("u", "v")},
        SplittingError, "the pair does not turn",
    ),
    "a pair that does not turn about one another": (
        gsp.VectorField({u: (v - u) / epsilon, v: -u / epsilon}, epsilon=epsilon), {"pair": ("u", "v")},
        SplittingError, "do not turn about one another",
    ),
    "a forcing far from resonance": (
        gsp.VectorField({u: v / epsilon, v: -u / epsilon + sp.cos(psi), psi: 2 / epsilon}, epsilon=epsilon),
        {"pair": ("u", "v"), "phase": "psi"}, SplittingError, "not near resonance",
    ),
    "a forcing that is not named": (
        gsp.VectorField({u: v, v: -u + epsilon * sp.cos(psi), psi: 1 + epsilon / 3}, epsilon=epsilon),
        {"pair": ("u", "v")}, SplittingError, "psi moves as fast as u and v turn",
    ),
    "no such state": (turning(1 / epsilon), {"phase": "phi"}, DeclarationError, "phase names 'phi'"),
    "nothing named": (turning(1 / epsilon), {}, DeclarationError, "on the command line --phase theta or --pair u,v"),
    "no small parameter": (
        gsp.VectorField({x: -x, theta: sp.Integer(1)}), {"phase": "theta"}, DeclarationError, "the field has none",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_fast_phase_is_refused_by_name(name: str) -> None:
    field, asked, kind, words = REFUSED[name]
    with pytest.raises(kind) as caught:
        gsp.average(field, **asked)
    assert words in str(caught.value), str(caught.value)


def test_a_phase_that_keeps_its_sign_over_the_region_is_taken() -> None:
    field = turning((sp.exp(x) - x) / epsilon, sp.cos(theta) ** 2)
    found = gsp.average(field, phase="theta", region={"x": (-1, 2)}, order=1)
    assert found.averaged_field[0][x] == sp.Rational(1, 2)


def test_too_large_an_epsilon_is_refused() -> None:
    found = gsp.average(VAN_DER_POL, pair=(u, v), order=3)
    with pytest.raises(GspError, match="could not be inverted"):
        found.base_point({"u": 3, "v": 0}, epsilon=5)


@pytest.mark.parametrize("unit", [sp.Rational(1, 10**15), sp.Rational(1, 10**9), 10**9, 10**15])
def test_base_points_are_known_as_well_in_any_units(unit: sp.Expr) -> None:
    """x = unit X: for a small unit any point was given, by steps that were small beside 1, though none was found."""
    shaken = gsp.VectorField(
        {theta: 1 / epsilon, x: -x + (unit * x) ** 3 / unit * sp.cos(theta)}, epsilon=epsilon
    )
    found = gsp.average(shaken, phase=theta, order=2)
    start = {"x": 1 / float(unit), "theta": 1}
    assert found.base_point(start, epsilon=0.1)["x"] * float(unit) == pytest.approx(0.93734116829, rel=1e-10)
    with pytest.raises(GspError, match="could not be inverted"):
        found.base_point(start, epsilon=3)
    forced = gsp.VectorField(
        {u: v / epsilon, v: -u / epsilon - u**3 * unit**2 + sp.cos(psi) / unit, psi: 1 / epsilon},
        epsilon=epsilon,
    )
    turned = gsp.average(forced, phase=psi, pair=(u, v), order=1)
    point = turned.base_point({"u": 2 / float(unit), "v": 0, "psi": float(sp.pi)}, epsilon=0.05)
    back = [float(e.subs(epsilon, 0.05).subs(point)) for e in turned._full(1)]
    assert np.array(back[:2]) * float(unit) == pytest.approx([-2.0, 0.0], abs=1e-12)


MODEL = """
epsilon = "epsilon"
[states]
u = "v/epsilon"
v = "-u/epsilon + (1 - u^2)*v"
[phase]
pair = ["u", "v"]
[region]
u = [-3, 3]
[start]
u = 1
v = 0
[scene]
span = [0, 2]
epsilon = 0.025
"""


def test_a_model_file_says_what_turns(tmp_path: Path) -> None:
    path = tmp_path / "oscillator.toml"
    path.write_text(MODEL, encoding="utf-8")
    asked = gsp.load(path)
    assert asked.phase == gsp.FastPhase(pair=("u", "v"))
    gsp.save(asked, tmp_path / "again.toml")
    assert gsp.load(tmp_path / "again.toml") == asked
    told = CliRunner().invoke(cli, ["average", str(path), "--order", "1"], catch_exceptions=False).output
    assert "-r*(r - 2)*(r + 2)/8" in told
    answer = CliRunner().invoke(cli, ["average", str(path), "--order", "1", "--json"], catch_exceptions=False)
    found = json.loads(answer.output)
    assert found["averaged_field"][0] == {"r": "-r*(r - 2)*(r + 2)/8"}
    assert found["comparison"]["variables"]["slope"]["values"] == pytest.approx([1, 2], abs=0.1)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('name = "phi"', "the phase names phi, which is no state"),
        ('name = "u"\npair = ["u", "v"]', "u is the phase and one of the pair"),
        ('pair = ["u", "u"]', "pair is two different states"),
        ('pair = "u"', "phase.pair is a pair of names"),
        ("turns = 1", "phase.turns is unknown"),
    ],
)
def test_a_wrong_table_is_refused_by_name(tmp_path: Path, table: str, words: str) -> None:
    path = tmp_path / "oscillator.toml"
    path.write_text(MODEL.replace('pair = ["u", "v"]', table), encoding="utf-8")
    with pytest.raises(GspError, match=r"phase|pair") as caught:
        gsp.load(path)
    assert words in str(caught.value)


def test_a_field_in_fast_time_is_divided_by_epsilon() -> None:
    """The form of most books: x' = epsilon f, theta' = omega."""
    fast = gsp.VectorField({state: epsilon * rate for state, rate in PULLED.equations.items()}, epsilon=epsilon)
    found, expected = (
        gsp.average(each, phase=theta, order=2, region={"x": (-1, 1)}).averaged_field for each in (fast, PULLED)
    )
    assert found == expected
    pair = gsp.VectorField({u: v, v: -u + epsilon * (1 - u**2) * v}, epsilon=epsilon)
    assert gsp.average(pair, pair=(u, v)).averaged_field == gsp.average(VAN_DER_POL, pair=(u, v)).averaged_field
    scene = gsp.Scene(
        pair, {"u": (-3, 3)}, {"u": 1, "v": 0}, (0, 50), 0.1, phase=gsp.FastPhase(pair=("u", "v"))
    )
    found = gsp.average(scene)
    assert found.scene is not None
    assert found.scene.span == (0.0, 5.0)


def test_the_command_line_says_that_time_is_slow(tmp_path: Path) -> None:
    scene = gsp.Scene(
        gsp.VectorField({u: v, v: -u + epsilon * (1 - u**2) * v}, epsilon=epsilon),
        {"u": (-3, 3)}, {"u": 1, "v": 0}, (0, 50), 0.1, phase=gsp.FastPhase(pair=("u", "v")),
    )  # fmt: skip
    gsp.save(scene, tmp_path / "model.toml")
    done = CliRunner().invoke(cli, ["average", str(tmp_path / "model.toml"), "--order", "0"])
    assert done.exit_code == 0, done.output
    assert "the span 0 to 50 becomes 0 to 5" in done.output


def test_the_command_takes_one_small_parameter(tmp_path: Path) -> None:
    done = CliRunner().invoke(cli, ["average", str(tmp_path / "model.toml"), "--small", "g,h"])
    assert done.exit_code == 2
    assert "'g,h' is more than one name. Give one parameter." in done.output


@pytest.mark.parametrize("far", [3, 1000, -(10**6)])
def test_a_pair_turns_about_its_centre_wherever_that_is(far: int) -> None:
    moved = VAN_DER_POL.about({u: sp.Integer(-far), v: sp.Integer(-far)})
    here, there = (gsp.average(field, pair=("u", "v"), order=2) for field in (VAN_DER_POL, moved))
    assert there.averaged_field == here.averaged_field
    assert there.frequency == here.frequency
    base = there.base_point({"u": far + 1, "v": far}, epsilon=0.02)
    assert base == pytest.approx(here.base_point({"u": 1, "v": 0}, epsilon=0.02), rel=1e-9)
    assert [there.form.inverse[z] - here.form.inverse[z] for z in (u, v)] == [far, far]


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_a_phase_averages_wherever_the_slow_variables_have_their_origin(far: int) -> None:
    # omega = 1 + (x - 1000)^2 was said to come near 0.
    moved = PULLED.about({x: sp.Integer(-far), y: sp.Integer(-far)})
    here = gsp.average(PULLED, phase="theta", region={"x": (-3, 3)}, order=1)
    there = gsp.average(moved, phase="theta", region={"x": (far - 3, far + 3)}, order=1)
    back = {x: x + far, y: y + far}
    for rows in (lambda found: found.averaged_field, lambda found: found.transformation):
        for plain, row in zip(rows(here), rows(there), strict=True):
            assert all(sp.simplify(e.xreplace(back) - plain[s]) == 0 for s, e in row.items())
    vibrating = PENDULUM.about({q: sp.Integer(-far), p: sp.Integer(-far)})
    (slow,) = set(gsp.average(vibrating, phase="theta", order=1).form.coordinates) - {q, theta}
    assert gsp.average(vibrating, phase="theta", order=1).averaged_field[0][q] == slow - far


def test_a_field_that_is_not_averaged_far_from_the_origin_is_named_about_its_centre() -> None:
    damped = VAN_DER_POL.about({u: sp.Integer(-1000), v: sp.Integer(-1000)})
    wrong = gsp.VectorField(
        {**damped.equations, u: damped.equations[u] + (u - 1000) ** 2 / epsilon}, epsilon=epsilon
    )
    with pytest.raises(
        SplittingError, match=r"^about u = 1000, v = 1000: u and v do not turn about one another"
    ):
        gsp.average(wrong, pair=("u", "v"))
