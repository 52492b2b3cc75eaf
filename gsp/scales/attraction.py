"""Whether a critical manifold attracts wherever states and parameters are positive, decided by signs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gsp.algebra.ring_elements import RingElement
from gsp.errors import HyperbolicityError
from gsp.scales.critical_piece import CriticalPiece, determinant
from gsp.scales.triangular_sets import (
    Polynomial,
    TriangularSet,
    coefficients_in,
    contained,
    pseudo_remainder,
)


def attracts(critical: CriticalPiece) -> bool | None:
    """Whether all r eigenvalues across the manifold have negative real parts; None where signs do not decide it.

    True: at every point of it with positive states, and parameters of the signs of their values. False: at none.
    Hurwitz's determinants of the characteristic polynomial are looked at on the manifold, which is
    solved for one variable after another until every coefficient of each has one sign.
    """
    for piece in _ways(critical):
        signs = _hurwitz_signs(CriticalPiece(critical.whole, critical.ray, piece))
        if -1 in signs:
            return False
        if signs and all(sign == 1 for sign in signs):
            return True
    return None


def has_positive_points(critical: CriticalPiece) -> bool | None:
    """Whether states and parameters can be positive, or zero, on the manifold; None where signs do not decide it."""
    answer: bool | None = None
    for piece in _ways(critical):
        if not piece.is_linear:
            continue
        signs = []
        for v, psi in zip(piece.pivots, piece.equations):
            if v in critical.whole.variables.states and v not in critical.whole.variables.solvable:
                continue
            parts = coefficients_in(psi, v)
            known = critical.whole.signs
            below = sign_of(parts[1], known)
            top = 0 if 0 not in parts else sign_of(-parts[0], known)
            signs.append(None if top is None or below is None else top * below * (known.get(v, 1) or 1))
        if -1 in signs:
            return False
        # The values of the others may be any where only one is solved for.
        if all(sign in (0, 1) for sign in signs):
            answer = True
    return answer


def sign_of(polynomial: Polynomial, signs: Mapping[int, int | None]) -> int | None:
    """1, 0 or -1 where every term has this sign for generators of the `signs`, positive by default; else None."""
    others = {i: sign for i, sign in signs.items() if sign != 1}
    found = 0
    for k in range(len(polynomial)):
        sign = 1 if polynomial.coefficient(k) > 0 else -1
        if others:
            powers = polynomial.monomial(k)
            there = [own for i, own in others.items() for _ in range(int(powers[i]))]
            if None in there:
                return None
            sign *= (-1) ** len(there)
        if sign * found < 0:
            return None
        found = sign
    return found


def _sign(element: RingElement, signs: Mapping[int, int | None]) -> int | None:
    sign = sign_of(element.numerator, signs)
    for i, exponent in enumerate(element.exponents):
        if exponent % 2 and sign is not None:
            own = sign_of(element.ring.denominators[i], signs)
            sign = None if own is None else sign * own
    return sign


def _hurwitz_signs(critical: CriticalPiece) -> list[int | None]:
    """Signs of what is positive together when the manifold attracts; none where the field is not defined."""
    r = critical.codimension
    try:
        # lambda^r + a_1 lambda^(r-1) + ... + a_r: attraction needs every a_k positive, and Hurwitz's determinants.
        a = [critical.sigma(k) * (-1) ** k for k in range(1, r + 1)]
    except HyperbolicityError:
        return []
    known = critical.whole.signs
    signs = [_sign(e, known) for e in a]
    if -1 in signs or r < 3:
        return signs
    zero, one = critical.whole.ring.zero, critical.whole.ring.one
    padded = [one, *a]
    for k in range(2, r):
        rows = [
            [padded[2 * i - j + 1] if 0 <= 2 * i - j + 1 <= r else zero for j in range(k)] for i in range(k)
        ]
        signs.append(_sign(critical.again(determinant(rows)), known))
    return signs


def _ways(critical: CriticalPiece) -> Iterator[TriangularSet]:
    """The piece as it is, and solved for every other variable in which its equations are linear."""
    piece, variables = critical.piece, critical.whole.variables
    yield piece
    any_of = (*variables.solvable, *variables.parameters)
    if len(piece.pivots) == 1:
        degrees = piece.equations[0].degrees()
        for v in any_of:
            if degrees[v] == 1 and v != piece.pivots[0]:
                yield TriangularSet(piece.equations, (v,))
        return
    # With several equations: each solved for a parameter where that can be.
    solved: list[Polynomial] = []
    pivots: list[int] = []
    for psi in piece.equations:
        for known, v in zip(solved, pivots):
            psi = pseudo_remainder(psi, known, v)[0]
        degrees = psi.degrees()
        v = next((v for v in variables.parameters if degrees[v] == 1 and v not in pivots), None)
        if v is None:
            v = next((v for v in variables.solvable if degrees[v] == 1), None)
        if v is None or not contained(psi, variables.states):
            return
        solved.append(psi)
        pivots.append(v)
    other = TriangularSet(tuple(solved), tuple(pivots))
    if other.pivots != piece.pivots and other.is_regular_on(piece) and piece.contains(other):
        yield other
