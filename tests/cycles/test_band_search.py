"""The search for the largest epsilon: what doubles see and what is proved are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from gsp.cycles.band_search import RESOLUTION, EpsilonSearch
from gsp.cycles.outline import NoOutline
from gsp.cycles.sectors import NotProved, Turn


@dataclass(frozen=True)
class Found:
    epsilon: float
    turn: Turn


class Known(EpsilonSearch[Found]):
    """Seen up to `seen_to`, proved up to `proved_to`, with these bounds of the divergence."""

    def __init__(
        self, sees: Callable[[float], float], says: Callable[[float], float], seen_to: float, proved_to: float
    ) -> None:
        super().__init__()
        self.sees, self.says, self.seen_to, self.proved_to = sees, says, seen_to, proved_to
        self.proofs: list[float] = []

    def seen(self, epsilon: float) -> float:
        if epsilon > self.seen_to:
            raise NoOutline("no outline")
        return self.sees(epsilon)

    def proved(self, epsilon: float) -> Found:
        self.proofs.append(epsilon)
        if epsilon > self.proved_to:
            raise NotProved("not proved")
        return Found(epsilon, Turn((1.0, 2.0), self.says(epsilon)))


def known(
    zero: float, power: float = 3.0, seen_to: float = 1.0, proved_to: float = 1.0, below: float = 0.5
) -> Known:
    """What is proved changes its sign at `zero`; doubles see a zero at `zero`/`below`."""

    def sees(epsilon: float) -> float:
        return math.log(epsilon * below / zero)

    return Known(
        sees, lambda small: sees(small) - math.log(below) * (small / zero) ** power, seen_to, proved_to
    )


@pytest.mark.parametrize("begin", [1e-3, 0.07, 40.0])
@pytest.mark.parametrize("seen_to", [0.9, 2e-4, 3.0])
def test_what_exists_is_found_up_to_where_it_is_seen(begin: float, seen_to: float) -> None:
    search = known(1.0, seen_to=seen_to, proved_to=10.0)
    found = search.largest(begin, attracts=False)
    assert found is not None
    assert seen_to / RESOLUTION <= found.epsilon <= seen_to
    assert len(search.proofs) == 1


@pytest.mark.parametrize("proved_to", [0.8, 0.3, 0.01, 1e-4])
def test_where_less_is_proved_than_seen_proofs_come_down(proved_to: float) -> None:
    search = known(1.0, proved_to=proved_to)
    found = search.largest(0.07, attracts=False)
    assert found is not None
    assert proved_to / RESOLUTION <= found.epsilon <= proved_to
    assert len(search.proofs) <= 30


@pytest.mark.parametrize("power", [1.0, 2.0, 4.0, 8.0])
@pytest.mark.parametrize("zero", [0.3, 0.02, 3e-4])
@pytest.mark.parametrize("begin", [1e-3, 0.5])
def test_the_sign_of_the_divergence_is_found_by_few_proofs(power: float, zero: float, begin: float) -> None:
    search = known(zero, power)
    exists = search.largest(begin, attracts=False)
    found = search.largest(begin, attracts=True)
    assert exists is not None
    assert found is not None
    assert found.turn.contraction < 0.0
    assert zero / RESOLUTION <= found.epsilon <= zero
    assert len(search.proofs) <= 12


def test_nothing_is_found_where_there_is_nothing() -> None:
    assert known(1.0, seen_to=0.0).largest(0.1, attracts=False) is None
    assert known(1.0, proved_to=0.0).largest(0.1, attracts=False) is None
    repelled = Known(lambda small: 1.0, lambda small: 1.0, 1.0, 1.0)
    assert repelled.largest(0.1, attracts=True) is None
    # Doubles are never right.
    misled = Known(lambda small: -1.0, lambda small: 1.0, 1.0, 1.0)
    assert misled.largest(0.1, attracts=True) is None
    assert len(misled.proofs) <= 30


def test_a_proof_is_made_once_and_its_failure_is_told() -> None:
    search = known(1.0, seen_to=0.5, proved_to=0.1)
    assert search.within(0.2) is None
    assert search.within(0.2) is None
    assert (search.last, search.why) == (0.2, "not proved")
    assert search.within(0.05) is search.within(0.05)
    assert search.proofs == [0.2, 0.05]
