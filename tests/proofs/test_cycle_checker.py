"""Proof files of relaxation cycles: what was proved is accepted, and no file changed to say more or another thing."""

import copy
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import GspError
from gsp.proofs import band_checker, cycle_checker
from gsp.proofs.programs import TooLong
from gsp.proofs.verification import verify
from tests.cases import sampled
from tests.cycles.systems import R, fitzhugh_nagumo, lengyel_epstein, orbit_of, van_der_pol
from tests.proof_files import Change, changed, holds, in_pairs, number, written


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> dict:
    found = gsp.certify(orbit_of(van_der_pol(), 2, 0.6), epsilon=0.05)
    return written(found, tmp_path_factory.mktemp("cycle") / "p.json")


def at_annulus(key: str, value: object) -> Change:
    return changed(["annuli", 0, key], value)


def coordinate(key: str, place: int, by: float) -> Change:
    return changed(["annuli", 0, key, place], lambda text: number(text, lambda v: v + by))


def vertices(key: str, turn: Callable[[list], list]) -> Change:
    return at_annulus(key, in_pairs(turn))


def scaled(key: str, by: float) -> Change:
    return at_annulus(key, lambda row: [number(v, lambda u: by * u) for v in row])


def shifted(key: str, by: float) -> Change:
    """A polygon moved along the fast variable."""
    return vertices(key, lambda pairs: [(u, number(v, lambda y: y + by)) for u, v in pairs])


# What each breaks: the polygons and cuts, each condition of which has cases by hand in test_cycle_conditions, the edges
# of P, those of Q, epsilon, the sectors, the bound of the divergence, those of the period, and what is no such file.
CHANGES: dict[str, Change] = {
    "P crosses itself": vertices("outer", lambda p: [p[1], p[0], *p[2:]]),
    "P clockwise": vertices("outer", lambda p: p[::-1]),
    "Q about P": scaled("inner", 3.0),
    "no cuts": at_annulus("cuts", []),
    "cuts the other way": at_annulus("cuts", lambda cuts: cuts[::-1]),
    "P over the sheet": scaled("outer", 0.93),
    "P moved right": shifted("outer", 0.3),
    "P moved left": shifted("outer", -0.3),
    "Q over the sheet": scaled("inner", 1.05),
    "Q moved right": shifted("inner", 0.3),
    "Q moved left": shifted("inner", -0.3),
    "epsilon ten times": at_annulus("epsilon", (0.5).hex()),
    "an equilibrium at the sheet": changed(["rates", 0], "3/2-z1"),
    "time runs backwards": changed(["rates", 0], "z1"),
    "the fast time runs backwards": changed(["rates", 1], "z1**3/3-z1-z0"),
    "a cubic moved": changed(["rates", 1], "z0-z1**3/3+z1+1/2"),
    "a pole in A": changed(["rates", 0], "-z1/z1**2*(1+z0**2)"),
    "a root in A": changed(["rates", 1], "z0-z1**3/3+z1+sqrt(z1)/1000"),
    "epsilon in the rates": changed(["rates", 1], "z0-z1**3/3+z1+30*z2"),
    "a pole at epsilon 0": changed(["rates", 0], "-z1-1/(1000000*z2)"),
    "a larger contraction": at_annulus("contraction", lambda v: number(v, lambda u: 1.5 * u)),
    "far larger contraction": at_annulus("contraction", (-1e3).hex()),
    "a divergence more": changed(["rates", 1], "(z0-z1**3/3+z1)*(1+3/(1+100*(z1+9/5)**2))"),
    "a shorter period": changed(["annuli", 0, "period", 1], (1.6).hex()),
    "a longer period": changed(["annuli", 0, "period", 0], (1.7).hex()),
    "periods the other way": at_annulus("period", lambda row: row[::-1]),
    "a coarse grid": changed(["annuli", 0, "grids", 0], lambda row: [row[0], row[-1]]),
    "no format": lambda proof: proof.pop("format") and None,
    "names alike": changed(["names"], ["x", "x", "epsilon"]),
    "a rate with a name of Python's": changed(["rates", 0], "-z1+__import__('os').getpid()"),
    "a number that is none": changed(["annuli", 0, "outer", 3], "nan"),
    "a decimal": changed(["annuli", 0, "outer", 3], 1.25),
    "a list": changed(["annuli", 0], []),
}
# Vertices of each polygon moved along the fast variable: across the sheet, or into the other polygon.
for key, by in (("outer", 0.9), ("outer", -0.9), ("inner", 0.6), ("inner", -0.6)):
    CHANGES[f"a vertex of {key} by {by}"] = coordinate(key, 2 * 13 + 1, by)


