"""Passages of folds, transcritical and pitchfork points proved for every epsilon up to a bound, and delays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from flint import arb

import gsp
from gsp.errors import DeclarationError, GspError
from gsp.proofs.verification import verify
from tests.cases import sampled
from tests.cycles.collocation import Field, passed
from tests.cycles.systems import R, epsilon, system, van_der_pol, x, y

CUBE = (x - y**2) ** 3
# System, start of the slow variable, a point that chooses the branch, and the epsilon_0 that is reached at least.
CROSSINGS = {
    "transcritical, exchange": (system(R(1), y * x - x**2 + epsilon), -1.0, (-0.1, -1), 0.1),
    "transcritical, escape": (system(R(1), y * x + x**2 + epsilon), -1.0, (-0.1, -1), 0.004),
    "transcritical, escape downwards": (system(R(1), y * x - x**2 - epsilon), -1.0, (0.1, -1), 0.004),
    "transcritical, exchange, the slow variable falls": (system(-R(1), -y * x - x**2 + epsilon / 2), 1.0, (0, 1), 0.05),
    "transcritical, curved": (
        system(R(1), (y - R(1, 3)) * (x - y**2) - (x - y**2) ** 2 + 3 * epsilon), -1.0, (1, -1), 0.03
    ),
    "pitchfork": (system(R(1), y * x - x**3 + epsilon), -1.0, (0, -1), 1.0),
    "pitchfork, the other side": (system(R(1), y * x - x**3 - epsilon / 2), -1.0, (0, -1), 1.0),
    "pitchfork, escape": (system(R(1), y * x + x**3 + epsilon), -1.0, (0, -1), 0.01),
    "pitchfork, curved": (
        system(-1 - y / 10, (-y - R(1, 3)) * (x - y**2) - CUBE - 2 * epsilon), 1.0, (1, 1), 0.02
    ),
}  # fmt: skip


def fold(found: gsp.SlowFastSystem | None = None, at: tuple[float, float] = (1, -2 / 3)) -> gsp.FoldPassage:
    return gsp.fold_passage(found or van_der_pol(), {"x": at[0], "y": at[1]})


def crossing(name: str) -> gsp.DelayedExit:
    found, start, (u, v), _ = CROSSINGS[name]
    return gsp.entry_exit(gsp.solve_critical(found).nearest({"x": u, "y": v}), start={"y": start})


@pytest.mark.parametrize("name", sampled(CROSSINGS, always=["pitchfork, the other side"]))
def test_runs_pass_the_strip_where_branches_meet(name: str, tmp_path: Path) -> None:
    exit = crossing(name)
    found = gsp.certify(exit)
    assert found.verdict is gsp.ProofVerdict.PROVED, found.reason
    assert found.epsilon_0 >= CROSSINGS[name][3]
    for certificate in (found, gsp.certify(exit, epsilon=1e-3)):
        assert certificate.strip is not None
        (at, _), (low, high) = certificate.strip.entry
        sides = certificate.strip.exit
        along = int(np.argmin([b - a for a, b in sides]))
        for start in (low, 0.5 * (low + high), high):
            for share in (1.0, 0.03):
                run = gsp.integrate(
                    CROSSINGS[name][0], start={"y": at, "x": start}, span=(0.0, 20.0),
                    epsilon=share * certificate.epsilon_0, rtol=1e-10, atol=1e-12,
                    events=[gsp.Event((y, x)[along] - sides[along][0], terminal=True)],
                )  # fmt: skip
                least, most = certificate.strip.turn.period
                assert least <= run.t[-1] * (1 + 1e-9)
                assert run.t[-1] <= most * (1 + 1e-9)
                other = float(run["xy"[along]][-1])
                assert sides[1 - along][0] <= other <= sides[1 - along][1]
    found.save(tmp_path / "p.json")
    assert verify(tmp_path / "p.json").as_dict()["epsilon"] == found.epsilon_0


# -- a fold --------------------------------------------------------------------------------------------


def van_der_pol_field(u: arb, v: arb) -> tuple[arb, ...]:
    return -v, u - v**3 / 3 + v, arb(0), arb(-1), arb(1), 1 - v**2


def quadratic_field(u: arb, v: arb) -> tuple[arb, ...]:
    return arb(1), u + v**2, arb(0), arb(0), arb(1), 2 * v


# System, its fold, the entry section, rates for the second route.
FOLDS: dict[str, tuple[gsp.SlowFastSystem, tuple[float, float], float, Field]] = {
    "van der Pol, from above": (van_der_pol(), (1, -2 / 3), 0.6, van_der_pol_field),
    "van der Pol, from below": (van_der_pol(), (-1, 2 / 3), -0.6, van_der_pol_field),
    "parabola": (system(R(1), x**2 + y), (0, 0), -1.0, quadratic_field),
}
EPSILONS = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 5e-4, 2e-3, 1e-2, 5e-2, 0.2]


@pytest.mark.exhaustive
@pytest.mark.parametrize("small", EPSILONS)
@pytest.mark.parametrize("name", FOLDS)
def test_a_computed_passage_and_its_law_are_within_what_is_proved(name: str, small: float) -> None:
    found, at, start, field = FOLDS[name]
    passage = fold(found, at)
    certificate = gsp.certify(passage, start={"y": start}, epsilon=small)
    assert certificate.strip is not None, certificate.reason
    (begin, _), (low, high) = certificate.strip.entry
    (least, most), (level, _) = certificate.strip.exit
    time, place, divergence = passed(field, small, (begin, 0.5 * (low + high)), 1, level)
    assert least < place < most
    assert certificate.strip.turn.period[0] < time < certificate.strip.turn.period[1]
    assert divergence < certificate.strip.turn.contraction
    assert small > 1e-2 or least < passage.exit(small)["y"] < most
    # The strip is as wide as the delay.
    assert most - least < 3.0 * abs(passage.leading[0]) * small ** (2.0 / 3.0)


def test_a_fold_is_passed_up_to_a_bound_that_is_found() -> None:
    found = gsp.certify(fold(), start={"y": 0.6})
    assert found.verdict is gsp.ProofVerdict.PROVED
    assert found.epsilon_0 > 0.3
    assert "every orbit through y = 0.6" in str(found)


def test_a_section_is_where_the_certificate_says(tmp_path: Path) -> None:
    """1/3 and the start are no sum of doubles: the section is told in a number that it is at exactly."""
    found = system(R(1), (y - R(1, 3)) * x - x**3 + epsilon)
    sheet = gsp.solve_critical(found).nearest({"x": 0, "y": -1})
    certificate = gsp.certify(gsp.entry_exit(sheet, start={"y": -1}), epsilon=0.01)
    assert certificate.strip is not None
    (begin, end), (low, high) = certificate.strip.entry
    assert begin == end == pytest.approx(-1)
    assert low < high
    assert "every orbit through y = 1/3 - 1.3333333333333333, x from " in str(certificate)
    certificate.save(tmp_path / "p.json")
    assert "every orbit through z0 = -1.3333333333333333, z1 from " in str(verify(tmp_path / "p.json"))


@pytest.mark.parametrize(
    ("fast", "sheet", "told"),
    [
        ((x - 3) * (y - x), 3, "z1 = x - (3),"),
        ((x - y**2) * (y - x + y**2) + 2 * y * epsilon, 1, "z1 = x_from_the_sheet,"),
        (x * (y - x), 0, "z1 = x,"),
    ],
)
def test_the_file_of_a_delay_says_what_its_distance_is(
    tmp_path: Path, fast: sp.Expr, sheet: int, told: str
) -> None:
    """epsilon v' = v k holds of v = x - h_0(y), and of x itself only where h_0 = 0."""
    branch = gsp.solve_critical(system(R(1), fast)).nearest({"x": sheet, "y": -1})
    gsp.certify(gsp.entry_exit(branch, start={"y": -1}), epsilon=0.01).save(tmp_path / "p.json")
    assert told in str(verify(tmp_path / "p.json"))


