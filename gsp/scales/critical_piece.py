"""A critical manifold at a special value: the linear part across it, the reduction, and whether it attracts.

On a piece of {F_0 = 0} of codimension r the linear part M = D F_0 has rank r at most. Its other eigenvalues are not
zero where sigma_r, the sum of the principal minors of order r, is not (Goeke, Walcher, Zerz 2015, proposition 1). With
r independent columns C and rows R of M the projection along the fast fibres is 1 - C (R C)^-1 R, which is
1 - P (D psi P)^-1 D psi for any F_0 = P psi (Goeke and Walcher 2014).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import flint
import sympy as sp

from gsp.algebra.inversion import solve_for
from gsp.algebra.polynomials import primitive_multiple
from gsp.algebra.ring_elements import RingElement
from gsp.errors import HyperbolicityError
from gsp.scales.polynomial_field import Fraction, PolynomialField, Ray
from gsp.scales.triangular_sets import Polynomial, TriangularSet


class CriticalPiece:
    """One irreducible critical manifold of a ray; polynomials in the field's variables."""

    def __init__(self, whole: PolynomialField, ray: Ray, piece: TriangularSet) -> None:
        self.whole, self.ray, self.piece = whole, ray, piece

    @property
    def codimension(self) -> int:
        """How many directions are fast."""
        return len(self.piece.pivots)

    @cached_property
    def is_hyperbolic(self) -> bool:
        """Whether the r eigenvalues across the manifold are not zero at its generic points."""
        try:
            return not self.sigma(self.codimension).is_zero
        except HyperbolicityError:
            # A denominator vanishes on the piece: the field is not defined there.
            return False

    @property
    def is_in_domain(self) -> bool:
        """Whether the field has values on it: F_1 = 1/x and exp(-E/T) have none on x = 0 and on T = 0."""
        if any(self._vanishes(below) for _, below in self.ray.drift):
            return False
        field, graph = self.whole.field, self.graph
        if graph is None or not self.whole.has_functions:
            return True
        return not any(rate.xreplace(graph).has(sp.zoo, sp.nan, sp.oo) for rate in field.rates)

    @cached_property
    def linear_part(self) -> list[list[RingElement]]:
        """M = D F_0 (n, n) on the piece, in the variables that are free there."""
        return [[self.on_piece(entry) for entry in row] for row in self.ray.jacobian]

    def on_piece(self, fraction: Fraction) -> RingElement:
        """The fraction on the piece; raises `HyperbolicityError` where its denominator vanishes there."""
        top, left = self._restrict(fraction[0])
        below, right = self._restrict(fraction[1])
        return self._element(top * right, below * left)

    def _vanishes(self, polynomial: Polynomial) -> bool:
        return RingElement(self.whole.ring, self._restrict(polynomial)[0], ()).reduced().is_zero

    def _restrict(self, polynomial: Polynomial) -> tuple[Polynomial, Polynomial]:
        """Top and denominator on the piece, within the ring's budget."""
        for psi in self.piece.equations:
            self.whole.ring.spend(polynomial, psi)
        top, below = self.piece.restricted(polynomial)
        return top.subs(self._fixed), below.subs(self._fixed)

    @cached_property
    def _fixed(self) -> dict[str | int, flint.fmpq]:
        """Generators of one rational value on the manifold: sqrt(z) and tanh(z) on z = 0, and z on tanh(z) = 0."""
        if not self.piece.is_linear or not self.whole.functions:
            return {}
        ring, states = self.whole.ring, {i: state for state, i in self.whole.places.items()}
        known = {}
        for v in self.piece.pivots:
            top, below = (
                ring.to_sympy(RingElement(ring, part, ()))
                for part in self.piece.restricted(ring.context.gen(v))
            )
            known[states.get(v, self.whole.functions.get(v))] = top / below
        for function, value in list(known.items()):
            held = [s for s in states.values() if function != s and function.has(s)]
            # A function that is known and holds one state tells that state.
            known |= (solve_for(held, {value: function}) or {}) if len(held) == 1 else {}
        generators = {**self.whole.functions, **states}
        values = {i: known.get(e, e.xreplace(known)) for i, e in generators.items()}
        return {i: flint.fmpq(int(c.p), int(c.q)) for i, c in values.items() if c.is_Rational}

    def _element(self, top: Polynomial, below: Polynomial) -> RingElement:
        ring = self.whole.ring
        found = RingElement(ring, top, ())
        return found.reduced() if below.is_one() else (found * RingElement(ring, below, ()).inverse()).reduced()

    def sigma(self, k: int) -> RingElement:
        """The sum of the principal minors of order k of M: up to its sign the characteristic polynomial has it."""
        total = self.whole.ring.zero
        for chosen in itertools.combinations(range(len(self.linear_part)), k):
            total = total + determinant([[self.linear_part[i][j] for j in chosen] for i in chosen])
        return self.again(total)

    def again(self, element: RingElement) -> RingElement:
        """A product of residues, as a residue again where an equation is not linear in its main variable."""
        return (element if self.piece.is_linear else self._restricted(element)).reduced()

    # -- the manifold and the flow on it ------------------------------------------------------------

    @cached_property
    def equations(self) -> tuple[sp.Expr, ...]:
        """What vanishes on the manifold."""
        ring = self.whole.ring
        return tuple(ring.to_sympy(RingElement(ring, _primitive(psi), ())) for psi in self.piece.equations)

    @cached_property
    def graph(self) -> dict[sp.Symbol, sp.Expr] | None:
        """Fast states as functions of the others on the manifold; None where an equation is not linear in a state."""
        meaning = {i: state for state, i in self.whole.places.items() if state in self.whole.field.states}
        if not self.piece.is_linear or not set(self.piece.pivots) <= set(meaning):
            return None
        context = self.whole.ring.context
        one = context.constant(1)
        graph = {
            meaning[v]: self.whole.ring.to_sympy(self.on_piece((context.gen(v), one)))
            for v in self.piece.pivots
        }
        # Within a function a state is no polynomial's variable, and is still there.
        graph = {state: e.xreplace(graph) for state, e in graph.items()}
        return None if any(e.has(*graph) for e in graph.values()) else graph

    @cached_property
    def reduction(self) -> dict[sp.Symbol, sp.Expr]:
        """x' = (1 - C (R C)^-1 R) F_1 on the manifold, in slow time, of every state.

        In the states that `graph` leaves, or where there is none in all of them.
        """
        explicit = self.graph is not None
        states = self.whole.field.states
        n, r = len(states), self.codimension
        ring = self.whole.ring
        if explicit:
            matrix, drift = self.linear_part, [self.on_piece(part) for part in self.ray.drift]
        else:
            matrix = [[self._element(*entry) for entry in row] for row in self.ray.jacobian]
            drift = [self._element(*part) for part in self.ray.drift]
        rows, columns, inner = self._independent(matrix, n, r)
        scale = determinant(inner).inverse()
        right = [_sum(ring.zero, (matrix[i][j] * drift[j] for j in range(n))).reduced() for i in rows]
        result = {}
        for i, state in enumerate(states):
            # Cramer's rule: row i of C (R C)^-1 applied to R F_1.
            moved = ring.zero
            for k in range(r):
                replaced = [[*row[:k], right[m], *row[k + 1 :]] for m, row in enumerate(inner)]
                moved = moved + matrix[i][columns[k]] * determinant(replaced)
            result[state] = ring.to_sympy((drift[i] - (moved * scale)).reduced()).xreplace(self.graph or {})
        return result

    def _independent(
        self, matrix: list[list[RingElement]], n: int, r: int
    ) -> tuple[tuple[int, ...], tuple[int, ...], list[list[RingElement]]]:
        """Rows R, columns C and R C, which is invertible on the piece."""
        zero = self.whole.ring.zero
        for rows, columns in itertools.product(itertools.combinations(range(n), r), repeat=2):
            inner = [
                [_sum(zero, (matrix[i][k] * matrix[k][j] for k in range(n))).reduced() for j in columns]
                for i in rows
            ]
            if not self.again(self._restricted(determinant(inner))).is_zero:
                return rows, columns, inner
        raise AssertionError("sigma_r is not zero, so M^2 has rank r")

    def _restricted(self, element: RingElement) -> RingElement:
        top, left = self._restrict(element.numerator)
        found = RingElement(self.whole.ring, top, element.exponents)
        return found if left.is_one() else found * RingElement(self.whole.ring, left, ()).inverse()


def determinant(matrix: Sequence[Sequence[RingElement]]) -> RingElement:
    """By rows, each time along the one with most zeros."""
    if len(matrix) == 1:
        return matrix[0][0]
    i = max(range(len(matrix)), key=lambda k: (sum(e.is_zero for e in matrix[k]), -k))
    total: RingElement | None = None
    for j, entry in enumerate(matrix[i]):
        if entry.is_zero:
            continue
        minor = [[e for m, e in enumerate(row) if m != j] for k, row in enumerate(matrix) if k != i]
        term = entry * determinant(minor)
        term = -term if (i + j) % 2 else term
        total = term if total is None else total + term
    return matrix[i][0] if total is None else total.reduced()


def _sum(zero: RingElement, terms) -> RingElement:
    for term in terms:
        zero = zero + term
    return zero


def _primitive(psi: Polynomial) -> Polynomial:
    """With integer coefficients and a positive leading one."""
    leading = psi.leading_coefficient()
    return primitive_multiple(psi * (1 / leading))[0]