def test_a_proof_is_accepted_and_says_what_was_proved(proof: dict) -> None:
    found = cycle_checker.check(proof)
    (one,) = found.annuli
    assert one.unique
    assert one.epsilon == 0.05
    assert one.period[0] < 1.6 < one.period[1]
    assert "just one closed orbit" in str(found)
    assert found.as_dict()["annuli"][0]["contraction"] < 0.0
    # Where the cycle is not called unique its contraction is not looked at.
    other = copy.deepcopy(proof)
    other["annuli"][0] |= {"unique": False, "contraction": (-1000.0).hex()}
    assert cycle_checker.check(other).as_dict()["annuli"][0]["contraction"] is None


# What the checker refuses by its last conditions, after seconds of work.
LATE = {"a longer period", "a coarse grid"}


@pytest.mark.parametrize("name", sampled(CHANGES, always=set(CHANGES) - LATE))
def test_a_changed_proof_is_rejected(proof: dict, name: str) -> None:
    other = copy.deepcopy(proof)
    CHANGES[name](other)
    assert other != proof
    assert not holds(cycle_checker.check, other)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "change",
    [
        at_annulus("epsilon", (0.04).hex()),
        at_annulus("contraction", lambda v: number(v, lambda u: 0.5 * u)),
        changed(["annuli", 0, "period", 1], (100.0).hex()),
        at_annulus("unique", False),
        changed(["names"], ["a", "b", "c"]),
        changed(["rates", 0], "-(z1+0*z0)"),
    ],
)
def test_a_change_that_says_less_or_stays_true_is_accepted(proof: dict, change: Change) -> None:
    other = copy.deepcopy(proof)
    change(other)
    cycle_checker.check(other)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("system", "start"),
    [
        (van_der_pol(R(9, 10)), (2, 0.6)),
        (fitzhugh_nagumo(), (-1.8, 0.5)),
        (lengyel_epstein(), (0.45, 13.5)),
    ],
)
def test_both_annuli_are_written_and_verified(system: gsp.SlowFastSystem, start: tuple, tmp_path: Path) -> None:
    found = gsp.certify(orbit_of(system, *start))
    found.save(tmp_path / "p.json")
    checked = verify(tmp_path / "p.json")
    assert isinstance(checked, cycle_checker.CheckedCycle)
    assert checked.annuli[0].epsilon == found.epsilon_0
    assert checked.annuli[-1].epsilon == found.epsilon_1
    assert checked.annuli[-1].unique


@pytest.mark.exhaustive
def test_an_annulus_without_uniqueness_is_not_called_unique(tmp_path: Path) -> None:
    found = gsp.certify(orbit_of(van_der_pol(), 2, 0.6), epsilon=0.5)
    assert found.epsilon_1 == 0.0
    read = written(found, tmp_path / "p.json")
    assert not cycle_checker.check(read).annuli[0].unique
    read["annuli"][0] |= {"unique": True, "contraction": (-1e-3).hex()}
    assert not holds(cycle_checker.check, read)


def test_edges_that_may_all_meet_are_counted(proof: dict, monkeypatch) -> None:
    """Two thousand edges to and fro, each over all others: each has to be set against each."""
    monkeypatch.setattr(band_checker, "MOST_OPERATIONS", 1_000_000)
    other = copy.deepcopy(proof)
    row = [text for i in range(2000) for text in (str(100 * (-1) ** i), str(i))]
    at_annulus("outer", [*row, "1000", "2000", "1000", "-1", "-100", "-1"])(other)
    with pytest.raises(TooLong, match="more than 1000000 operations"):
        cycle_checker.check(other)


def test_what_is_not_proved_is_not_saved(tmp_path: Path) -> None:
    found = gsp.certify(orbit_of(van_der_pol(R(6, 5)), 2, 0.6))
    with pytest.raises(GspError, match="only a proof"):
        found.save(tmp_path / "p.json")


@pytest.mark.exhaustive
def test_the_command_line_proves_writes_and_verifies(tmp_path: Path) -> None:
    file = tmp_path / "p.json"
    run = CliRunner()
    told = run.invoke(cli, ["check", "van_der_pol", "--prove-cycle", "--json", "-o", str(file)])
    assert told.exit_code == 0
    assert json.loads(told.stdout)["epsilon_0"] > 0.75
    held = run.invoke(cli, ["verify", str(file)])
    assert held.exit_code == 0
    assert "just one closed orbit" in held.stdout
    beyond = run.invoke(cli, ["check", "van_der_pol", "--prove-cycle", "--epsilon", "3"])
    assert beyond.exit_code == 3
    assert "undecided at epsilon = 3" in beyond.stdout
    rests = run.invoke(cli, ["check", "fitzhugh_nagumo", "--prove-cycle"])
    assert rests.exit_code == 3
    assert "undecided" in rests.stdout
