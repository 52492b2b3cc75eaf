"""What a model costs beside another: timed in turn, twice, by a clock that the tests hold."""

from dataclasses import replace

import pytest

from gsp import load, models
from gsp.choice import costs
from gsp.choice.candidates import Candidate, ModelKind, Trial
from gsp.choice.choice import choose, select
from gsp.choice.costs import MEASUREMENTS, RUNS, Cost, cost_beside, timed
from gsp.choice.forecast import forecast_of
from gsp.choice.simulation import simulate
from gsp.choice.verdict import Answer, Evidence, judge
from gsp.scenes.study import study_of
from tests.literature import FOLDER

PLAIN = replace(models.load("linear"), tolerance=1e-3)


class Clock:
    """Time that passes in runs alone, and in which order they were made."""

    def __init__(self) -> None:
        self.now, self.made = 0.0, []

    def __call__(self) -> float:
        return self.now

    def trial(self, order: int | None, *seconds: float) -> Trial:
        """A model whose successive runs take `seconds`."""
        left = iter(seconds)

        def run() -> None:
            self.made.append(order)
            self.now += next(left)

        kind = ModelKind.FULL if order is None else ModelKind.REDUCED
        return Trial(Candidate(kind, order, 1e-7, 1.0, valid=True), (run,))  # pyright: ignore


@pytest.fixture
def clock(monkeypatch) -> Clock:
    held = Clock()
    monkeypatch.setattr(costs, "clock", held)
    return held


def test_models_are_timed_in_turn_and_each_measurement_keeps_its_least(clock) -> None:
    one, full = timed([clock.trial(1, 5, 2, 4, 3, 9, 7), clock.trial(None, 8, 8, 8, 6, 6, 6)])
    assert clock.made == [1, None] * (RUNS * MEASUREMENTS)
    assert (one.timings, full.timings) == ((2, 3), (8, 6))
    assert (one.seconds, full.seconds) == (2, 6)
    (left,) = timed([Trial(Candidate(ModelKind.SOLVED, None))])
    assert left.timings == ()
    assert left.seconds != left.seconds


@pytest.mark.parametrize(
    ("first", "second", "cost", "answer", "words"),
    [
        (2.0, 2.5, Cost.LESS, Answer.YES, "1.5 times as fast"),
        (2.0, 3.2, Cost.SAME, Answer.AS_FAST, "about the same time"),
        (3.2, 2.0, Cost.SAME, Answer.AS_FAST, "about the same time"),
        (2.9, 2.9, Cost.SAME, Answer.AS_FAST, "about the same time"),
        (4.0, 5.0, Cost.MORE, Answer.NO_GAIN, "takes longer"),
    ],
)
def test_a_saving_that_two_measurements_do_not_share_is_about_the_same(
    clock, first, second, cost, answer, words
) -> None:
    one, full = timed([clock.trial(1, *3 * [first], *3 * [second]), clock.trial(None, *6 * [3.0])])
    assert cost_beside(one, full) is cost
    model, _ = select(full, [one], (0.0, 1.0))
    assert model is (one if cost is Cost.LESS else full)
    found = judge(Evidence(scene=PLAIN, candidates=(one, full), model=model))
    assert found.answer is answer
    assert words in found.speed


def test_a_yes_that_does_not_pay_speaks_of_what_costs_least(clock) -> None:
    seconds = {2: 5.0, 3: 2.0, None: 1.0}
    two, three, full = timed([clock.trial(order, *6 * [each]) for order, each in seconds.items()])
    model, _ = select(full, [two, three], (0.0, 1.0))
    assert model is full
    found = judge(Evidence(scene=PLAIN, candidates=(two, three, full), model=model))
    assert "the reduced flow of order 3" in str(found)


@pytest.mark.exhaustive
def test_a_clock_that_stands_still_ends_no_choice(monkeypatch) -> None:
    """It ended in "the computation failed: float division by zero"."""
    monkeypatch.setattr(costs, "clock", lambda: 0.0)
    found = choose(models.load("michaelis_menten"), orders=[0])
    assert all(each.seconds > 0.0 for each in found.candidates)
    assert found.verdict.sentences


def test_what_is_dear_is_run_twice_and_one_slow_run_makes_nothing_dear(clock) -> None:
    quick, hindered, dear = timed(
        [clock.trial(0, *6 * [1.0]), clock.trial(1, 500.0, *5 * [1.5]), clock.trial(2, 400.0, 300.0)]
    )
    assert clock.made.count(2) == 2
    assert clock.made.count(0) == clock.made.count(1) == RUNS * MEASUREMENTS
    assert (quick.seconds, hindered.seconds, dear.seconds) == (1.0, 1.5, 300.0)
    assert cost_beside(dear, quick) is Cost.MORE


@pytest.mark.parametrize(("later", "answer"), [(1.0, Answer.YES), (1e4, Answer.AS_FAST)])
def test_choose_the_report_and_simulate_share_what_was_measured(later, answer, monkeypatch) -> None:
    # A reduced step takes a hundredth of a full one, and in the second measurement `later` times as long.
    counts: dict[int, int] = {}

    def seconds(run) -> float:
        made = run()
        counts[id(run)] = counts.get(id(run), 0) + 1
        if len(made.flow.states) == 2:
            return float(made.stats.steps)
        return made.stats.steps * (0.01 if counts[id(run)] <= RUNS else 0.01 * later)

    monkeypatch.setattr(costs, "_seconds", seconds)
    choice = choose(PLAIN, orders=(1,), solve=False)
    assert choice.verdict.answer is answer
    assert choice.as_json()["attributes"]["answer"] == str(answer)
    run = simulate(PLAIN, choice=choice)
    assert (run.reduced_share > 0.5) is (answer is Answer.YES)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["chemostat", "oregonator"])
def test_one_flow_is_measured_that_of_the_sheet_of_the_scene(name: str) -> None:
    """`choose`, the table of reductions and the pictures run the same flow: a start need not look for its sheet."""
    study = study_of(load(FOLDER / f"{name}.toml"))
    forecast = forecast_of(study, (0, 1))
    assert not study.branch.is_explicit
    for order, flow in forecast.flows.items():
        assert flow is study.reduced(order, reconstructed=False)
        assert flow.manifold.branch == study.branch