def test_an_entry_is_where_it_was_asked_for() -> None:
    certificate = gsp.certify(fold(), start={"y": 0.612345678912}, epsilon=1e-3)
    assert "every orbit through y = 0.612345678912, x from " in str(certificate)


def test_a_cut_is_above_the_repelling_sheet() -> None:
    """Half way up to where the slow rate turns, the line that leaves the sheet first is still below the other sheet."""
    eaten = x / (R(3, 10) + x)
    found = system(y * (eaten - R(2, 5)), x * (1 - x) - y * eaten)
    certificate = gsp.certify(fold(found, (0.35, 0.4225)), start={"y": 0.2}, epsilon=0.01)
    assert certificate.verdict is gsp.ProofVerdict.PROVED, certificate.reason


def test_a_fold_asks_for_a_start_before_it() -> None:
    with pytest.raises(DeclarationError, match="entry section"):
        gsp.certify(fold(), epsilon=0.01)
    with pytest.raises(DeclarationError, match="other side"):
        gsp.certify(fold(), start={"y": -1}, epsilon=0.01)


def test_a_start_beyond_the_sheet_is_undecided() -> None:
    """Between two folds the middle sheet of a cubic turned over attracts: it does not reach back beyond the other."""
    found = system(-R(1), x**3 / 3 - x - y)
    certificate = gsp.certify(fold(found, (1, -2 / 3)), start={"y": 0.7}, epsilon=1e-3)
    assert certificate.verdict is gsp.ProofVerdict.UNDECIDED
    assert "not followed" in certificate.reason
    assert gsp.certify(fold(found, (1, -2 / 3)), start={"y": 0.3}, epsilon=1e-3).epsilon_0 == 1e-3


