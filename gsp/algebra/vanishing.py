"""Whether a polynomial is proved to vanish nowhere in a box, and to have simple roots: by discriminants.

Over a connected set on which the leading coefficient and the discriminant of p in one variable do not vanish, and
neither does p at both ends of that variable's interval, the real roots of p in the interval are simple, none enters and
none leaves it, so that their number is the same everywhere: where it is 0 at one point, p vanishes nowhere (S. Basu,
R. Pollack and M.-F. Roy, Algorithms in Real Algebraic Geometry, 2006, section 5.1). The conditions are questions of the
same kind with a variable less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import flint
import sympy as sp

from gsp.algebra.factorisation import quotient

Interval = tuple[flint.fmpq, flint.fmpq]

# Beyond this a discriminant is not sought: its degree goes with twice that of p, and with each variable anew.
MOST_TERMS, MOST_DEGREE = 120, 12


def vanishes_nowhere(polynomial: flint.fmpq_mpoly, box: Sequence[Interval]) -> bool:
    """Whether it is proved that `polynomial` has no zero in `box`, an interval for each of its generators.

    >>> context = flint.fmpq_mpoly_ctx.get(["x", "y"], flint.Ordering.lex)
    >>> x, y = context.gens()
    >>> box = [(flint.fmpq(1), flint.fmpq(50))] * 2
    >>> vanishes_nowhere((x - y) ** 2 + (x + y) / 50, box), vanishes_nowhere((x - y) ** 2 - 1, box)
    (True, False)
    """
    if polynomial == 0:
        return False
    return all(_factor_vanishes_nowhere(factor, box) for factor, _ in polynomial.factor()[1])


def _factor_vanishes_nowhere(p: flint.fmpq_mpoly, box: Sequence[Interval]) -> bool:
    degrees = [int(d) for d in p.degrees()]
    used = sorted((i for i, d in enumerate(degrees) if d), key=lambda i: degrees[i])
    if len(used) == 1:
        return not real_roots_within(p, used[0], box[used[0]])
    if len(p.monoms()) > MOST_TERMS or sum(degrees) > MOST_DEGREE:
        return False
    return any(_has_no_root_along(p, i, degrees[i], box) for i in used)


def _has_no_root_along(p: flint.fmpq_mpoly, i: int, degree: int, box: Sequence[Interval]) -> bool:
    """Whether p, as a polynomial in generator i, is proved to have no root in its interval over all of the others."""
    names = p.context().names()
    ends = [p.subs({names[i]: end}) for end in box[i]]
    middle: dict[str | int, Any] = {names[k]: (low + high) / 2 for k, (low, high) in enumerate(box) if k != i}
    if real_roots_within(p.subs(middle), i, box[i]):
        return False
    conditions = [*ends, leading_coefficient(p, i)]
    if degree > 1:
        conditions.append(p.discriminant(names[i]))
    return all(vanishes_nowhere(condition, box) for condition in conditions)


def leading_coefficient(p: flint.fmpq_mpoly, i: int) -> flint.fmpq_mpoly:
    """The coefficient of the highest power of generator i, a polynomial in the others."""
    degree = int(p.degrees()[i])
    rows = {
        tuple(0 if k == i else int(e) for k, e in enumerate(exponents)): c
        for exponents, c in p.to_dict().items()
        if int(exponents[i]) == degree
    }
    return p.context().from_dict(rows)


def real_roots_within(p: flint.fmpq_mpoly, i: int, interval: Interval) -> int:
    """How many different roots of p, a polynomial in generator i alone, are not proved to lie outside the interval."""
    coefficients = [flint.fmpq(0)] * (int(p.degrees()[i]) + 1)
    for exponents, c in p.to_dict().items():
        coefficients[int(exponents[i])] = c
    whole = flint.fmpq_poly(coefficients).numer()
    low, high = (flint.arb(end) for end in interval)
    found: Any = whole.complex_roots()
    roots = [root.real for root, _ in found if root.imag == 0]
    return sum(not (root < low or root > high) for root in roots)


def has_simple_roots(
    expression: sp.Expr, unknown: sp.Symbol, sides: Mapping[sp.Symbol, tuple[float, float]]
) -> bool:
    """Whether `expression` is a polynomial of which all roots in `unknown` are proved to be simple and finite wherever
    the other symbols are within `sides`.
    """
    found = quotient(expression)
    if found is None or not found.denominator.is_constant() or unknown not in found.atoms:
        return False
    if not all(atom in sides for atom in found.atoms if atom != unknown):
        return False
    p, place = found.numerator, found.atoms.index(unknown)
    # The unknown itself occurs in nothing that is asked.
    ends = [sides.get(atom, (0.0, 0.0)) for atom in found.atoms]
    box = [(flint.fmpq(*low.as_integer_ratio()), flint.fmpq(*high.as_integer_ratio())) for low, high in ends]
    asked = [leading_coefficient(p, place)]
    if int(p.degrees()[place]) > 1:
        asked.append(p.discriminant(p.context().names()[place]))
    return all(vanishes_nowhere(polynomial, box) for polynomial in asked)
