"""What may be left out: each candidate's error against runs of SciPy, what is recommended, and where nothing is."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import gsp
from gsp.choice import costs
from gsp.choice.candidates import Candidate, ModelKind, Trial, measured_candidate
from gsp.choice.choice import choose
from gsp.choice.costs import Cost, cost_beside
from gsp.choice.prediction import Failure
from gsp.choice.verdict import Answer
from gsp.cli import cli
from gsp.reductions import measurement, reductions
from gsp.reductions.fast_parts import fast_parts
from gsp.reductions.measurement import field_of
from gsp.reductions.reductions import find_reductions
from gsp.scenes.study import Study

TOLERANCE = 0.05
# k1 = 1: k-1, k2, total enzyme, end of the span. From little enzyme to much, from fast binding to slow.
ENZYMES = [
    (0.5, 0.5, 0.01, 2000.0),
    (0.5, 0.5, 1.0, 20.0),
    (0.5, 0.5, 10.0, 20.0),
    (10.0, 0.1, 1.0, 100.0),
    (1.0, 0.01, 10.0, 1000.0),
    (0.5, 0.5, 0.1, 200.0),
    (0.01, 5.0, 0.1, 40.0),
    (10.0, 10.0, 1.0, 20.0),
    (100.0, 1.0, 5.0, 60.0),
    (0.1, 0.1, 0.02, 1500.0),
]


def scene(
    equations: Mapping[str, str], parameters: Mapping[str, float], start: Mapping[str, float], end: float
) -> gsp.Scene:
    symbols = {name: sp.Symbol(name) for name in (*equations, *parameters)}
    field = gsp.VectorField(
        {symbols[z]: sp.sympify(rate, locals=symbols) for z, rate in equations.items()},
        parameters={symbols[p]: sp.Rational(str(value)) for p, value in parameters.items()},
    )
    return gsp.Scene(field, {}, start, (0, end), tolerance=TOLERANCE)


def enzyme(km: float, k2: float, e0: float, end: float) -> gsp.Scene:
    return scene(
        {"s": "-(e0 - c)*s + km*c", "c": "(e0 - c)*s - (km + k2)*c"},
        {"km": km, "k2": k2, "e0": e0},
        {"s": 1, "c": 0},
        end,
    )


def corrected(kind: str, values: tuple[float, float, float, float], order: int) -> Callable:
    """The reduced rate through `order`: h_n of g(x, h) = epsilon h' f(x, h), where g is linear in y."""
    km, k2, e0, _ = map(sp.nsimplify, values)
    s, c = sp.symbols("s c")
    of_s, of_c = -(e0 - c) * s + km * c, (e0 - c) * s - (km + k2) * c
    x, y, f, g = (s, c, of_s, of_c) if kind == "standard" else (c, s, of_c, of_s)
    slope = sp.diff(g, y)
    h, rates = [sp.cancel(-g.subs(y, 0) / slope)], []
    for n in range(order + 1):
        if n:
            h.append(sp.cancel(sum(sp.diff(h[i], x) * rates[n - 1 - i] for i in range(n)) / slope))
        rates.append(sp.cancel((0 if n else f.subs(y, 0)) + sp.diff(f, y) * h[n]))
    return sp.lambdify(x, sum(rates))


@pytest.mark.parametrize(
    "values", [ENZYMES[1], *(pytest.param(v, marks=pytest.mark.exhaustive) for v in ENZYMES if v != ENZYMES[1])]
)
def test_errors_are_those_of_scipy_and_the_cheapest_that_serves_is_recommended(
    values: tuple[float, float, float, float],
) -> None:
    km, k2, e0, end = values
    found = find_reductions(enzyme(*values))

    def bound(total: np.ndarray | float, loss: float) -> np.ndarray | float:
        """The smaller root c of (e0 - c)(total - c) = loss c."""
        b = e0 + total + loss
        return 2 * e0 * total / (b + np.sqrt(b * b - 4 * e0 * total))

    # The slow variable of each, its rate, and its start: what it is of (s, c).
    reductions: dict[str, tuple[Callable, Callable, float]] = {
        "standard": (
            lambda s, c: s,
            lambda s: km * e0 * s / (s + km + k2) - e0 * s * (km + k2) / (s + km + k2),
            1.0,
        ),
        "reverse": (lambda s, c: c, lambda c: -k2 * c, 0.0),
        "total": (lambda s, c: s + c, lambda t: -k2 * bound(t, km + k2), 1.0),
        "partial": (lambda s, c: s + c, lambda t: -k2 * bound(t, km), 1.0),
    }
    options = {"rtol": 1e-10, "atol": 1e-13, "method": "LSODA", "dense_output": True}
    full = solve_ivp(
        lambda t, z: [-(e0 - z[1]) * z[0] + km * z[1], (e0 - z[1]) * z[0] - (km + k2) * z[1]],
        (0, end), [1.0, 0.0], **options,
    )  # fmt: skip
    for own in found.found:
        kind = own.name.split()[0]
        if not np.isfinite(own.error) or (own.order and kind not in ("standard", "reverse")):
            continue
        of, rate, first = reductions[kind]
        if own.order:
            base = gsp.study(own.scene).base_point(own.order)
            rate, first = corrected(kind, values, own.order), base[{"standard": "s", "reverse": "c"}[kind]]
        reduced = solve_ivp(lambda t, x, rate=rate: [rate(x[0])], (0, end), [first], **options)
        begun, ended = own.measured
        times = begun + (ended - begun) * np.append(0.0, np.geomspace(1e-6, 1.0, 20_000))
        exact = of(*full.sol(times))
        error = np.abs(reduced.sol(times)[0] - exact).max() / np.abs(exact).max()
        assert own.error == pytest.approx(error, rel=0.02), repr(own)
    assert len({each.name for each in found.found if each.order == 0 and np.isfinite(each.error)}) >= 2
    serving = [each for each in found.found if not each.why_not]
    assert all(each.error <= TOLERANCE for each in serving)
    if found.recommended is None:
        assert not serving
    else:
        best = found.recommended
        assert best in serving
        assert not any(cost_beside(o.candidate, best.candidate) is Cost.LESS for o in serving)


