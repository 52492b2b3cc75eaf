"""Proof files of passages: what was proved is accepted, and no file changed to say more or another thing."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.cycles.cycle_file import CLAIMS, accepted
from gsp.errors import GspError
from gsp.proofs import passage_checker
from gsp.proofs.programs import Rejected, TooLong
from gsp.proofs.verification import verify
from tests.cases import sampled
from tests.cycles.systems import R, epsilon, system, van_der_pol, x, y
from tests.proof_files import Change, changed, holds, in_pairs, number, written


@pytest.fixture(scope="module")
def proofs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    path = tmp_path_factory.mktemp("passage") / "p.json"
    meeting = gsp.solve_critical(system(R(1), (y - R(1, 3)) * x - x**2 + epsilon)).nearest({"x": 0, "y": -1})
    delayed = gsp.solve_critical(system(R(1), x * (y - x))).nearest({"x": 0, "y": -1})
    fold = gsp.fold_passage(van_der_pol(), {"x": 1, "y": -2 / 3})
    found = {
        "fold": gsp.certify(fold, start={"y": 0.6}, epsilon=0.01),
        "crossing": gsp.certify(gsp.entry_exit(meeting, start={"y": -1}), epsilon=0.01),
        "delay": gsp.certify(gsp.entry_exit(delayed, start={"y": -1}), epsilon=0.01),
    }
    return {name: written(one, path) for name, one in found.items()}


def at(key: str, value: object, part: str = "strip") -> Change:
    return changed([part, key], value)


def scaled(key: str, by: float, part: str = "strip") -> Change:
    return at(key, lambda v: number(v, lambda u: by * u), part)


def shifted(key: str, by: float, axis: int = 1) -> Change:
    """A line moved along a variable."""
    return at(key, lambda row: [number(v, lambda u: u + by) if i % 2 == axis else v for i, v in enumerate(row)])


def vertices(key: str, turn: Callable[[list], list]) -> Change:
    return at(key, in_pairs(turn))


def exchanged(proof: dict) -> None:
    one = proof["strip"]
    one["outer"], one["inner"] = one["inner"], one["outer"]
    one["cuts"] = [cut[::-1] for cut in one["cuts"]]


def reversed_way(proof: dict) -> None:
    """The strip the other way round: its exit section for the entry."""
    one = proof["strip"]
    ends = (len(one["outer"]) // 2 - 1, len(one["inner"]) // 2 - 1)
    for key in ("outer", "inner"):
        one[key] = in_pairs(lambda pairs: pairs[::-1])(one[key])
    one["cuts"] = [[ends[0] - o, ends[1] - i] for o, i in one["cuts"][::-1]]
    exchanged(proof)


# What each breaks: the lines, the cuts, the sections, the edges of either line, epsilon, the rates, the sectors, the
# bounds, and what is no such file.
STRIP: dict[str, Change] = {
    "outer crosses itself": vertices("outer", lambda p: [p[1], p[0], *p[2:]]),
    "inner crosses itself": vertices("inner", lambda p: [p[1], p[0], *p[2:]]),
    "a vertex twice": vertices("outer", lambda p: [p[0], *p]),
    "lines that meet": changed(["strip", "outer", 7], lambda v: number(v, lambda u: u + 1.0)),
    "lines exchanged": exchanged,
    "the other way round": reversed_way,
    "outer on inner": lambda proof: proof["strip"].__setitem__("outer", list(proof["strip"]["inner"])),
    "one vertex": vertices("inner", lambda p: p[:1]),
    "no cuts": at("cuts", []),
    "one cut": at("cuts", lambda cuts: cuts[:1]),
    "the entry elsewhere": changed(["strip", "cuts", 0], [1, 1]),
    "the exit elsewhere": changed(["strip", "cuts", -1, 0], lambda v: v - 1),
    "cuts out of order": at("cuts", lambda cuts: cuts[::-1]),
    "a cut to no vertex": changed(["strip", "cuts", -1, 1], 100_000),
    "slow and fast exchanged": at("slow_first", lambda v: not v),
    "outer moved over the sheet": shifted("outer", 0.4),
    "outer moved away": shifted("outer", -0.5, 0),
    "inner moved over the sheet": shifted("inner", -0.4),
    "inner moved away": shifted("inner", 0.5, 0),
    "epsilon hundred times": scaled("epsilon", 100.0),
    "epsilon zero": at("epsilon", (0.0).hex()),
    "epsilon negative": scaled("epsilon", -1.0),
    "an equilibrium": changed(["rates", 0], lambda text: f"({text})*(z0+1/10)"),
    "time runs backwards": changed(["rates", 0], lambda text: f"-({text})"),
    "the fast time runs backwards": changed(["rates", 1], lambda text: f"-({text})"),
    "a push to one side": changed(["rates", 2], lambda text: f"({text})+40"),
    "a push to the other side": changed(["rates", 2], lambda text: f"({text})-40"),
    "a pole": changed(["rates", 1], lambda text: f"({text})*z1/z1"),
    "a pole at epsilon 0": changed(["rates", 2], lambda text: f"({text})+1/(1000000*z2)"),
    "a larger contraction": at("contraction", lambda v: number(v, lambda u: u - 0.5)),
    "far larger contraction": at("contraction", (-1e3).hex()),
    "a shorter time": changed(["strip", "period", 1], lambda v: number(v, lambda u: 0.9 * u)),
    "a longer time": changed(["strip", "period", 0], lambda v: number(v, lambda u: 1.3 * u)),
    "a grid too short": changed(["strip", "grids", 0], lambda row: row[:-2]),
    "a grid that begins too late": changed(["strip", "grids", -1], lambda row: row[2:]),
    "a grid that falls": changed(["strip", "grids", 0], lambda row: row[::-1]),
    "a grid too few": at("grids", lambda rows: rows[:-1]),
    "no strips": at("strips", 0),
    "cornered as text": at("cornered", "yes"),
    "slow first as text": at("slow_first", "yes"),
    "another format": changed(["format"], "gsp passage 2"),
    "no origin": lambda proof: proof.pop("origin") and None,
    "an origin of one": changed(["origin"], ["0"]),
    "an origin that is none": changed(["origin"], ["0", "x"]),
    "an origin of a hundred million digits": changed(["origin"], ["0", "1e99999999"]),
    "an origin over zero": changed(["origin"], ["0", "1/0"]),
    "two names": changed(["names"], ["x", "y"]),
    "two rates": changed(["rates"], lambda row: row[:2]),
    "a rate with a name of Python's": changed(["rates", 0], "1+__import__('os').getpid()"),
    "an odd row": at("outer", lambda row: row[:-1]),
    "a number that is none": changed(["strip", "outer", 3], "nan"),
    "no strip": lambda proof: proof.pop("strip") and None,
}  # fmt: skip
CORNER: dict[str, Change] = {
    "no corner": at("cornered", False),
    "g not zero there": changed(["rates", 1], lambda text: f"({text})-1/10**30"),
    "g_x not zero there": changed(["rates", 1], lambda text: f"({text})+z0/10**30"),
    "g_y not zero there": changed(["rates", 1], lambda text: f"({text})-z1/10**30"),
    "g holds epsilon": changed(["rates", 1], lambda text: f"({text})+0*z2+z2**2*z0**2"),
    "g bends down": changed(["rates", 1], lambda text: f"({text})-3*z0*z0"),
    "g bends down across": changed(["rates", 1], lambda text: f"({text})-z0*z1*2"),
    "no drift": changed(["rates", 2], "0"),
    "drift the other way": changed(["rates", 2], "-1"),
    "drift below the slope": changed(["rates", 2], "1/1000"),
    "faster than the drift": changed(["rates", 0], "1+20*(1-z0**2)"),
    "a function not known there": changed(["rates", 1], lambda text: f"({text})+log(1+z0**2)-log(1+z0**2)"),
    "a corner besides (0, 0)": shifted("outer", 1e-9, 0),
}
DELAY: dict[str, Change] = {
    "kept longer": at("kept", lambda v: v + 12, "delay"),
    "left earlier": at("left", lambda v: v - 12, "delay"),
    "a wider tube": scaled("width", 40.0, "delay"),
    "epsilon in k": changed(["rates", 1], lambda text: f"({text})+9*z2"),
    "epsilon in k the other way": changed(["rates", 1], lambda text: f"({text})-9*z2"),
    "a repelling sheet": changed(["rates", 1], lambda text: f"-({text})"),
    "a pole": changed(["rates", 1], lambda text: f"({text})*z1/z1"),
    "deeper": at("depth", lambda v: number(v, lambda u: 1.1 * u), "delay"),
    "a shorter time": changed(["delay", "time", 1], lambda v: number(v, lambda u: 0.9 * u)),
    "a longer time": changed(["delay", "time", 0], lambda v: number(v, lambda u: 1.1 * u)),
    "a grid that begins later": at("grid", lambda row: row[30:], "delay"),
    "a grid the other way": at("grid", lambda row: row[::-1], "delay"),
    "a coarse grid": at("grid", lambda row: [row[0], row[-1]], "delay"),
    "three rates": changed(["rates"], lambda row: [*row, "0"]),
    "no delay": lambda proof: proof.pop("delay") and None,
}
CHANGES = {
    **{f"fold: {name}": ("fold", change) for name, change in STRIP.items()},
    **{f"crossing: {name}": ("crossing", change) for name, change in (STRIP | CORNER).items()},
    **{f"delay: {name}": ("delay", change) for name, change in DELAY.items()},
}


@pytest.mark.parametrize("name", ["fold", "crossing", "delay"])
def test_a_proof_is_accepted_and_says_what_was_proved(proofs: dict[str, dict], name: str) -> None:
    found = passage_checker.check(proofs[name])
    assert "the proof holds" in str(found)
    assert found.as_dict()["epsilon"] == 0.01
    assert ("z0 = y - (1/3)" in str(found)) == (name == "crossing")


# What the checker refuses by its last conditions, after seconds of work.
LATE = {
    "fold: a pole", "fold: a shorter time", "fold: a longer time", "fold: lines that meet",
    "fold: a grid that begins too late",
    "fold: a larger contraction", "fold: far larger contraction", "crossing: a larger contraction",
    "crossing: far larger contraction", "crossing: a longer time",
}  # fmt: skip


@pytest.mark.parametrize("name", sampled(CHANGES, always=set(CHANGES) - LATE))
def test_a_changed_proof_is_rejected(proofs: dict[str, dict], name: str) -> None:
    kind, change = CHANGES[name]
    other = copy.deepcopy(proofs[kind])
    change(other)
    assert other != proofs[kind]
    assert not holds(passage_checker.check, other)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("fold", scaled("epsilon", 0.5)),
        ("fold", changed(["strip", "period", 1], (100.0).hex())),
        ("fold", at("contraction", (5.0).hex())),
        ("crossing", changed(["rates", 0], "1+0*z1")),
        ("crossing", changed(["rates", 1], lambda text: f"({text})+0*tanh(z0)")),
        ("delay", at("left", None, "delay")),
        ("delay", scaled("depth", 0.5, "delay")),
    ],
)
def test_a_change_that_says_less_or_stays_true_is_accepted(
    proofs: dict[str, dict], kind: str, change: Change
) -> None:
    other = copy.deepcopy(proofs[kind])
    change(other)
    passage_checker.check(other)


@pytest.mark.exhaustive
def test_the_command_line_proves_writes_and_verifies(tmp_path: Path) -> None:
    file = tmp_path / "p.json"
    run = CliRunner()
    told = run.invoke(cli, ["check", "van_der_pol", "--prove-passage", "--json", "-o", str(file)])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["reaches"]
    held = run.invoke(cli, ["verify", str(file)])
    assert held.exit_code == 0
    assert "every orbit through" in held.stdout
    assert isinstance(verify(file), passage_checker.CheckedPassage)
    both = run.invoke(cli, ["check", "van_der_pol", "--prove-passage", "--prove-cycle"])
    assert both.exit_code != 0
    assert "cannot be combined" in str(both.exception)


def test_a_claim_that_takes_too_long_to_check_is_not_followed_by_others_that_take_longer() -> None:
    tried: list[int] = []

    def check(row: dict) -> None:
        tried.append(row["strips"])
        raise TooLong("the check takes more operations") if row["strips"] > 1 else Rejected("a bound")

    with pytest.raises(GspError, match="takes more operations"):
        accepted(lambda finer, room: {"strips": finer}, check)
    assert tried == [finer for finer, _ in CLAIMS if finer == 1] + [2]
    assert all(one <= two for (one, _), (two, _) in pairwise(CLAIMS))
