"""The largest epsilon for which a band is found and proved.

Where to look is decided by doubles: a proof costs several times what an outline does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import sqrt
from typing import Generic, Protocol, TypeVar

import numpy as np

from gsp.cycles.annulus import Band
from gsp.cycles.conditions import proved
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.outline import NoOutline
from gsp.cycles.sectors import NotProved, Turn, slices
from gsp.proofs.search_progress import SearchProgress

# A largest epsilon is looked for to this share.
RESOLUTION = 1.1
# Half the strips of a sector.
FINE = 48
B = TypeVar("B", bound=Band)


class HasTurn(Protocol):
    """What is proved of a band, or by one."""

    @property
    def turn(self) -> Turn:
        """Its bounds."""
        ...


Proved = TypeVar("Proved", bound=HasTurn)


@dataclass(frozen=True)
class Excess:
    """By how much balls say more than doubles: a `value` at an epsilon, and a power through the last two of them."""

    epsilon: float = 1.0
    value: float = 0.0
    power: float = 4.0

    def at(self, epsilon: float) -> float:
        """What is expected."""
        return self.value * (epsilon / self.epsilon) ** self.power

    def known(self, epsilon: float, value: float) -> Excess:
        """With one more."""
        if not (self.value > 0.0 and value > 0.0 and epsilon != self.epsilon):
            return Excess(epsilon, max(value, 0.0))
        power = math.log(value / self.value) / math.log(epsilon / self.epsilon)
        return Excess(epsilon, value, max(power, 0.0))


class EpsilonSearch(Generic[Proved]):
    """What is `proved` for every epsilon up to one or another, and `why` nothing was for the last."""

    def __init__(self) -> None:
        self.why, self.last = "", 0.0
        self.shown = SearchProgress()
        self._proved: dict[float, Proved | None] = {}
        self._seen: dict[float, float] = {}
        self.excess = Excess()

    def proved(self, epsilon: float) -> Proved:
        """What holds for every epsilon in (0, `epsilon`]; raises `NoOutline` or `NotProved`."""
        raise NotImplementedError

    def seen(self, epsilon: float) -> float:
        """What the bound of the divergence may come to, by doubles; raises `NoOutline` or `NotProved`."""
        raise NotImplementedError

    def within(self, epsilon: float) -> Proved | None:
        """What holds for every epsilon in (0, `epsilon`], found once; None where nothing is proved."""
        self.last = epsilon
        self.shown.looked()
        if epsilon not in self._proved:
            try:
                self._proved[epsilon] = self.proved(epsilon)
            except (NoOutline, NotProved) as error:
                self._proved[epsilon], self.why = None, str(error)
        return self._proved[epsilon]

    def largest(self, begin: float, *, attracts: bool) -> Proved | None:
        """The one for the largest epsilon found, of those whose divergence is negative where it `attracts`; the search
        begins at `begin`.
        """
        best, good, bad, ceiling, failed = None, 0.0, math.inf, math.inf, 0
        while bad > RESOLUTION * good:
            seen = self._expected if attracts else self._sees
            small = _largest_below(seen, begin, good, ceiling, attracts, self.shown)
            if not small > good:
                if good or not (attracts and self.excess.value):
                    break
                # What is known is from too far away.
                self.excess = Excess()
                continue
            found = self.within(small)
            if found is not None:
                self.excess = self.excess.known(small, found.turn.contraction - self._sees(small))
            if found is None or (attracts and not found.turn.contraction < 0.0):
                # Doubles saw what is not so.
                failed, bad = failed + 1, small
            else:
                best, good = found, small
                if not (failed or attracts):
                    break
            if good:
                ceiling = bad if attracts and found else sqrt(good * bad)
            else:
                ceiling = bad / RESOLUTION ** ((failed - (found is not None)) / 2.0)
        return best

    def _expected(self, epsilon: float) -> float:
        """What balls may say of the divergence."""
        known = sorted((small, value) for small, value in self._seen.items() if math.isfinite(value))
        if self.excess.value and epsilon > known[-1][0]:
            return math.inf
        if not self.excess.value or epsilon < known[0][0]:
            return self._sees(epsilon) + self.excess.at(epsilon)
        places, values = zip(*known)
        return float(np.interp(math.log(epsilon), np.log(places), values)) + self.excess.at(epsilon)

    def _sees(self, epsilon: float) -> float:
        self.last = epsilon
        self.shown.looked()
        if epsilon not in self._seen:
            try:
                self._seen[epsilon] = self.seen(epsilon)
            except (NoOutline, NotProved) as error:
                self._seen[epsilon], self.why = math.inf, str(error)
        return self._seen[epsilon]


def _largest_below(
    seen: Callable[[float], float],
    begin: float,
    floor: float,
    ceiling: float,
    negative: bool,
    shown: SearchProgress,
) -> float:
    """The largest epsilon between `floor` and `ceiling` where something is seen, `negative` or whatever it is; `floor`
    where nothing is.
    """

    def serves(small: float) -> bool:
        return seen(small) < (0.0 if negative else math.inf)

    good, bad = floor, ceiling
    small = sqrt(good * bad) if 0.0 < good < bad < math.inf else min(begin, ceiling)
    # It is looked for down to a millionth of where the search begins.
    while small >= 1e-6 * begin and not bad <= RESOLUTION * good:
        shown.bracketed(good, bad, RESOLUTION)
        good, bad = (small, bad) if serves(small) else (good, small)
        small = 2.0 * good if bad == math.inf else 0.25 * bad if good == 0.0 else sqrt(good * bad)
    # Between two values a zero of what doubles see is looked for more closely.
    while 0.0 < good < bad < math.inf and math.isfinite(seen(bad)) and not bad <= 1.02 * good:
        small = sqrt(good * bad)
        good, bad = (small, bad) if serves(small) else (good, small)
    return good


class BandSearch(EpsilonSearch[Proved], Generic[B, Proved]):
    """Bands, which `outlined` finds by doubles; `make` is given the band, epsilon, its `Turn` and the fineness."""

    def __init__(
        self,
        field: EnclosedField,
        outlined: Callable[[float], B],
        make: Callable[[B, float, Turn, int], Proved],
    ) -> None:
        super().__init__()
        self.field, self.outlined, self.make = field, cache(outlined), make

    def proved(self, epsilon: float) -> Proved:
        """A band that is proved for every epsilon in (0, `epsilon`]."""
        band = self.outlined(epsilon)
        return self.make(band, epsilon, proved(self.field, band, epsilon, FINE), FINE)

    def seen(self, epsilon: float) -> float:
        """The sum of the largest divergences that are seen in strips of the band."""
        return seen_divergence(self.field, self.outlined(epsilon), epsilon)


def seen_divergence(field: EnclosedField, band: Band, epsilon: float) -> float:
    """What a `Turn` of the band may contract by: places across each strip are looked at in place of boxes."""
    total = 0.0
    for k in range(len(band.sides)):
        axis = 0 if band.is_slow(k) else 1
        strips = [(*one.box, one.is_passed) for one in slices(band, k, FINE)]
        left, right, bottom, top, passed = np.array(strips).T
        along = np.stack([left, 0.5 * (left + right), right], axis=1)
        # Places across a strip that doubles look at.
        across = bottom[:, None] + np.linspace(0.0, 1.0, 9) * (top - bottom)[:, None]
        places = np.broadcast_arrays(along[:, :, None], across[:, None, :])
        x, y = (v.ravel() for v in (places[::-1] if axis else places))
        f, g, f_x, _, _, g_y, *_ = field.nearby(np.column_stack([x, y]), epsilon)
        rate = g if axis else f
        if not np.isfinite(rate).all() or not ((rate > 0.0).all() or (rate < 0.0).all()):
            raise NotProved(f"the {('slow', 'fast')[axis]} rate is not proved to keep its sign in a sector")
        shares = ((g_y + epsilon * f_x) / np.abs(rate)).reshape(len(left), -1).max(axis=1)
        counted = np.where(passed == 1.0, shares, np.maximum(shares, 0.0)) * (right - left)
        total += float(counted.sum()) * (epsilon if axis else 1.0)
    return total