ALONE = {
    "predator": ({"x": "x*(1 - y)", "y": "y*(x - 1)"}, {}, {"x": 2, "y": 1}, 20),
    "oscillator": ({"x": "v", "v": "-x"}, {}, {"x": 1, "v": 0}, 20),
    "lorenz": (
        {"x": "10*(y - x)", "y": "x*(28 - z) - y", "z": "x*y - 8*z/3"}, {}, {"x": 1, "y": 1, "z": 1}, 20,
    ),
    "kuramoto": (
        {"a": "w + sin(b - a) + sin(c - a)", "b": "3*w + sin(a - b) + sin(c - b)",
         "c": "-4*w + sin(a - c) + sin(b - c)"},
        {"w": 0.1}, {"a": 0, "b": 1, "c": 2}, 20,
    ),
    "diffusion": (
        {"a": "b - 2*a", "b": "a + c - 2*b", "c": "b + d - 2*c", "d": "c - 2*d + 1"}, {},
        {"a": 1, "b": 0, "c": 0, "d": 0}, 20,
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [n if n in ("predator", "oscillator") else pytest.param(n, marks=pytest.mark.exhaustive) for n in ALONE],
)
def test_nothing_is_offered_where_nothing_is_separated(name: str) -> None:
    found = find_reductions(scene(*ALONE[name]))
    assert found.recommended is None
    assert found.taken is None
    assert found.reason.startswith("Do not reduce")


@pytest.mark.parametrize("cells", [3, pytest.param(6, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("tolerance", [0.2, pytest.param(1e-3, marks=pytest.mark.exhaustive)])
def test_a_diffusion_line_of_any_length_is_left_whole_at_any_tolerance(cells: int, tolerance: float) -> None:
    # Rates of neighbouring modes are sin^2 of multiples of one angle: at most four times apart.
    names = [f"u{k}" for k in range(cells)]
    rates = {
        u: f"{names[k - 1] if k else '0'} - 2*{u} + {names[k + 1] if k + 1 < cells else '1'}"
        for k, u in enumerate(names)
    }
    asked = scene(rates, {}, {u: float(u == "u0") for u in names}, 20)
    found = find_reductions(asked, tolerance=tolerance)
    assert found.found == ()
    assert found.taken is None
    assert "nothing is separated" in found.reason


RAW = {
    "motor": (
        {"i": "(V - R*i - k*w)/L", "w": "(k*i - b*w)/J"},
        {"V": 12, "R": 1, "L": 0.002, "k": 0.1, "b": 0.001, "J": 0.01}, {"i": 0, "w": 0}, 5,
        "quasi-steady state of i", ["w"],
    ),
    "battery": (
        {"q": "-I/3600", "u1": "I/C1 - u1/(R1*C1)", "u2": "I/C2 - u2/(R2*C2)"},
        {"I": 1, "R1": 0.01, "C1": 1000, "R2": 0.02, "C2": 50000}, {"q": 1, "u1": 0, "u2": 0}, 3600,
        "quasi-steady state of u1", ["q", "u2"],
    ),
    "power": (
        {"d": "w", "w": "(Pm - E*V*sin(d)/X - D*w)/M", "E": "(Ka*(Vr - E) - E*(1 - cos(d))/10)/Ta"},
        {"Pm": 0.8, "V": 1, "X": 0.5, "D": 1, "M": 5, "Ka": 20, "Vr": 1.1, "Ta": 0.5}, {"d": 0.3, "w": 0, "E": 1}, 20,
        "quasi-steady state of E", ["d", "w"],
    ),
    "epidemic": (
        {"S1": "-b1*S1*I1 + m*(S2 - S1)", "I1": "b1*S1*I1 - g*I1 + m*(I2 - I1)",
         "S2": "-b2*S2*I2 + m*(S1 - S2)", "I2": "b2*S2*I2 - g*I2 + m*(I1 - I2)"},
        {"b1": 0.6, "b2": 0.3, "g": 0.1, "m": 20}, {"S1": 0.99, "I1": 0.01, "S2": 1, "I2": 0}, 60,
        "partial equilibria of", None,
    ),
    "drug": (
        {"C": "-kel*C - kon*C*R + koff*RC", "R": "ksyn - kdeg*R - kon*C*R + koff*RC",
         "RC": "kon*C*R - (koff + kint)*RC"},
        {"kel": 0.1, "kon": 100, "koff": 10, "ksyn": 0.1, "kdeg": 0.1, "kint": 0.2}, {"C": 5, "R": 1, "RC": 0}, 30,
        "RC <-> C + R", None,
    ),
    "joint": (
        {"q1": "v1", "v1": "-k/mu^2*(q1 - q2)/M1 - d/mu*(v1 - v2)/M1 + u - c*v1", "q2": "v2",
         "v2": "k/mu^2*(q1 - q2)/M2 + d/mu*(v1 - v2)/M2 - g*sin(q2)"},
        {"k": 1, "mu": 0.05, "d": 1, "M1": 1, "M2": 2, "u": 0.5, "c": 0.2, "g": 1},
        {"q1": 0, "v1": 0, "q2": 0, "v2": 0}, 20, "quasi-steady state along", None,
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", RAW)
def test_raw_equations_lead_to_the_right_reduced_model(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(costs, "_seconds", lambda run: float(run().stats.field_calls))
    *given, words, slow = RAW[name]
    found = find_reductions(scene(*given))
    assert found.recommended is not None
    assert words in found.recommended.name
    study = gsp.study(found.recommended.scene)
    if slow is not None:
        assert [s.name for s in study.system.x] == slow
    assert f"->{found.recommended.name}" in str(found)
    assert found.taken is found.recommended
    # One answer to one question: what the table recommends `choose` does not turn down, with the same error.
    assert found.study is not None
    choice = choose(found.study, fast=found.recommended.counts_fast)
    assert choice.verdict.answer in (Answer.YES, Answer.AS_FAST, Answer.NO_GAIN)
    (own,) = [c for c in choice.candidates if c.order == found.recommended.order]
    assert own.predicted == found.recommended.error


@pytest.mark.exhaustive
def test_what_slows_the_machine_while_one_candidate_is_looked_at_changes_no_recommendation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(costs, "_seconds", lambda run: float(run().stats.field_calls))
    quiet = find_reductions(enzyme(*ENZYMES[3]))
    assert len({each.name for each in quiet.found if not each.why_not}) > 2
    load = 1.0

    def choose_under_load(study: gsp.Study, **how) -> gsp.Choice:
        nonlocal load
        load *= 1e-3
        choice = gsp.choose(study, **how)
        flows = [replace(c, timings=tuple(load * t for t in c.timings)) for c in choice.candidates[:-1]]
        return replace(choice, candidates=(*flows, choice.candidates[-1]))

    monkeypatch.setattr(measurement, "choose", choose_under_load)
    found = find_reductions(enzyme(*ENZYMES[3]))
    assert found.recommended.name == quiet.recommended.name
    assert found.recommended.seconds == quiet.recommended.seconds


@pytest.mark.exhaustive
def test_a_parameter_within_a_function_hides_no_candidate() -> None:
    """Surface and deep ocean: T1/d stands in the tanh of the albedo, and T is fast by itself."""
    rates = {"T": "(340*(0.6 + 0.1*tanh((T - T1)/d)) - 203 - 2.1*T - 0.7*(T - D))/8", "D": "0.7*(T - D)/1000"}
    found = find_reductions(scene(rates, {"T1": 0, "d": 10}, {"T": 8, "D": 4}, 1000))
    assert found.recommended is not None
    assert found.recommended.name == "quasi-steady state of T"


@pytest.mark.exhaustive
def test_a_conserved_sum_alone_is_no_reduced_model() -> None:
    # Calcium, two buffers, a store and a pump: ca + b + q + 10 er stays, and everything else decays in the span.
    pumped, leaked = "30*ca**2/(4/25 + ca**2)", "5 + (er - ca)/10"
    given = scene(
        {
            "ca": f"{leaked} - {pumped} - on*ca*(20 - b) + off*b - bind*ca*(10 - q) + free*q",
            "b": "on*ca*(20 - b) - off*b",
            "q": "bind*ca*(10 - q) - free*q",
            "er": f"({pumped} - ({leaked}))/10",
        },
        {"on": 500, "off": 250, "bind": 8, "free": 3},
        {"ca": 1, "b": 0, "q": 0, "er": 40},
        20,
    )
    found = find_reductions(given)
    assert found.taken is not None
    for each in {r.name: r for r in found.found}.values():
        assert any(rate != 0 for rate in gsp.study(each.scene).series(0).reduced_field[0]), each.name


def test_where_nothing_decays_within_the_span_that_is_said() -> None:
    found = find_reductions(scene({"a": "1 - a/40", "b": "a - b/80"}, {}, {"a": 0, "b": 1}, 10))
    assert found.reason == (
        "Do not reduce: over most of t = 0 to 10 the fastest mode that decays takes 4 times as long as that."
    )


@pytest.mark.exhaustive
def test_corrections_are_not_looked_at_where_nothing_is_separated() -> None:
    """A laser whose field decays as slowly as the run is long: the series of E diverges, and its runs take minutes."""
    rates = {"E": "P - E", "P": "200*(E*D - P)", "D": "0.2*(3 - D - E*P)"}
    found = find_reductions(scene(rates, {}, {"E": 0.1, "P": 0.1, "D": 1}, 30))
    assert found.recommended is not None
    assert found.recommended.name == "quasi-steady state of P"
    of_e = [each for each in found.found if each.name == "quasi-steady state of E"]
    assert all(each.why_not and each.order <= 1 for each in of_e)
    assert of_e


@pytest.mark.exhaustive
def test_two_fast_variables_with_scales_of_their_own_are_left_out_together() -> None:
    """An amplifier's input node and output, rates 1e9 and 6e5, in front of a filter of 1 ms."""
    rates = {
        "vm": "((1 - vm)/1000 - (vm - vo)/10000)/1e-12",
        "vo": "-6.28e6*vm - 62.8*vo",
        "vc": "1000*(vo - vc)",
    }
    found = find_reductions(scene(rates, {}, {"vm": 0, "vo": 0, "vc": 0}, 0.01))
    both = [each for each in found.found if each.name == "quasi-steady state of vm, vo"]
    assert both
    assert not any(each.why_not for each in both)


@pytest.mark.exhaustive
def test_a_reactor_with_a_fast_wall_is_looked_at_to_the_end() -> None:
    """At T = 0 Arrhenius' law has no value, and reduced flows of what is slow blow up: neither ends the search."""
    rates = {
        "c": "-k*c*exp(-E/T)",
        "T": "q*k*c*exp(-E/T) - h*(T - W)",
        "W": "(h*(T - W) - (W - Tc))/tau",
    }
    values = {"k": 1e6, "E": 15, "q": 2, "h": 1, "Tc": 1, "tau": 0.01}
    found = find_reductions(scene(rates, values, {"c": 1, "T": 1, "W": 1}, 10))
    wall = min(found.special, key=lambda each: np.inf if each.error is None else each.error)
    assert wall.vanishing == ("tau",)
    # By SciPy, in the tenth of a time in which the reaction runs away; 1.5e-3 at 97 times spread evenly.
    assert wall.error == pytest.approx(0.1801, rel=0.02)
    T, W, h, Tc = sp.symbols("T W h Tc")
    assert sp.simplify(wall.graph[W] - (h * T + Tc) / (h + 1)) == 0
    # The reaction is faster than the wall while it runs away.
    assert found.recommended is None


@pytest.mark.exhaustive
def test_what_fades_over_the_run_is_not_fast_in_it() -> None:
    # exp(-t/1000) over an hour: its layer would take half of the span.
    found = find_reductions(scene(*RAW["battery"][:4]), tolerance=0.05)
    assert all("u2" not in each.name or each.why_not for each in found.found)
    longer = find_reductions(scene(*RAW["battery"][:3], 3600 * 24))
    assert any("u1, u2" in each.name and not each.why_not for each in longer.found)


@pytest.mark.exhaustive
def test_the_parameter_that_divides_the_fast_rate_is_named() -> None:
    found = find_reductions(scene(*RAW["motor"][:4]))
    assert found.recommended is not None
    assert str(found.recommended.scene.system.epsilon) == "L"


@pytest.mark.exhaustive
def test_a_parameter_that_divides_fast_rates_but_makes_one_direction_fast_is_not_named() -> None:
    """R between two nodes of one temperature stands under both rates, and Tr - Ta alone is fast by it."""
    rates = {"Tr": "(1 - (Tr - Ta)/R)/C", "Ta": "((Tr - Ta)/R - (Ta - Tw)/S)/C", "Tw": "(Ta - 2*Tw)/50"}
    values = {"R": 0.01, "S": 0.1, "C": 0.1}
    found = find_reductions(scene(rates, values, {"Tr": 0, "Ta": 0, "Tw": 0}, 100))
    (both,) = [each for each in found.found if each.name == "quasi-steady state of Tr, Ta" and each.order == 0]
    assert [s.name for s in gsp.study(both.scene).system.x] == ["Tw"]


@pytest.mark.exhaustive
def test_a_scene_with_a_small_parameter_is_looked_at_without_it() -> None:
    found = find_reductions(gsp.models.load("linear"), tolerance=0.1)
    assert found.scene.epsilon is None
    assert found.scene.tolerance == 0.1


def test_special_values_of_the_parameters_stand_beside_with_their_errors() -> None:
    km, k2, e0, end = 0.5, 0.5, 0.1, 200.0
    found = find_reductions(enzyme(km, k2, e0, end))
    (little,) = [each for each in found.special if each.vanishing == ("e0",)]
    assert little.error == min(each.error for each in found.special)
    full = solve_ivp(
        lambda t, z: [-(e0 - z[1]) * z[0] + km * z[1], (e0 - z[1]) * z[0] - (km + k2) * z[1]],
        (0, end), [1.0, 0.0], rtol=1e-10, atol=1e-13, method="LSODA", dense_output=True,
    )  # fmt: skip
    reduced = solve_ivp(
        lambda t, s: -e0 * k2 * s / (km + k2 + s), (0, end), [1.0], rtol=1e-10, atol=1e-13, dense_output=True
    )
    times = np.linspace(0, end, 4001)
    # At e0 = 0 the layer leads along s = 1 to c = 0 where it begins.
    assert little.error == pytest.approx(np.abs(full.sol(times)[0] - reduced.sol(times)[0]).max(), rel=0.02)
    assert "motion onto c = 0, for small e0" in str(found)
    assert {"vanishing": ["e0"], "manifold": ["c"], "error": little.error} in found.as_dict()["special"]
    # A name of more than half a line has a line of its own, and moves no column.
    long = replace(found, found=(replace(found.found[0], name="of " + 80 * "x"), *found.found[1:]))
    _, heading, name, numbers, *_ = str(long).splitlines()
    assert name == f"    of {80 * 'x'}"
    assert len(numbers) - len(numbers.lstrip()) + 1 == heading.index("order") + len("order")


@pytest.mark.exhaustive
def test_a_parameter_that_divides_a_rational_rate_is_a_special_value_with_its_error() -> None:
    tau, end = 0.01, 4.0
    equations = {"u": "p - u*o", "o": "(u**2/(1 + u**2) - o)/tau"}
    found = find_reductions(scene(equations, {"p": 1, "tau": tau}, {"u": 0.5, "o": 0.2}, end))
    (fast_gate,) = [each for each in found.special if each.vanishing == ("tau",)]
    # The start is on o = u^2/(1 + u^2), so that no layer comes before.
    runs = [
        solve_ivp(rates, (0, end), begin, rtol=1e-10, atol=1e-13, method="LSODA", dense_output=True)
        for rates, begin in (
            (lambda t, z: [1 - z[0] * z[1], (z[0] ** 2 / (1 + z[0] ** 2) - z[1]) / tau], [0.5, 0.2]),
            (lambda t, u: 1 - u**3 / (1 + u**2), [0.5]),
        )
    ]
    full, reduced = (run.sol(np.linspace(0, end, 4001))[0] for run in runs)
    assert fast_gate.error == pytest.approx(np.abs(full - reduced).max() / full.max(), rel=0.02)


@pytest.mark.exhaustive
def test_where_no_part_with_a_name_serves_a_special_value_may() -> None:
    # Neither u nor v alone is fast, the fast direction turns along the run, and no rate is that of a reaction.
    k = {"a": 1, "b": 1, "k": 0.01}
    equations = {"u": "a*(v**2 - u*v) - k*u*v", "v": "b*(u*v - v**2)*u - k*v**3"}
    found = find_reductions(scene(equations, k, {"u": 2, "v": 1}, 100))
    assert found.recommended is not None
    assert found.recommended.name == "motion onto u - v = 0, for small k"
    assert found.recommended.error <= TOLERANCE
    # It has one error, that of the candidate.
    assert str(found).count("motion onto u - v = 0, for small k") == 2
    assert not found.near


@pytest.mark.exhaustive
def test_states_that_are_fast_together_are_a_candidate_however_many_they_are() -> None:
    """Four states relax together onto a slow fifth; sets of four are not tried one by one."""
    equations = {
        "i": "(24 - i*4/5 - w/20)/La",
        "w": "(i/20 - w/50000 - w**2/2500000)/J",
        "p": "(w/100 - q)/Cv",
        "q": "(p - q*3/10)/Ih",
        "T": "(i**2*4/5 - (T - 25)/2)/300",
    }
    parameters = {"La": 0.0006, "J": 0.0004, "Cv": 0.004, "Ih": 0.0008}
    found = find_reductions(scene(equations, parameters, {**dict.fromkeys("iwpq", 0), "T": 25}, 3))
    # Which of those that serve is the cheapest the clock says.
    assert "quasi-steady state of i, w, p, q" in {each.name for each in found.found if not each.why_not}
    assert "Fast there: i, w, p, q" in found.scales.message


@pytest.mark.exhaustive
def test_where_a_clock_drives_the_fast_variables_are_what_counts() -> None:
    """A quarter car on a wavy road: with all of it left out the phase of the road is exact, and tells nothing."""
    equations = {
        "zs": "vs",
        "vs": "(-160*(zs - zu) - 15*(vs - vu))/3",
        "zu": "vu",
        "vu": "(160*(zs - zu) + 15*(vs - vu) - 4000*(zu - sin(s)/50))*100/15",
        "s": "3",
    }
    plain = scene(equations, {}, {"zs": 0.05, "vs": 0, "zu": 0, "vu": 0, "s": 0}, 6)
    (whole,) = fast_parts(field_of(plain), large=[list(field_of(plain).states[:4])])[-1:]
    assert whole.count == 4
    led = measurement.measure(plain, whole, np.full(4, 100.0))
    assert led
    assert all(each.counts_fast and each.why_not and not each.error < 0.1 for each in led)
    # Its wheel alone is fast: to order 0 it has no damper, and the error is a seventh.
    best = find_reductions(plain)
    assert best.recommended is not None
    assert best.recommended.name == "quasi-steady state of zu, vu"
    assert best.recommended.order > 0
    assert [each.error > 0.1 for each in best.found if each.name == best.recommended.name].count(True) == 1


@pytest.mark.exhaustive
def test_what_grows_from_what_the_layer_leaves_is_reduced_from_order_1_on() -> None:
    """Virions that infect a cell each fade at once: to order 0 nobody is infected, to order 1 the infection spreads."""
    rates = {"T": "10**4 - T/100 - k*V*T", "I": "k*V*T - 7*I/10", "V": "2100*I - 23*V"}
    plain = scene(rates, {"k": 2.4e-8}, {"T": 1e6, "I": 0, "V": 1000}, 100)
    found = find_reductions(plain)
    assert found.recommended is not None
    assert found.recommended.name == "quasi-steady state of V"
    assert found.recommended.order > 0
    # The order 0 stays where nobody is infected; what is kept moves all the same.
    assert not found.recommended.counts_fast
    errors = {each.order: each.error for each in found.found if each.name == found.recommended.name}
    assert errors[0] > 0.9
    assert errors[1] < TOLERANCE
    assert found.nearest is not None
    assert (found.nearest.name, found.nearest.order) == (found.recommended.name, 1)
    told = find_reductions(plain, tolerance=1e-5)
    assert told.nearest is not None
    assert f"{errors[1]:.2g} to order 1, and {errors[3]:.2g} to order 3" in told.reason
    choice = choose(found.study)
    assert (choice.verdict.answer in (Answer.YES, Answer.AS_FAST), choice.names) == (True, ("T", "I"))


@pytest.mark.exhaustive
def test_the_order_in_the_table_is_the_one_in_the_answer() -> None:
    found = find_reductions(enzyme(0.01, 5.0, 0.1, 40.0), tolerance=1e-5)
    assert found.study is not None
    choice = choose(found.study)
    serving = [c for c in choice.candidates[:-1] if c.valid]
    assert len(serving) > 1
    for quickest in serving:
        costs = [
            replace(c, timings=(1.0, 1.0) if c is quickest else (5.0, 5.0)) for c in choice.candidates[:-1]
        ]
        full = replace(choice.candidates[-1], timings=(0.1, 0.1))
        made = replace(choice, candidates=(*costs, full), model=full)
        told = found.with_costs(made)
        assert told.recommended is not None
        assert told.recommended.order == quickest.order
        assert f", to order {quickest.order}; its error" in told.reason


@pytest.mark.exhaustive
def test_a_filter_that_a_slow_oscillator_drives_is_measured_by_what_it_lets_through() -> None:
    """epsilon y' = u - y with u = cos t: y = u + epsilon sin t - ..., and u and v are exact at any order."""
    driven = scene({"u": "v", "v": "-u", "y": "100*(u - y)"}, {}, {"u": 1, "v": 0, "y": 0}, 12)
    found = {each.order: each for each in find_reductions(driven, tolerance=1e-5).found}
    assert all(each.counts_fast for each in found.values())
    assert found[0].error == pytest.approx(0.01, rel=0.02)
    assert found[1].error == pytest.approx(1e-4, rel=0.05)
    own = gsp.choose(found[0].scene, fast=True)
    assert own.candidates[0].predicted == pytest.approx(0.01, rel=0.05)


@pytest.mark.exhaustive
def test_what_two_compartments_exchange_is_found_in_their_own_volumes() -> None:
    """c1' = -Q (c1 - c2)/V1 - ..., c2' = Q (c1 - c2)/V2: the amount V1 c1 + V2 c2 is slow, by the parameters' names."""
    c1, c2, V1, V2, Q, most, half = sp.symbols("c1 c2 V1 V2 Q most half")
    lost = most * c1 / (half + c1)
    field = gsp.VectorField(
        {c1: -Q / V1 * (c1 - c2) - lost / V1, c2: Q / V2 * (c1 - c2)},
        parameters={V1: 5, V2: 20, Q: 40, most: 3, half: 2},
    )
    found = find_reductions(gsp.Scene(field, {}, {"c1": 10, "c2": 0}, (0, 40), tolerance=1e-3))
    assert found.recommended is not None
    assert found.recommended.name == "partial equilibrium of (V1/V2) c2 <-> c1"
    study = Study(found.recommended.scene)
    assert study.splitting is not None
    (p,) = study.system.x
    slow = study.splitting.coordinates[p]
    # The amount, but for a constant factor.
    assert not sp.simplify(sp.Matrix([slow, V1 * c1 + V2 * c2]).jacobian([c1, c2]).det())


def test_what_is_fast_leaves_the_rest_of_the_rates() -> None:
    """x' = (y - x)/epsilon - x^2: not (1/epsilon - 1)(y - x) + (y - x) - x^2. At epsilon = 1 it is the model."""
    x, y, k, c = sp.symbols("x y k c")
    field = gsp.VectorField({x: k * (y - x) - c * x**2, y: k * (x - y) - y}, parameters={k: 50, c: 2})
    (part,) = [each for each in fast_parts(field) if each.name == "partial equilibrium of y <-> x"]
    made = part.field(field)
    for z in (x, y):
        assert sp.expand(made.equations[z].subs(made.epsilon, 1) - field.equations[z]) == 0
    assert {z: sp.expand(rate).coeff(made.epsilon, 0) for z, rate in made.equations.items()} == {
        x: -c * x**2,
        y: -y,
    }


def test_terms_with_the_same_states_and_rates_of_their_own_are_no_exchange() -> None:
    """x is made at the rate a y and lost at b x; y is made at c x and lost at d y: no one flow goes there and back."""
    x, y, a, b, c, d = sp.symbols("x y a b c d")
    field = gsp.VectorField({x: a * y - b * x, y: c * x - d * y}, parameters={a: 1, b: 200, c: 3, d: 4})
    assert not [part.name for part in fast_parts(field) if "equilibrium" in part.name]


@pytest.mark.exhaustive
def test_what_was_reached_is_told_where_nothing_serves() -> None:
    """The corrections of the nearest candidate stand in the table and in the reason, with their error."""
    x, y = sp.symbols("x y")
    field = gsp.VectorField({x: -x + y / 2, y: 20 * (sp.sin(x) - y)})
    found = find_reductions(gsp.Scene(field, {}, {"x": 1, "y": 0}, (0, 5), tolerance=1e-9))
    assert found.recommended is None
    best = min((each for each in found.found if each.name == "quasi-steady state of y"), key=lambda e: e.error)
    assert best.order > 0
    assert f"{best.error:.2g} to order {best.order}." in found.reason
    assert best in found.shown()


@pytest.mark.exhaustive
def test_one_run_has_one_cost() -> None:
    """Where the one taken is chosen from again, the table has the costs of that choice."""
    x, y = sp.symbols("x y")
    field = gsp.VectorField({x: -x + y / 2, y: 50 * (sp.sin(x) - y)})
    found = find_reductions(gsp.Scene(field, {}, {"x": 1, "y": 0}, (0, 5), tolerance=1e-3))
    assert found.recommended is not None
    choice = choose(found.recommended.scene, tolerance=1e-3)
    told = found.with_costs(choice)
    assert told.recommended in told.found
    order = told.recommended.order
    (own,) = [c for c in choice.candidates if c.order == order]
    assert (told.recommended.seconds, told.recommended.full_seconds) == (
        own.seconds,
        choice.candidates[-1].seconds,
    )
    others = [(a, b) for a, b in zip(found.found, told.found) if a.name != found.recommended.name]
    assert all(a is b for a, b in others)


def test_every_reaction_of_many_is_a_candidate_by_itself() -> None:
    """A chain of 13 states has 12 reactions, of which 66 pairs are too many: neither hides the 12 nor all together."""
    states, there, back = sp.symbols("x1:14"), sp.symbols("k1:13"), sp.symbols("m1:13")
    rates = dict.fromkeys(states, sp.Integer(0))
    for (one, other), k, m in zip(itertools.pairwise(states), there, back):
        flow = k * one - m * other
        rates = {**rates, one: rates[one] - flow, other: rates[other] + flow}
    field = gsp.VectorField(rates, parameters=dict.fromkeys((*there, *back), 1))
    names = [part.name for part in fast_parts(field) if "equilibri" in part.name]
    assert len([name for name in names if name.startswith("partial equilibrium of")]) == 12
    assert len([name for name in names if name.count(" and ") == 11]) == 1
    assert not [name for name in names if name.count(" and ") == 1]


@pytest.mark.exhaustive
def test_as_many_directions_as_states_leave_nothing_slow_and_are_no_candidate() -> None:
    """Of 0 <-> x + y and x <-> y together every motion is fast."""
    equations = {"x": "a - b*x*y - c*x + d*y", "y": "a - b*x*y + c*x - d*y"}
    found = find_reductions(scene(equations, {"a": 1, "b": 30, "c": 1, "d": 2}, {"x": 2, "y": 1}, 10))
    assert not [each for each in found.found if " and " in each.name]


def test_what_is_bound_for_good_is_no_complex() -> None:
    """Standard and reverse quasi-steady states are of complexes that come apart again."""
    s, e, c, k, m = sp.symbols("s e c k m")
    bound = {s: -k * s * e, e: -k * s * e + m * c, c: k * s * e - m * c}
    names = [part.name for part in fast_parts(gsp.VectorField(bound, parameters={k: 1, m: 1}))]
    assert not [name for name in names if name.startswith(("standard", "reverse", "total"))]


@pytest.mark.parametrize(
    ("failure", "error", "valid"),
    [
        (Failure.ERROR, 5e-4, True),
        (Failure.UNTOLD, 5e-4, True),
        (Failure.UNTOLD, 2e-3, False),
        (None, 2e-3, False),
        (Failure.GAP, 5e-4, False),
        (Failure.KINK, 5e-4, False),
    ],
)
def test_an_error_that_was_measured_goes_before_what_is_predicted(
    failure: Failure | None, error: float, valid: bool
) -> None:
    """It says yes where nothing tells the error, and no where a prediction is too good; it mends no loss of the gap."""
    asked = replace(gsp.models.load("michaelis_menten"), tolerance=1e-3)
    predicted = Candidate(ModelKind.REDUCED, 1, 1e-5, 2.0, valid=failure is None, failure=failure)
    found = measured_candidate(Trial(predicted), error, asked).candidate
    assert found.valid is valid
    if failure in (Failure.GAP, Failure.KINK):
        assert found == predicted
    else:
        assert found.is_measured
        assert found.predicted == error
        assert found.holds_until == (asked.span[1] if valid else 2.0)


@pytest.mark.exhaustive
def test_choose_takes_the_errors_that_a_study_has() -> None:
    study = gsp.study(gsp.models.load("michaelis_menten"))
    told = choose(study, solve=False, tolerance=1e-3)
    serving = min(c.order for c in told.candidates if c.order is not None and c.valid)
    asked = replace(study, measured={serving: 2e-3})
    (now,) = [c for c in choose(asked, solve=False, tolerance=1e-3).candidates if c.order == serving]
    assert not now.valid
    assert now.why_not == "its error, measured over the span, is 2.0e-03"
    # At another epsilon the errors are others.
    assert asked.asking(epsilon=0.01).measured == {}
    assert asked.asking(tolerance=0.01).measured == asked.measured


@pytest.mark.exhaustive
def test_where_only_the_solved_manifold_serves_it_is_what_may_be_left_out(tmp_path) -> None:
    """A Hill function with an exponent of 5/2 near 0: its series is past its best order, and the manifold is smooth."""
    states = {"x": "1/5 + y - x", "y": "20*(x^n/(K^n + x^n) - y)"}
    asked = scene(states, {"n": 2.5, "K": 0.4}, {"x": 0.1, "y": 1}, 5)
    found = find_reductions(asked, tolerance=1e-4)
    assert (found.recommended, found.solved) == (None, True)
    assert "quasi-steady state of y, on its solved manifold" in found.reason
    choice = gsp.choose(found.study, tolerance=1e-4)
    assert any(c.kind == "solved" and c.valid for c in choice.candidates)
    loose = find_reductions(asked, tolerance=0.01)
    assert not loose.solved
    gsp.save(replace(asked, tolerance=1e-4), tmp_path / "hill.toml")
    done = CliRunner().invoke(cli, ["choose", str(tmp_path / "hill.toml")])
    assert "May I reduce? Yes" in done.output
    assert "Do not reduce" not in done.output


@pytest.mark.exhaustive
def test_a_region_that_a_run_found_is_no_limit_in_the_verdict_either(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two tanks: the reduced run of order 0 leaves the interval of p that the full run keeps to."""
    monkeypatch.setattr(costs, "_seconds", lambda run: float(run().stats.field_calls))
    states = {"h1": "(1/10 - 5*(h1 - h2))/A", "h2": "(5*(h1 - h2) - 3/10*sqrt(h2))/B"}
    asked = scene(states, {"A": 0.002, "B": 3}, {"h1": 0.5, "h2": 0.4}, 40)
    found = find_reductions(asked, tolerance=1e-4)
    first = found.recommended
    assert first is not None
    assert (first.order, first.candidate.failure) == (0, None)
    (own,) = (c for c in choose(found.study).candidates if c.order == 0)
    assert own.valid
    assert own.predicted == first.error


@pytest.mark.exhaustive
def test_a_sum_that_is_all_but_conserved_is_no_reduced_model() -> None:
    """Dengue over two years: the people p = S + I + R stay, and the epidemic, which all of it is about, is no layer."""
    rates = {
        "S": "mu - b*m*S*V + w*R - mu*S",
        "I": "b*m*S*V - g*I",
        "R": "g*I - w*R - mu*R",
        "V": "b*(1 - V)*I - nu*V",
    }
    values = {"mu": "1/25000", "b": 0.35, "nu": "1/7", "m": 2, "g": "1/6", "w": "1/700"}
    found = find_reductions(scene(rates, values, {"S": 0.5, "I": 0.001, "R": 0.499, "V": 0.001}, 700))
    assert found.recommended is None
    assert not found.solved


@pytest.mark.exhaustive
def test_the_error_is_told_over_what_it_was_measured_on() -> None:
    given = {"x": "-x", "y": "20*(x - y)"}
    found = find_reductions(scene(given, {}, {"x": 1, "y": 3}, 2))
    assert found.recommended is not None
    assert found.recommended.counts_fast
    begin, end = found.recommended.measured
    assert begin > 0.1
    assert f"its error over t = {begin:.4g} to {end:.4g} is {found.recommended.error:.2g}" in found.reason


@pytest.mark.exhaustive
def test_the_complex_of_a_total_quasi_steady_state_is_the_fast_variable() -> None:
    """Robertson's b, of which there is 4e-5: what is told of the fast variables is told of it, and not of p - b."""
    rates = {"a": "-k1*a + k3*b*c", "b": "k1*a - k3*b*c - k2*b**2", "c": "k2*b**2"}
    found = find_reductions(scene(rates, {"k1": 0.04, "k2": 3e7, "k3": 1e4}, {"a": 1, "b": 0, "c": 0}, 400))
    assert found.recommended is not None
    assert found.recommended.name == "total quasi-steady state of b in a <-> b"
    assert found.study is not None
    assert [s.name for s in found.study.system.y] == ["b"]
    # b begins at 0, its largest value away from where it is slaved.
    assert choose(found.study).layer_error == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize(
    ("error", "said"), [(0.004, "but the tolerance needs"), (0.02, "no candidate stays within")]
)
def test_that_nothing_stays_within_the_tolerance_is_said_only_where_it_is_so(error: float, said: str) -> None:
    found = find_reductions(scene({"x": "-x", "y": "60*(x - y)"}, {}, {"x": 1, "y": 1}, 4))
    assert found.nearest is not None
    needs = "the tolerance needs time scales 6.9 times apart: 5.0"
    first = replace(found.nearest, error=0.08)
    second = replace(found.nearest, order=1, error=error, why_not=needs)
    told = reductions._reason(
        replace(found.scene, tolerance=0.01), [first, second], None, first, np.array([5.0]), False
    )
    assert told.startswith("Do not reduce: ")
    assert said in told
    assert ("no candidate stays within" in told) is (error > 0.01)


@pytest.mark.exhaustive
def test_what_is_told_of_an_order_is_told_of_its_own_run() -> None:
    """A beam on a stiff contact: the fast pair oscillates to order 0, and only that run goes on for ever."""
    rates = {
        "x": "v",
        "v": "1/2 - x - v/5 - 60*(v - u)",
        "z": "u",
        "u": "100*(60*(v - u) - 4000*z)",
    }
    found = find_reductions(scene(rates, {}, {"x": 0, "v": 0, "z": 0, "u": 0}, 20), tolerance=0.01)
    assert found.recommended is not None
    for each in found.found:
        assert np.isnan(each.error) or "takes more steps" not in each.why_not


def test_a_run_that_ends_at_a_fold_is_said_to_end_there() -> None:
    """A tunnel diode and a coil: the voltage is fast, and jumps where the current has its maximum."""
    rates = {"V": "(i - V*(1 - V)*(2 - V) - V/50)/C", "i": "(1/2 - V - i/10)/L"}
    found = find_reductions(scene(rates, {"C": 1, "L": 1000}, {"V": 0, "i": 0}, 2000), tolerance=1e-3)
    (told,) = {
        each.why_not for each in found.found if (each.name, each.order) == ("quasi-steady state of V", 0)
    }
    assert "a fold of the critical manifold was reached" in told


@pytest.mark.exhaustive
def test_a_parameter_that_stands_elsewhere_too_is_no_small_parameter() -> None:
    """A resistor and a capacitor: divided by R alone u is 0 to order 0, and R I in its quasi-steady state."""
    rates = {"z": "-I/7200", "u": "(I - u/R)/C", "v": "(I - v/2)/40000"}
    plain = scene(rates, {"R": 0.01, "C": 500, "I": 2}, {"z": 1, "u": 0, "v": 0}, 3000)
    found = find_reductions(plain, tolerance=0.01)
    assert found.recommended is not None
    assert found.study is not None
    choice = choose(found.study)
    # The orders of the table are those of the answer.
    told = {c.order: c.predicted for c in choice.candidates if c.order is not None and c.is_measured}
    for each in found.found:
        if each.name == found.recommended.name and not each.why_not:
            assert told[each.order] == pytest.approx(each.error, rel=0.2)
    full_cut = find_reductions(
        scene({"z": "-I/7200", "u": "(I - u)/C"}, {"C": 0.05, "I": 2}, {"z": 1, "u": 0}, 3000), tolerance=0.01
    )
    # One that divides the whole rate, and nothing else, is.
    assert full_cut.recommended is not None
    assert str(full_cut.recommended.scene.system.epsilon) == "C"


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "rates",
    [
        {"x": "y - x", "y": "20*(x - y)"},
        {"b": "3*a - 300*b", "a": "300*b - 3*a"},
        {"x": "y - 2*x + z", "y": "20*x - 40*y", "z": "40*y - 20*x - y + 2*x - z"},
    ],
    ids=["an exchange", "a closed reaction", "a closed cycle"],
)
def test_where_only_one_rate_is_not_zero_there_is_no_gap(rates: Mapping[str, str], tmp_path) -> None:
    """What a closed vessel conserves stands still, and nothing moves on the manifold of its equilibria."""
    closed = scene(rates, {}, dict(zip(rates, (1, 0.5, 0))), 5)
    found = find_reductions(closed, tolerance=0.01)
    assert all(np.isfinite(each.error) or each.why_not for each in found.found)
    gsp.save(closed, tmp_path / "closed.toml")
    ran = CliRunner().invoke(cli, ["choose", str(tmp_path / "closed.toml")])
    assert ran.exit_code == 0, ran.output
    assert "defect" not in ran.output


@pytest.mark.exhaustive
def test_what_is_left_may_have_fast_modes_of_its_own() -> None:
    """Hydrogen and bromine: without H, Br is fast still, and explicit steps were too many: it was not to be reduced."""
    kd, kr, k2, k3, k4 = 1e-5, 1e6, 50.0, 1e8, 1e7
    rates = {
        "Br": "2*kd*B - 2*kr*Br**2 - k2*Br*A + k3*H*B + k4*H*C",
        "H": "k2*Br*A - k3*H*B - k4*H*C",
        "B": "-kd*B + kr*Br**2 - k3*H*B",
        "A": "-k2*Br*A + k4*H*C",
        "C": "k2*Br*A + k3*H*B - k4*H*C",
    }
    values = {"kd": kd, "kr": kr, "k2": k2, "k3": k3, "k4": k4}
    found = find_reductions(scene(rates, values, {"Br": 0, "H": 0, "B": 0.01, "A": 0.01, "C": 0}, 2e4))
    assert found.recommended is not None
    (own,) = [e for e in found.found if e.name == "standard quasi-steady state of H" and e.order == 0]
    assert own.is_stiff
    assert not own.why_not

    def left(t: float, z: np.ndarray) -> list[float]:
        """Br, Br2, H2 and HBr, with H where it is at rest."""
        br, b, a, c = z
        h = k2 * br * a / (k3 * b + k4 * c)
        pair, first, second, back = kd * b - kr * br**2, k2 * br * a, k3 * h * b, k4 * h * c
        return [2 * pair - first + second + back, -pair - second, back - first, first + second - back]

    study = replace(found, recommended=own).study
    assert study is not None
    run = gsp.integrate(
        study.reduced(0), start=study.base_point(0), span=(0, 2e4), epsilon=study.scene.epsilon, rtol=1e-9
    )
    assert run.stats.steps < 200
    exact = solve_ivp(left, (0, 2e4), [0, 0.01, 0.01, 0], "Radau", rtol=1e-9, atol=1e-16).y[:, -1]
    assert [run[name][-1] for name in ("Br", "B", "A", "C")] == pytest.approx(exact.tolist(), rel=1e-6)


@pytest.mark.exhaustive
def test_what_is_fast_together_is_measured_however_near_its_members_are() -> None:
    """A competitive inhibitor, in moles: each complex by itself is nearer than both, and both were left out."""
    k1, km1, k2, k3, km3, e0 = 1e7, 300.0, 30.0, 2e7, 400.0, 1e-7
    rates = {
        "s": "-k1*(e0 - c1 - c2)*s + km1*c1",
        "c1": "k1*(e0 - c1 - c2)*s - (km1 + k2)*c1",
        "i": "-k3*(e0 - c1 - c2)*i + km3*c2",
        "c2": "k3*(e0 - c1 - c2)*i - km3*c2",
    }
    values = {"k1": k1, "km1": km1, "k2": k2, "k3": k3, "km3": km3, "e0": e0}
    found = find_reductions(scene(rates, values, {"s": 1e-3, "c1": 0, "i": 5e-4, "c2": 0}, 1500))
    assert found.recommended is not None
    assert found.recommended.name == "standard quasi-steady state of c1, c2"

    def full(t: float, z: np.ndarray) -> list[float]:
        s, c1, i, c2 = z
        free = e0 - c1 - c2
        one, two = k1 * free * s - km1 * c1, k3 * free * i - km3 * c2
        return [-one, one - k2 * c1, -two, two]

    def textbook(t: float, s: np.ndarray) -> np.ndarray:
        return -k2 * e0 * s / ((km1 + k2) / k1 * (1 + 5e-4 * k3 / km3) + s)

    options = {"method": "Radau", "rtol": 1e-10, "atol": 1e-18, "t_eval": np.linspace(0, 1500, 97)}
    s, _, i, _ = solve_ivp(full, (0, 1500), [1e-3, 0, 5e-4, 0], **options).y
    own = solve_ivp(textbook, (0, 1500), [1e-3], **options).y[0]
    # The inhibitor stays where it is.
    error = max(np.abs(own - s).max() / s.max(), np.abs(5e-4 - i).max() / i.max())
    assert found.recommended.error == pytest.approx(error, rel=0.05)


@pytest.mark.exhaustive
def test_what_the_rest_takes_many_steps_for_is_run_as_stiff() -> None:
    """A cascade of three scales: without x alone y is fast still, and explicit steps cost many full runs."""
    rates = {"x": "1000000*(y - x)", "y": "1000*(z - y)", "z": "-x*z"}
    found = find_reductions(scene(rates, {}, {"x": 0.1, "y": 0.2, "z": 1}, 2))
    (own,) = [e for e in found.found if e.name == "quasi-steady state of x" and e.order == 0]
    assert own.is_stiff
    assert not own.why_not
    assert own.candidate.steps < 200


def test_what_is_not_known_of_a_candidate_is_left_blank() -> None:
    """A full run at a coarse tolerance that does not reach the end has no cost: `gsp choose --json` was refused."""
    plain = enzyme(*ENZYMES[0])
    candidate = Candidate(ModelKind.REDUCED, 0, timings=(1e-5,), failure=Failure.RATE)
    nan = float("nan")
    found = reductions.Reduction("one", plain, 0, nan, (0.0, 1.0), nan, candidate, "it does not serve")
    told = found.as_dict()
    assert [told["error"], told["seconds"], told["full_seconds"]] == [None, 1e-5, None]
    reductions_ = reductions.Reductions(
        plain, gsp.time_scales(plain), (found,), None, None, (), "Do not reduce."
    )
    assert "nan" not in str(reductions_)


def test_what_passes_early_in_a_long_span_counts_in_the_error() -> None:
    """Between evenly spaced times nothing was seen of it, and an error of 2.5e-3 was told as 4e-4."""
    rates = {"x": "300*(y - x)", "y": "-2*x + z", "z": "-z/100"}
    plain = scene(rates, {}, {"x": 1, "y": 1, "z": 0.001}, 200)
    (part,) = [p for p in fast_parts(field_of(plain)) if p.name == "quasi-steady state of x"]
    measured = measurement.measure(plain, part, np.array([150.0, 50.0]))
    (own,) = [each for each in measured if each.order == 0]
    times = np.linspace(0.0, 5.0, 2001)
    matrix = np.array([[-300.0, 300, 0], [-2, 0, 1], [0, 0, -0.01]])
    exact = np.array([(expm(matrix * t) @ [1, 1, 0.001])[1] for t in times])
    slow = np.array([(expm(np.array([[-2.0, 1], [0, -0.01]]) * t) @ [1, 0.001])[0] for t in times])
    assert own.error == pytest.approx(float(np.abs(slow - exact).max()), rel=0.2)
