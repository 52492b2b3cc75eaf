"""Irreducible pieces of an algebraic set, as triangular sets that are linear in their main variables.

Decomposition by factors and substitution (Ritt, Wu): a factor c v + d of one equation is solved for the variable v
where c != 0; where c = 0 = d follow pieces of their own. Equations of mass action are linear in a state or in a
parameter at every step, so that nothing but factorisation is needed. Polynomials are python-flint's.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import flint

Polynomial = flint.fmpq_mpoly


class TriangularSet(NamedTuple):
    """Equations psi_1 = ... = psi_r = 0; psi_i has the main variable `pivots[i]`, which no later one contains."""

    equations: tuple[Polynomial, ...]
    pivots: tuple[int, ...]

    @property
    def is_linear(self) -> bool:
        """Whether each equation is linear in its main variable: the piece has a rational parametrisation."""
        return all(psi.degrees()[v] == 1 for psi, v in zip(self.equations, self.pivots))

    def is_regular_on(self, piece: TriangularSet) -> bool:
        """Whether no leading coefficient vanishes on the piece: otherwise the set does not describe it."""
        return all(piece.restricted(leading(psi, v))[0] != 0 for psi, v in zip(self.equations, self.pivots))

    def restricted(self, polynomial: Polynomial) -> tuple[Polynomial, Polynomial]:
        """(a, b) with a/b the polynomial on the piece: for an irreducible one it vanishes there exactly when a = 0."""
        below = polynomial.context().constant(1)
        if not contained(polynomial, self.pivots):
            return polynomial, below
        for psi, v in zip(self.equations, self.pivots):
            polynomial, lead = pseudo_remainder(polynomial, psi, v)
            if lead.is_one():
                continue
            below, other = pseudo_remainder(below * lead, psi, v)
            polynomial *= other
        return polynomial, below

    def shortened(self) -> TriangularSet:
        """The same piece, each equation with what follows from the later ones put in."""
        if not self.is_linear:
            return self
        short: tuple[Polynomial, ...] = ()
        for i, v in reversed([*enumerate(self.pivots)]):
            top, _ = TriangularSet(short, self.pivots[i + 1 :]).restricted(self.equations[i])
            short = (next(q for q, _ in top.factor()[1] if q.degrees()[v]), *short)
        return TriangularSet(short, self.pivots)

    def contains(self, other: TriangularSet) -> bool:
        """Whether the piece lies in that of `other`, which has as many equations: they are the same then."""
        return all(self.restricted(psi)[0] == 0 for psi in other.equations)


class Decomposition(NamedTuple):
    """Pieces of an algebraic set, and how many branches were left because no equation was linear in anything."""

    pieces: list[TriangularSet]
    unsolved: int


class Variables:
    """Which generators are states (or functions of them), which a piece may be solved for, and which parameters."""

    def __init__(self, states: frozenset[int], solvable: tuple[int, ...], parameters: tuple[int, ...]) -> None:
        self.states, self.solvable, self.parameters = states, solvable, parameters
        self._known: dict[tuple[str, frozenset[int]], list[Factor]] = {}

    def factors(self, g: Polynomial, first: frozenset[int] = frozenset()) -> list[Factor]:
        """The factors of `g` that contain states; none where nothing can vanish.

        Of states that are as easy to solve for those in `first` are taken. Remembered, since the same polynomials come
        back at one choice of vanishing parameters after another.
        """
        key = str(g), first
        if key not in self._known:
            self._known[key] = [Factor(*self._pivot(q, first), q) for q, _ in g.factor()[1] if self.moves(q)]
        return self._known[key]

    def moves(self, g: Polynomial) -> bool:
        """Whether `g` contains a state."""
        return contained(g, self.states)

    def _complexity(self, lead: Polynomial) -> int:
        if lead.is_constant() or not self.moves(lead):
            return int(not lead.is_constant())
        return 2 if len({c > 0 for c in lead.coeffs()}) == 1 else 3

    def _pivot(self, q: Polynomial, first: frozenset[int]) -> tuple[int, int]:
        """(score, variable): first a state with a constant coefficient, then one whose coefficient has one sign.

        Parameters come after all states.
        """
        degrees = q.degrees()
        best = (_NONLINEAR, True, -1)
        for group, base in ((self.solvable, 0), (self.parameters, 4)):
            for v in group:
                if degrees[v] == 1:
                    best = min(best, (base + self._complexity(q.derivative(v)), v not in first, v))
        if best[2] < 0:
            return _NONLINEAR, min((i for i in self.states if degrees[i] > 0), key=lambda i: (degrees[i], i))
        return best[0], best[2]


class Factor(NamedTuple):
    """A factor that may vanish, its main variable, and how far it is from being solved for that."""

    score: int
    pivot: int
    polynomial: Polynomial


def decomposed(
    equations: Sequence[Polynomial],
    variables: Variables,
    *,
    most: int,
    count: Callable[[int], None],
    first: frozenset[int] = frozenset(),
) -> Decomposition:
    """The pieces of codimension `most` and less on which no polynomial in the parameters alone vanishes.

    Of generators that are as easy to solve for those in `first` are taken. `count` is told of the terms that are looked
    at, and ends the work by what it raises.
    """
    search = _Search(variables, most, count, first)
    search.branch(equations, TriangularSet((), ()))
    return Decomposition(search.pieces, search.unsolved)


class _Search:
    def __init__(
        self, variables: Variables, most: int, count: Callable[[int], None], first: frozenset[int]
    ) -> None:
        self.variables, self.most, self.count, self.first = variables, most, count, first
        self.pieces: list[TriangularSet] = []
        self.unsolved = 0

    def branch(self, equations: Sequence[Polynomial], found: TriangularSet) -> None:
        equations = [g for g in equations if g != 0]
        if not equations:
            same = (p for p in self.pieces if len(p.pivots) == len(found.pivots))
            if found.equations and not any(found.contains(p) for p in same):
                self.pieces.append(found.shortened())
            return
        if len(found.pivots) == self.most:
            return
        self.count(sum(map(len, equations)))
        choice = min(
            ((self.variables.factors(g, self.first), i) for i, g in enumerate(equations)),
            key=lambda entry: (max((score for score, _, _ in entry[0]), default=-1), len(entry[0]), entry[1]),
        )
        factors, place = choice
        rest = [g for i, g in enumerate(equations) if i != place]
        for score, v, q in factors:
            reduced = [pseudo_remainder(g, q, v)[0] for g in rest]
            further = TriangularSet((*found.equations, q), (*found.pivots, v))
            if not further.is_regular_on(further):
                continue
            if score == _NONLINEAR and any(g != 0 for g in reduced):
                self.unsolved += 1
                continue
            self.branch(reduced, further)
            top = leading(q, v)
            if score != _NONLINEAR and len(found.pivots) + 2 <= self.most and self.variables.moves(top):
                self.branch([top, q - top * q.context().gen(v), *rest], found)


_NONLINEAR = 8


def coefficients_in(polynomial: Polynomial, v: int) -> dict[int, Polynomial]:
    """Coefficients of the powers of generator `v`, those that are not zero."""
    rows: dict[int, dict] = {}
    for powers, c in polynomial.to_dict().items():
        rows.setdefault(int(powers[v]), {})[tuple(0 if i == v else k for i, k in enumerate(powers))] = c
    context = polynomial.context()
    return {k: context.from_dict(row) for k, row in rows.items()}


def leading(polynomial: Polynomial, v: int) -> Polynomial:
    """The coefficient of the highest power of generator `v`."""
    degree = polynomial.degrees()[v]
    # The d-th derivative has d! times the leading coefficient, and nothing of lower powers.
    for k in range(degree):
        polynomial = polynomial.derivative(v) / (k + 1)
    return polynomial


def pseudo_remainder(polynomial: Polynomial, divisor: Polynomial, v: int) -> tuple[Polynomial, Polynomial]:
    """(r, b) with b P = r modulo the divisor, r of lower degree in `v`, b a power of its leading coefficient."""
    degree = divisor.degrees()[v]
    below = polynomial.context().constant(1)
    if polynomial == 0 or polynomial.degrees()[v] < degree:
        return polynomial, below
    lead, variable = leading(divisor, v), polynomial.context().gen(v)
    while polynomial != 0 and (own := polynomial.degrees()[v]) >= degree:
        multiple = leading(polynomial, v) * divisor
        if own > degree:
            multiple *= variable ** (own - degree)
        polynomial = polynomial * lead - multiple
        below *= lead
    return polynomial, below


def contained(polynomial: Polynomial, variables: Collection[int]) -> bool:
    """Whether the polynomial contains one of the variables."""
    degrees = polynomial.degrees()
    return any(degrees[i] > 0 for i in variables)
