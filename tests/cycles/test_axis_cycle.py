"""Cycles that leave an invariant sheet by a delayed loss of stability, proved for every epsilon up to a bound."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from flint import arb

import gsp
from gsp.proofs import circuit_checker
from gsp.proofs.programs import Rejected
from tests.cycles.collocation import computed_cycle
from tests.cycles.systems import R, epsilon, orbit_of, system, x, y
from tests.proof_files import Change, changed, number, written

DEATH = R(2, 5)


def rosenzweig_macarthur(death: sp.Expr = DEATH) -> gsp.SlowFastSystem:
    """Prey x and predator y, half of its saturation at x = 3/10."""
    eaten = x / (R(3, 10) + x)
    return system(y * (eaten - death), x * (1 - x) - y * eaten)


@pytest.fixture(scope="module")
def orbit() -> gsp.SingularOrbit:
    return orbit_of(rosenzweig_macarthur(), 0.7, 0.2)


@pytest.fixture(scope="module")
def proof(orbit: gsp.SingularOrbit, tmp_path_factory: pytest.TempPathFactory) -> dict:
    return written(gsp.certify(orbit, epsilon=0.005), tmp_path_factory.mktemp("circuit") / "p.json")


def test_a_predator_without_prey_comes_back(orbit: gsp.SingularOrbit) -> None:
    found = gsp.certify(orbit)
    assert found.verdict is gsp.ProofVerdict.PROVED
    assert found.epsilon_0 >= 0.04
    assert found.epsilon_1 >= 0.025
    assert "the tube of a delay" in str(found)
    assert found.plot().patches


def test_predators_counted_from_1000_come_back_as_well(orbit: gsp.SingularOrbit) -> None:
    moved = {y: y - 1000, x: x + 1000}
    near = rosenzweig_macarthur()
    far = system(near.slow[y].xreplace(moved), near.fast[x].xreplace(moved))
    there, here = (
        gsp.certify(one, epsilon=0.005).existence for one in (orbit_of(far, 0.7 - 1000, 0.2 + 1000), orbit)
    )
    assert there is not None
    assert here is not None
    assert there.turn.period == pytest.approx(here.turn.period, rel=0.02)


@pytest.mark.exhaustive
@pytest.mark.parametrize("small", np.geomspace(1e-8, 0.02, 10).tolist())
def test_a_cycle_computed_in_34_digits_is_within_what_is_proved(orbit: gsp.SingularOrbit, small: float) -> None:
    """By Radau's collocation in y and w = epsilon ln x, where the prey may be as few as exp(-1e7).

    Around a cycle the divergence has one integral everywhere.
    """

    def rates(predators: arb, w: arb) -> tuple[arb, ...]:
        prey = (w / small).exp()
        slope, held = prey / small, arb(3) / 10 + prey
        rising = predators / held**2 * slope
        return (
            predators * (prey / held - arb(2) / 5), small * (1 - prey - predators / held),
            prey / held - arb(2) / 5, arb(3) / 10 * rising, -small / held, small * (rising - slope),
        )  # fmt: skip

    cycle = computed_cycle(rates, small, (0.3, small * float(np.log(0.7))), 0.35)
    found = gsp.certify(orbit, epsilon=small).uniqueness
    assert found is not None
    assert found.turn.period[0] < cycle.period < found.turn.period[1]
    assert cycle.divergence < found.turn.contraction < 0.0
    predators, prey = cycle.ends[0], [float(np.exp(w / small)) for w in cycle.ends[1]]
    for (low, high), (first, last) in zip((predators, prey), found.amplitude):
        assert first[0] <= low < first[1]
        assert last[0] < high < last[1]


def test_without_a_cycle_nothing_is_proved() -> None:
    """A predator that dies too fast, and one at rest on the sheet with the fold."""
    for death in (R(9, 10), R(13, 20)):
        found = gsp.certify(orbit_of(rosenzweig_macarthur(death), 0.7, 0.2))
        assert found.verdict is gsp.ProofVerdict.UNDECIDED
        assert "does not close" in found.reason


def at(key: str, value: object, *before: object) -> Change:
    return changed(["circuits", 0, *before, key], value)


def scaled(key: str, by: float, *before: object) -> Change:
    return at(key, lambda v: number(v, lambda u: by * u), *before)


CHANGES: dict[str, Change] = {
    "one delay": at("delays", lambda rows: rows[:1]),
    "delays exchanged": at("delays", lambda rows: rows[::-1]),
    "the first delay twice": at("delays", lambda rows: [rows[0], rows[0]]),
    "the second delay twice": at("delays", lambda rows: [rows[1], rows[1]]),
    "both sides of the sheet": at("above", False, "delays", 0),
    "never left": at("left", None, "delays", 1),
    "left later": at("left", 400, "delays", 1),
    "kept less": at("kept", 40, "delays", 0),
    "kept longer": at("kept", lambda v: v + 15, "delays", 0),
    "left earlier": at("left", lambda v: v - 15, "delays", 1),
    "a narrower tube": scaled("width", 0.5, "delays", 0),
    "a wider tube": scaled("width", 2.0, "delays", 1),
    "a delay for less": scaled("epsilon", 0.5, "delays", 0),
    "a strip for more": scaled("epsilon", 1.5, "strip"),
    "cornered": at("cornered", True, "strip"),
    "slow first": at("slow_first", True, "strip"),
    "a strip that begins higher": changed(
        ["circuits", 0, "strip", "outer", 1], lambda v: number(v, lambda u: 1.1 * u)
    ),
    "a strip that ends lower": changed(
        ["circuits", 0, "strip", "inner", -1], lambda v: number(v, lambda u: 0.9 * u)
    ),
    "a narrower entry": changed(["circuits", 0, "strip", "outer", 0], lambda v: number(v, lambda u: u + 0.012)),
    "a wider exit": changed(["circuits", 0, "strip", "outer", -2], lambda v: number(v, lambda u: u + 1e-3)),
    "a larger contraction": at("contraction", lambda v: number(v, lambda u: u - 0.1)),
    "unique with a positive bound": at("contraction", (0.5).hex()),
    "unique as text": at("unique", "yes"),
    "a shorter period": changed(["circuits", 0, "period", 1], lambda v: number(v, lambda u: 0.9 * u)),
    "a longer period": changed(["circuits", 0, "period", 0], lambda v: number(v, lambda u: 1.1 * u)),
    "a longer time in the tube": changed(["circuits", 0, "delays", 0, "time", 0], (3.0).hex()),
    "no circuits": changed(["circuits"], []),
    "many circuits": changed(["circuits"], lambda rows: 5 * rows),
    "another format": changed(["format"], "gsp cycle by a delay 2"),
    "no level": changed(["level"], "x"),
    "three rates": changed(["rates"], lambda row: [*row, "0"]),
    "the sheet is left": changed(["rates", 1], lambda text: f"({text})+1/z1"),
    "predators that do not die": changed(["rates", 0], "z0"),
    "predators that die": changed(["rates", 0], "-z0"),
    "no prey": changed(["rates", 1], "-1"),
    "brackets that close too soon": changed(["rates", 1], lambda text: f"{text})+(1"),
    "epsilon among the prey": changed(["rates", 1], lambda text: f"{text}+80*z2"),
}


@pytest.mark.exhaustive
def test_the_proof_is_accepted(proof: dict) -> None:
    found = circuit_checker.check(proof)
    assert found.annuli[0].unique
    assert "the tube of a delay" in str(found)
    assert found.as_dict()["level"] == "0"


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_proof_is_rejected(proof: dict, name: str) -> None:
    other = copy.deepcopy(proof)
    CHANGES[name](other)
    assert other != proof
    with pytest.raises(Rejected):
        circuit_checker.check(other)


@pytest.mark.exhaustive
def test_a_sheet_elsewhere_and_the_other_way_round(tmp_path: Path) -> None:
    """The prey counted from 2, and the predator by what is left of it: x - 2 and 1 - y."""
    plain = rosenzweig_macarthur()
    turned = {x: x - 2, y: 1 - y}
    moved = system(-plain.f[0].xreplace(turned), plain.g[0].xreplace(turned))
    found = gsp.certify(orbit_of(moved, 2.7, 0.8), epsilon=0.005)
    assert found.epsilon_1 > 0.0, found.reason
    found.save(tmp_path / "p.json")
    (first, last), (low, _) = found.uniqueness.amplitude if found.uniqueness else ((), ())
    assert first[0] < 1.0 - 0.43 < last[1]
    assert low[0] == 2.0
    assert epsilon.name == "epsilon"
