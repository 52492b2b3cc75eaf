"""The least quasi-homogeneous weights of a local form, exactly, from its Newton diagram.

A monomial z^a in the rate of z_i has the quasi-degree <w, a>; with weights w >= 0 and degree k it is kept in the
blown-up field where <w, a> - w_i = k, and of higher order where that is larger. Lower it must not be:

    <w, a - e_i> >= k   for every monomial,                                                                         (1)

so that (w, -k) supports the Newton diagram, the points a - e_i (Kuehn, *Multiple time scale dynamics*, 2015, 7.6). The
least weights are taken one kind after the other, by linear programmes over the rationals: those of the fast variables,
which keep the power that decides the fast fibre; of the slow ones in the layer problem, which keep the edge of M0; of
epsilon; of whatever is left. A variable of weight 0 is not blown up: the point is one of a family along it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from math import gcd, lcm
from typing import NamedTuple

import sympy as sp
from sympy.solvers.simplex import InfeasibleLPError, linprog

Exponents = tuple[int, ...]


class Weights(NamedTuple):
    """Whole numbers without a common factor: `of` each variable, and the degree k."""

    of: tuple[int, ...]
    degree: int

    def order(self, exponents: Sequence[int]) -> int:
        """<w, a>: a point a - e_i of the diagram has k where its monomial is kept."""
        return sum(w * a for w, a in zip(self.of, exponents))


def diagram(rates: Iterable[tuple[int, Iterable[Exponents]]]) -> list[Exponents]:
    """The points a - e_i of (i, monomials of the rate of z_i) that no other point makes needless, w being >= 0."""
    points: set[Exponents] = set()
    for i, monomials in rates:
        points |= {(*m[:i], m[i] - 1, *m[i + 1 :]) for m in monomials}
    return sorted(p for p in points if not any(q != p and all(a <= b for a, b in zip(q, p)) for q in points))


def least_weights(points: Sequence[Exponents], stages: Sequence[Sequence[int]]) -> Weights | None:
    """The least weights; None where no w satisfies (1). `stages` are the variables that are fast, slow, and epsilon."""
    size = len(points[0])
    known: dict[int, Fraction] = {}
    lower = [Fraction(0)] * size
    fast, slow, small = stages
    rest = [i for i in range(size) if i not in (*fast, *small)]
    for own, among in ((fast, fast), (slow, (*fast, *slow)), (small, range(size)), (rest, range(size))):
        mine = [p for p in points if all(p[i] == 0 for i in range(size) if i not in among)]
        found = _least(mine, own, known, lower)
        if found is None:
            return None
        if own is slow:
            # epsilon may ask for more: at a folded singularity, of what the layer problem does not hold.
            lower = [max(low, found[i]) if i in slow else low for i, low in enumerate(lower)]
        else:
            known |= {i: found[i] for i in own}
    weights = [known[i] for i in range(size)]
    scale = lcm(*(w.denominator for w in weights))
    whole = [int(w * scale) for w in weights]
    common = gcd(scale, *whole)
    return Weights(tuple(w // common for w in whole), scale // common)


def _least(
    points: Sequence[Exponents], own: Sequence[int], known: dict[int, Fraction], lower: Sequence[Fraction]
) -> list[Fraction] | None:
    """Weights with the least sum over `own` that satisfy (1) for k = 1 and `points`."""
    size = len(lower)
    free = [i for i in range(size) if i not in known]
    # In z = w - lower >= 0: -<z, p> <= <lower, p> - 1, and what is known on the right.
    rows, right = [], []
    for p in points:
        bound = sum((known.get(i, lower[i]) * p[i] for i in range(size)), Fraction(-1))
        if any(p[i] for i in free):
            rows.append([-p[i] for i in free])
            right.append(sp.Rational(bound.numerator, bound.denominator))
        elif bound < 0:
            return None
    values = [sp.Integer(0)] * len(free)
    if rows:
        try:
            _, values = linprog([int(i in own) for i in free], rows, right)
        except InfeasibleLPError:
            return None
    result = [known.get(i, lower[i]) for i in range(size)]
    for i, value in zip(free, values):
        number = sp.Rational(value)
        result[i] = lower[i] + Fraction(int(number.p), int(number.q))
    return result
