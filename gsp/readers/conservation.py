"""What a stoichiometry conserves, exactly: sums of amounts that no reaction changes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import NamedTuple

import flint

ENTRIES = 250_000
"""Bound on species times reactions: elimination takes cubic time."""


class Law(NamedTuple):
    """`species` less the sum of `others`, each with its coefficient, is a constant."""

    species: str
    others: Mapping[str, Fraction]


def conserved(stoichiometry: Mapping[str, Mapping[str, Fraction]]) -> list[Law] | None:
    """All conservation laws of `stoichiometry`, {species: {reaction: coefficient}}, each solved for its own species.

    Species that come first are kept: none that is solved for stands in another law. None beyond `ENTRIES`.

    >>> conserved({"c": {"r": Fraction(1)}, "e": {"r": Fraction(-1)}})
    [Law(species='e', others={'c': Fraction(-1, 1)})]
    """
    species = list(stoichiometry)
    reactions = sorted({name for row in stoichiometry.values() for name in row})
    if not species or not reactions:
        return []
    if len(species) * len(reactions) > ENTRIES:
        return None
    # Left null vectors of N, from the reduced echelon form of its transpose: a column without a pivot is a species that
    # the pivots determine.
    row = {reaction: i for i, reaction in enumerate(reactions)}
    matrix = flint.fmpq_mat(len(reactions), len(species))
    for j, name in enumerate(species):
        for reaction, value in stoichiometry[name].items():
            matrix[row[reaction], j] = flint.fmpq(value.numerator, value.denominator)
    echelon, rank = matrix.rref()
    pivots: list[int] = []
    for i in range(rank):
        begin = pivots[-1] + 1 if pivots else 0
        pivots.append(next(j for j in range(begin, len(species)) if echelon[i, j] != 0))
    dependent = sorted(set(range(len(species))) - set(pivots))
    laws = []
    for j in dependent:
        others = {
            species[p]: Fraction(int(echelon[i, j].p), int(echelon[i, j].q))
            for i, p in enumerate(pivots)
            if echelon[i, j] != 0
        }
        laws.append(Law(species[j], others))
    return laws


def most_of(laws: Sequence[Law], amounts: Mapping[str, float]) -> dict[str, float]:
    """The most there can be of each species in a sum of `laws`, given all `amounts`; none negative, and no coefficient.

    >>> most_of([Law("e", {"c": Fraction(-2)})], {"e": 1.0, "c": 0.5})
    {'e': 2.0, 'c': 1.0}
    """
    found: dict[str, float] = {}
    for law in laws:
        shares = {law.species: 1.0} | {name: float(-c) for name, c in law.others.items()}
        total = sum(share * amounts[name] for name, share in shares.items())
        if (
            min(shares.values()) > 0.0
            and min(amounts[name] for name in shares) >= 0.0
            and 0.0 < total < math.inf
        ):
            found |= {name: min(total / share, found.get(name, math.inf)) for name, share in shares.items()}
    return found
