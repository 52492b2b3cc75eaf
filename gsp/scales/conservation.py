"""What a flow is made of: its terms as reactions, and the linear combinations of states that none of them changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import flint
import numpy as np
import sympy as sp

from gsp.algebra.laurent import pole_order
from gsp.algebra.polynomials import rational
from gsp.algebra.rational_matrices import null_space
from gsp.algebra.substitution import substituted
from gsp.scales.modes import Coordinates
from gsp.systems.declaration import exact
from gsp.systems.flow import Flow


@dataclass(frozen=True, eq=False)
class Reactions:
    """z' = S R: `rates` R (k expressions), none a rational multiple of another, and `stoichiometry` S (n, k), exact."""

    rates: tuple[sp.Expr, ...]
    stoichiometry: flint.fmpq_mat

    @property
    def matrix(self) -> np.ndarray:
        """S in doubles."""
        rows = self.stoichiometry.table()
        return np.array([[float(entry.p) / float(entry.q) for entry in row] for row in rows]).reshape(
            len(rows), len(self.rates)
        )


# Terms of a rate that is multiplied out, some seconds of work; conditions within conditions have millions.
MOST_TERMS = 10_000


def reactions_of(rates: Sequence[sp.Expr]) -> Reactions:
    """The terms of `rates`; those that differ by a rational factor are one, k e s and -2 k e s.

    A rate that has too many when multiplied out is taken by the terms in which it is written.
    """
    places: dict[sp.Expr, int] = {}
    entries: list[tuple[int, int, sp.Rational]] = []
    for i, rate in enumerate(rates):
        for term in sp.Add.make_args(sp.expand_mul(rate) if terms_multiplied_out(rate) <= MOST_TERMS else rate):
            factor, rest = term.as_coeff_Mul(rational=True)
            if factor != 0:
                entries.append((i, places.setdefault(rest, len(places)), factor))
    matrix = flint.fmpq_mat(len(rates), max(len(places), 1))
    for i, j, factor in entries:
        matrix[i, j] += flint.fmpq(int(factor.p), int(factor.q))
    return Reactions(tuple(places) or (sp.Integer(0),), matrix)


def terms_multiplied_out(expression: sp.Basic) -> int:
    """How many terms there are once all products are multiplied out, at most; those within a function if too many."""
    counts = [terms_multiplied_out(part) for part in expression.args]
    if expression.is_Add or expression.is_Mul:
        return sum(counts) if expression.is_Add else math.prod(counts)
    most = max(counts, default=1)
    return most if most > MOST_TERMS else 1


def conserved_by(flow: Flow, epsilon: float | None = None) -> tuple[Coordinates, tuple[sp.Expr, ...]]:
    """Coordinates across the linear combinations of states that no term of the flow changes, and these combinations.

    At the values of the parameters and, where it is given, of epsilon: i + epsilon d is conserved where a fast d takes
    what i loses. Epsilon stands in a combination as a symbol where that is conserved for all its values.
    """
    small = flow.epsilon
    values = {**flow.parameters, **flow.fixed}
    named = [substituted(rate, values) for rate in flow.rates]
    at = {} if small is None or epsilon is None else {small: exact(epsilon)}
    found = reactions_of([substituted(rate, at) for rate in named] if at else named)
    n = len(flow.states)
    basis = null_space(found.stoichiometry.transpose())
    m = len(basis)
    if not m:
        return Coordinates(np.zeros((0, n)), np.arange(n), np.eye(n)), ()
    echelon, _ = flint.fmpq_mat(m, n, [entry for law in basis for entry in law]).rref()
    rows = echelon.table()
    matrix = np.array([[float(entry.p) / float(entry.q) for entry in row] for row in rows])
    # Each law gives the state in which its row begins.
    bound = [next(j for j, entry in enumerate(row) if entry != 0) for row in rows]
    free = np.setdiff1d(np.arange(n), bound)
    embedding = np.zeros((n, n - m))
    embedding[free, np.arange(n - m)] = 1.0
    embedding[bound] = -matrix[:, free]
    # A state whose rate has a pole is epsilon times as much of a sum.
    powers: dict[sp.Symbol, sp.Expr] = {}
    if small is not None and at:
        powers = {z: (small / at[small]) ** pole_order(rate, small) for z, rate in zip(flow.states, named)}
    laws = []
    for row, first in zip(rows, bound):
        law = sp.Add(*[rational(entry) * state for entry, state in zip(row, flow.states) if entry != 0])
        if powers:
            general = law.xreplace({z: power * z for z, power in powers.items()})
            general = sp.expand_mul(general / general.coeff(flow.states[first]))
            law = general if is_conserved(general, flow.states, named) else law
        laws.append(law)
    return Coordinates(matrix, free, embedding), tuple(laws)


def is_conserved(law: sp.Expr, states: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> bool:
    """Whether the terms of the `rates` leave a linear combination of the `states` as it is, whatever the parameters."""
    change = sp.Add(*[law.coeff(z) * rate for z, rate in zip(states, rates)])
    return all(entry == 0 for row in reactions_of([change]).stoichiometry.table() for entry in row)