# -- a delay -------------------------------------------------------------------------------------------

DELAYS = {
    "linear": (system(R(1), (y + y**2) * x), -0.5, (0, -0.5)),
    "transcritical": (system(R(1), x * (y - x)), -1.0, (0, -1)),
    "pitchfork, curved, with epsilon": (
        system(1 + y**2, (x - y**2) * (y - R(1, 4) - x + y**2) + 2 * epsilon * y * (1 + y**2)), -1.0, (1, -1)
    ),
    "falling": (system(-R(1), -(x - y) * (y - R(1, 4)) - epsilon - (x - y) ** 3), 1.0, (1, 1)),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", DELAYS)
def test_a_delay_is_between_its_bounds(name: str, tmp_path: Path) -> None:
    found, start, (u, v) = DELAYS[name]
    exit = gsp.entry_exit(gsp.solve_critical(found).nearest({"x": u, "y": v}), start={"y": start})
    certificate = gsp.certify(exit, epsilon=0.05)
    delay = certificate.delay
    assert delay is not None, certificate.reason
    way = np.sign(delay.grid[1] - delay.grid[0])
    loss = exit.losses[0].point["y"]
    assert way * loss < way * delay.stays_to < way * exit.point["y"] < way * delay.leaves_by
    # Most of the delay that entry and exit allow is proved.
    assert (delay.stays_to - loss) > 0.9 * (exit.point["y"] - loss) if way > 0 else True
    for small in np.geomspace(1e-8, 0.05, 10):
        for side in (1.0, -1.0):
            left = _left(certificate, small, side)
            assert way * delay.stays_to <= way * left <= way * delay.leaves_by
    certificate.save(tmp_path / "p.json")
    assert verify(tmp_path / "p.json").as_dict()["leaves_by"] is not None


def _left(certificate: gsp.PassageCertificate, small: float, side: float) -> float:
    """Where the logarithm of |v| comes back to its start, by the classical method of Runge and Kutta over x."""
    symbols = (y, x, epsilon)
    f, k = certificate.sheet_rates
    ratio = sp.lambdify(symbols, k / f)
    delay = certificate.delay
    assert delay is not None
    at, log = float(delay.grid[0]), 0.0
    h = (delay.grid[-1] - delay.grid[0]) / 20_000

    def rate(u: float, w: float) -> float:
        return float(ratio(u, side * delay.width * np.exp(min(w, 0.0) / small), small))

    while True:
        one = rate(at, log)
        two = rate(at + h / 2, log + h / 2 * one)
        three = rate(at + h / 2, log + h / 2 * two)
        four = rate(at + h, log + h * three)
        after = log + h * (one + 2 * two + 2 * three + four) / 6
        if after >= 0.0 and at != delay.grid[0]:
            return at + h * log / (log - after)
        at, log = at + h, min(after, 0.0)


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_a_delay_far_from_the_origin_is_proved_as_one_at_it(far: int, tmp_path: Path) -> None:
    """Multiplied out about the origin its slow rate did not keep its sign over any box."""
    found = system(
        (1 + y / 2 + x * y / 5).xreplace({y: y - far}), (x * (y + y**2 / 4) + x**2 / 3).xreplace({y: y - far})
    )
    start = {"y": far - 0.5}
    sheet = gsp.solve_critical(found).nearest({"x": 0, **start})
    delay = gsp.certify(gsp.entry_exit(sheet, start=start), epsilon=0.005)
    assert delay.verdict is gsp.ProofVerdict.PROVED
    delay.save(tmp_path / "p.json")
    assert verify(tmp_path / "p.json").as_dict()["epsilon"] == 0.005


def test_a_delay_asks_for_its_epsilon() -> None:
    found, start, (u, v) = DELAYS["linear"]
    exit = gsp.entry_exit(gsp.solve_critical(found).nearest({"x": u, "y": v}), start={"y": start})
    with pytest.raises(DeclarationError, match="that is given"):
        gsp.certify(exit)


# -- never proved --------------------------------------------------------------------------------------


def test_a_canard_value_is_undecided() -> None:
    """lambda = 1 without an invariant branch: orbits go either way as higher orders decide."""
    found = system(R(1), y * x - x**2 + epsilon * y)
    exit = gsp.entry_exit(gsp.solve_critical(found).nearest({"x": 0, "y": -1}), start={"y": -1})
    certificate = gsp.certify(exit, epsilon=1e-3)
    assert certificate.verdict is gsp.ProofVerdict.UNDECIDED
    with pytest.raises(GspError, match="only a proof"):
        certificate.save("never.json")


def test_a_point_that_is_no_fraction_is_undecided() -> None:
    found = system(R(1), (y - sp.sqrt(2)) * x - x**2 + epsilon)
    exit = gsp.entry_exit(gsp.solve_critical(found).nearest({"x": 0, "y": 0}), start={"y": 0})
    certificate = gsp.certify(exit, epsilon=1e-3)
    assert certificate.verdict is gsp.ProofVerdict.UNDECIDED
    assert "fractions" in certificate.reason


def test_the_drift_beside_a_transcritical_point_decides_what_is_proved() -> None:
    """Orbits of epsilon x' = (y x - x^2) - epsilon leave downwards: no strip of the other passage holds them."""
    up, down = (
        gsp.entry_exit(
            gsp.solve_critical(system(R(1), y * x - x**2 + sign * epsilon)).nearest(
                {"x": sign * -0.1, "y": -1}
            ),
            start={"y": -1},
        )
        for sign in (1, -1)
    )
    assert "along another sheet" in gsp.certify(up, epsilon=1e-3).reason
    assert "escape" in gsp.certify(down, epsilon=1e-3).reason


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["fold", "crossing", "delay"])
def test_what_is_proved_is_drawn(name: str) -> None:
    if name == "fold":
        certificate = gsp.certify(fold(), start={"y": 0.6}, epsilon=0.01)
    elif name == "crossing":
        certificate = gsp.certify(crossing("pitchfork"), epsilon=1e-3)
    else:
        found, start, (u, v) = DELAYS["transcritical"]
        branch = gsp.solve_critical(found).nearest({"x": u, "y": v})
        certificate = gsp.certify(gsp.entry_exit(branch, start={"y": start}), epsilon=0.01)
    axes = certificate.plot()
    labels = " ".join(text.get_text() for text in axes.get_legend().get_texts())
    assert ("entry" in labels and "exit" in labels) or ("stay so far" in labels and "have left" in labels)


def test_a_passage_of_more_variables_is_refused() -> None:
    z = sp.Symbol("z")
    spatial = gsp.SlowFastSystem(slow={y: 1, z: 1}, fast={x: x**2 + y}, epsilon=epsilon)
    with pytest.raises(DeclarationError, match="one slow and one fast"):
        gsp.certify(gsp.fold_passage(spatial, {"x": 0, "y": 0, "z": 0}), start={"y": -1}, epsilon=0.01)
