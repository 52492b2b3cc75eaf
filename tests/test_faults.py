"""Small faults with large consequences: each test here fails for a one-line change that no other test sees."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from gsp import models
from gsp.choice import candidates
from gsp.choice.prediction import Failure, Prediction
from gsp.comparison.compared_runs import CHECK, ROUNDING, largest_error
from gsp.comparison.comparison import compare
from gsp.demos import rodas5p_tableau as rodas
from gsp.errors import ModelFileError, Status
from gsp.integration.events import Event, compile_events
from gsp.kernels import integrator, radau, step_control
from gsp.readers.expressions import parse_expression
from gsp.readers.nodes import CONSTANTS
from gsp.readers.toml_values import symbols_of
from gsp.report import folder as reports
from gsp.results.mathml import operator
from gsp.slow.truncation import AHEAD
from gsp.systems.system import VectorField

x, y, q, epsilon = sp.symbols("x y q epsilon")
SYMBOLS = {"x": x}


# -- limits of the reader --------------------------------------------------------------------------


def read(text: str) -> sp.Expr:
    return parse_expression(text, symbols=SYMBOLS)


def test_a_decimal_exponent_goes_to_300_and_no_further() -> None:
    assert read("1e300*x") == sp.Integer(10) ** 300 * x
    assert read("1e-300*x") == x / sp.Integer(10) ** 300
    for text in ("1e301*x", "1e-301*x", "1e999*x"):
        with pytest.raises(ModelFileError, match="decimal exponent beyond 300"):
            read(text)


def test_constants_are_counted() -> None:
    roots = [f"sqrt({prime})" for prime in list(sp.primerange(100))[: CONSTANTS + 1]]
    assert CONSTANTS == 16
    assert read("x + " + " + ".join(roots[:CONSTANTS])).has(sp.sqrt(2))
    with pytest.raises(ModelFileError, match="more than 16 functions, roots"):
        read("x + " + " + ".join(roots))


def test_digits_that_exponents_make_are_counted_over_the_whole_text() -> None:
    assert read("+".join(["1e300*x"] * 8)) == 8 * sp.Integer(10) ** 300 * x
    with pytest.raises(ModelFileError, match="too many large powers of numbers"):
        read("+".join(["1e300*x"] * 9))


@pytest.mark.parametrize("name", ["a-b", "a b", "_a", "1a", "\u00e9", "a" * 65, "a.b", "a\n", "x;y", ""])
def test_a_name_in_a_file_is_a_plain_word(name: str) -> None:
    with pytest.raises(ModelFileError, match="is no plain word"):
        symbols_of({"states": {name: 1}})
    assert set(symbols_of({"states": {"a" * 64: 1, "a_1B": 1}})) == {"a" * 64, "a_1B"}


# -- the report ------------------------------------------------------------------------------------


def test_an_operator_is_escaped() -> None:
    assert operator("<") == '<mo stretchy="false">&lt;</mo>'
    assert operator("&") == '<mo stretchy="false">&amp;</mo>'


@pytest.mark.parametrize("stop", [1, 2, 3])
def test_an_interrupt_while_a_report_is_put_in_place_leaves_the_older_one(
    tmp_path, monkeypatch, stop: int
) -> None:
    before = {"report.json": b'{"figures": ["path.png"]}', "report.html": b"old page", "path.png": b"old path"}
    for name, content in before.items():
        (tmp_path / name).write_bytes(content)
    moves, replace = [], os.replace

    def interrupted(source, target) -> None:
        moves.append(target)
        if len(moves) == stop:
            raise KeyboardInterrupt
        replace(source, target)

    monkeypatch.setattr(reports.os, "replace", interrupted)
    new = {"convergence.png": b"new", "report.json": b'{"figures": []}', "report.html": b"new page"}
    with pytest.raises(KeyboardInterrupt):
        reports._install(new, tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


# -- comparison and prediction ---------------------------------------------------------------------


def run_of(**values) -> SimpleNamespace:
    class Run(SimpleNamespace):
        def __getitem__(self, name):
            return np.array(values[name])

        def sample(self, times):
            return self

    return Run(status=Status.SUCCESS, t=np.array([0.0, 1.0]))


def test_errors_are_relative_to_the_largest_value_of_each_quantity() -> None:
    run, reference = run_of(a=[1.0, 404.0], b=[0.0, 0.001]), run_of(a=[0.0, 400.0], b=[0.0, 0.002])
    assert largest_error(run, reference, ["a"]) == pytest.approx(0.01)
    assert largest_error(run, reference, ["a", "b"]) == pytest.approx(0.5)
    zero = run_of(a=[0.0, 0.0])
    assert largest_error(run_of(a=[0.0, 0.25]), zero, ["a"]) == 0.25


def test_the_floor_of_a_comparison_is_what_a_looser_reference_errs_by(monkeypatch) -> None:
    import gsp.comparison.compared_runs as module

    runs, own = [], module.run_on

    def counted(flow, *arguments, **options):
        run = own(flow, *arguments, **options)
        runs.append((run, options.get("loosened")))
        return run

    monkeypatch.setattr(module, "run_on", counted)
    found = compare(models.load("michaelis_menten"), orders=(0,), epsilons=(0.02, 0.01))
    pairs = [(runs[i - 1][0], run) for i, (run, loosened) in enumerate(runs) if loosened is not None]
    expected = [
        max(module.largest_error(check, reference, ["s"]) / CHECK, ROUNDING) for reference, check in pairs
    ]
    assert found.floor == tuple(expected)
    assert all(floor >= ROUNDING for floor in found.floor)
    monkeypatch.setattr(module, "largest_error", lambda run, reference, names: 0.5)
    assert compare(models.load("michaelis_menten"), orders=(0,), epsilons=(0.02,)).floor == (0.5 / CHECK,)


def foreseen(runs, *, rate: float = 0.0) -> Prediction:
    class Series:
        branch = SimpleNamespace(system=SimpleNamespace(x=(x,), y=(y,)), scales=(np.ones(1), np.ones(1)))
        coordinates = (x,)

        def terms_at(self, coordinates, value):
            return 0.1 ** np.arange(5)[None, :, None] * np.ones((len(coordinates), 1, 1))

    sampler = SimpleNamespace(
        eigenvalues=lambda z: -np.ones((len(z), 1)),
        tangential_rates=lambda z: np.full(len(z), rate),
        system=SimpleNamespace(x=(x,), y=(), states=(x, y)),
        f=(),
        g=(),
    )
    return Prediction(Series(), 0.1, runs, ("x",), {}, {}, {}, sampler, 1e-6)  # pyright: ignore[reportArgumentType]


def test_an_error_is_foretold_by_the_next_two_orders() -> None:
    assert AHEAD == 2
    runs = {0: run_of(x=[2.0, 2.0]), 1: run_of(x=[2.0, 2.2]), 2: run_of(x=[2.0, 3.0])}
    np.testing.assert_allclose(foreseen(runs).errors(0, np.array([0.0, 1.0])), [0.0, 0.5])


@pytest.mark.parametrize(("rate", "failure"), [(9.9, None), (10.0, Failure.RATE), (10.1, Failure.RATE)])
def test_a_reduction_fails_where_the_tangential_rate_passes_the_gap(rate: float, failure) -> None:
    runs = {}
    for k in range(3):
        runs[k] = run_of(x=[1.0, 1.0], y=[0.0, 0.0])
        runs[k].y = np.ones((1, 2))
    found = foreseen(runs, rate=rate).failures(0, np.array([0.0, 1.0]), 1.0)
    assert found == [failure, failure]


# -- costs -----------------------------------------------------------------------------------------


def test_the_cost_of_a_reduced_run_over_part_of_the_span_is_that_of_its_share(monkeypatch) -> None:
    stats = SimpleNamespace(steps=10, field_calls=30)
    monkeypatch.setattr(candidates, "run_model", lambda *asked: SimpleNamespace(stats=stats))
    scene = models.load("michaelis_menten")
    first, last = scene.span
    end = first + 0.25 * (last - first)
    prediction = SimpleNamespace(
        holds_until=lambda *a, **k: (end, Failure.ERROR),
        runs={0: SimpleNamespace(status=Status.FOLD_REACHED, t=np.array([first, last]), y=np.ones((1, 2)))},
        covered=lambda order: last,
        tells=lambda order, times: True,
        crossing=lambda order: float("inf"),
    )
    forecast = SimpleNamespace(
        prediction=prediction, flows={0: None, AHEAD: None}, starts={0: None}, layer=0.0,
        errors=lambda order, times: np.zeros(len(times)), preparation={0: 7.0},
        times=lambda run, count: np.linspace(first, last, count),
    )  # fmt: skip
    trial = candidates.reduced_candidate(forecast, 0, scene, 1e-6)  # pyright: ignore[reportArgumentType]
    found = trial.candidate
    assert (found.steps, found.field_calls, found.preparation, found.share) == (10, 30, 7.0, 0.25)
    assert trial.cost(2.0) == 2.0
    assert not found.valid


# -- events ----------------------------------------------------------------------------------------


def test_the_sign_after_a_start_on_a_zero_is_that_of_the_way_gone() -> None:
    flow = VectorField({x: sp.Integer(1)}, epsilon=None)
    compiled = compile_events(flow, (Event("x"), Event(-x, name="falling")), np.array([np.nan]))
    assert compiled is not None
    np.testing.assert_array_equal(compiled.signs(0.0, np.array([0.0]), True), [1.0, -1.0])
    np.testing.assert_array_equal(compiled.signs(0.0, np.array([0.0]), False), [-1.0, 1.0])
    np.testing.assert_array_equal(compiled.signs(0.0, np.array([2.0]), False), [1.0, -1.0])


# -- steps -----------------------------------------------------------------------------------------


def test_a_step_does_not_grow_right_after_a_rejected_one() -> None:
    memory, counters = np.zeros(integrator.MEMORY_SIZE), np.zeros(integrator.COUNTERS_SIZE, dtype=np.int64)
    accept, reject = step_control.accept.py_func, step_control.reject.py_func
    assert reject(1.0, 0.25, memory, counters)
    assert memory[integrator.STEP] == 0.25
    accept(0.25, 0.25, False, False, 1.0, 5.0, memory, counters)
    assert memory[integrator.STEP] == 0.25
    accept(0.5, 0.25, False, False, 1.0, 5.0, memory, counters)
    assert memory[integrator.STEP] == 1.25
    assert counters[integrator.REJECTED] == 1
    assert counters[integrator.STEPS] == 2


@pytest.mark.parametrize(("stages", "order"), [(5, 9), (7, 13)])
def test_the_estimate_of_a_radau_step_meets_a_tolerance_of_its_own_order(stages: int, order: int) -> None:
    # The estimate falls as h^(s+1), the values between the steps as h^(s+2): rtol^((s+1)/(s+2)) brings these to rtol.
    control = radau._control.py_func
    for rtol in (1e-4, 1e-8, 1e-12):
        controlled, atol, iteration, _ = control(rtol, 1e-3 * rtol, stages)
        assert controlled == pytest.approx(rtol ** ((stages + 1) / (stages + 2)), rel=1e-12)
        assert atol == pytest.approx(1e-3 * controlled, rel=1e-12)
        assert iteration * controlled < rtol or iteration * controlled == pytest.approx(radau.ROUNDING)


def rodas_weights() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """alpha, beta = alpha + Gamma, Gamma and the weights in k of Rodas5P, taken back from the transformed form."""
    n = rodas.STAGES
    inverse = np.eye(n) / rodas.GAMMA
    inverse[:, : n - 1] -= rodas.C
    gamma = np.linalg.inv(inverse)
    a = np.zeros((n, n))
    a[:6, :5] = rodas.A
    a[6, :6] = [*rodas.A[5], 1.0]
    a[7, :7] = [*rodas.A[5], 1.0, 1.0]
    m = a[7].copy()
    m[7] = 1.0
    return a @ gamma, a @ gamma + gamma, gamma, m


def conditions(b: np.ndarray, alpha: np.ndarray, beta: np.ndarray, order: int, s: float = 1.0) -> np.ndarray:
    """Left sides less right sides of the order conditions, Hairer and Wanner IV.7, table 7.1, at the time s."""
    c, d = alpha.sum(axis=1), beta.sum(axis=1)
    found = [
        (1, b.sum(), 1), (2, b @ d, 2), (3, b @ c**2, 3), (3, b @ beta @ d, 6), (4, b @ c**3, 4),
        (4, (b * c) @ alpha @ d, 8), (4, b @ beta @ c**2, 12), (4, b @ beta @ beta @ d, 24), (5, b @ c**4, 5),
        (5, (b * c**2) @ alpha @ d, 10), (5, b @ (alpha @ d) ** 2, 20), (5, (b * c) @ alpha @ c**2, 15),
        (5, (b * c) @ alpha @ beta @ d, 30), (5, b @ beta @ c**3, 20), (5, b @ beta @ (c * (alpha @ d)), 40),
        (5, b @ beta @ beta @ c**2, 60), (5, b @ beta @ beta @ beta @ d, 120),
    ]  # fmt: skip
    return np.array([left - s**degree / right for degree, left, right in found if degree <= order])


def defects_of_rodas() -> dict[str, float]:
    """What the conditions leave: order 5 at the end, order 4 without stage 8 and between the steps; and stage times."""
    alpha, beta, gamma, m = rodas_weights()
    embedded = np.append(m[:-1], 0.0)
    first, second, third = rodas.DENSE[0], rodas.DENSE[1] + rodas.DENSE[2], -rodas.DENSE[2]
    between = [s * m + s * (1 - s) * (first + s * (second + s * third)) for s in DENSE_TIMES]
    found = {
        "end": conditions(m @ gamma, alpha, beta, 5),
        "embedded": conditions(embedded @ gamma, alpha, beta, 4),
        "dense": [conditions(w @ gamma, alpha, beta, 4, s) for w, s in zip(between, DENSE_TIMES)],
        "times": alpha.sum(axis=1) - STAGE_TIMES,
    }
    return {name: float(np.abs(values).max()) for name, values in found.items()}


DENSE_TIMES = (0.2, 0.5, 0.9)
# As published.
STAGE_TIMES = (
    0.0,
    0.6358126895828704,
    0.4095798393397535,
    0.9769306725060716,
    0.4288403609558664,
    1.0,
    1.0,
    1.0,
)
LEFT = 1e-13


def test_the_coefficients_of_rodas5p_meet_their_conditions_to_rounding() -> None:
    assert max(defects_of_rodas().values()) < LEFT


@pytest.mark.parametrize("table", ["A", "C", "DENSE"])
def test_a_change_by_1e_9_of_any_one_coefficient_of_rodas5p_is_seen(table: str, monkeypatch) -> None:
    original = getattr(rodas, table)
    # Increment 8 is of order h^5, so that no condition of order 4 sees its weights in the dense output.
    unseen = {(row, 7) for row in range(3)} if table == "DENSE" else set()
    for place in {*zip(*np.nonzero(original))} - unseen:
        changed = original.copy()
        changed[place] *= 1.0 + 1e-9
        monkeypatch.setattr(rodas, table, changed)
        assert max(defects_of_rodas().values()) > 5 * LEFT, place


def test_a_change_by_1e_9_of_the_gamma_of_rodas5p_is_seen(monkeypatch) -> None:
    monkeypatch.setattr(rodas, "GAMMA", rodas.GAMMA * (1.0 + 1e-9))
    assert max(defects_of_rodas().values()) > 1e3 * LEFT


def test_the_weights_of_increment_8_in_the_dense_output_are_those_of_the_paper() -> None:
    # Steinebach (2023): h_18, h_28 and h_38.
    published = [-0.17202221070155493, -6.710236069923372, 4.883087185713722]
    assert [rodas.DENSE[0, 7], rodas.DENSE[1, 7] + rodas.DENSE[2, 7], -rodas.DENSE[2, 7]] == pytest.approx(
        published, rel=1e-14
    )
