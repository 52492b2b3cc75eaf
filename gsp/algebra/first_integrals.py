"""First integrals of a layer problem z' = L(z): functions phi with grad phi . L = 0.

They are the slow coordinates of a two-scale field. Three searches, in this order: linear, polynomial of degree 2
and 3 (both by exact linear algebra over the field of parameters), and what one quadrature gives.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import sympy as sp
from sympy.core.function import Application
from sympy.polys.matrices import DomainMatrix

from gsp.algebra.elimination_over_rationals import connected_parts
from gsp.algebra.factorisation import (
    TERM_PRODUCTS,
    coprime_numerators,
    factor_list,
    factored,
    lowest_terms,
    quotient,
)
from gsp.algebra.laurent import vanishes
from gsp.algebra.substitution import substituted

# Sets of entries that are tried as the zeros of a sum of amounts.
MOST_RAYS = 300
ELEMENTARY = (
    *(sp.exp, sp.log, sp.sin, sp.cos, sp.tan, sp.asin, sp.acos, sp.atan),
    *(sp.sinh, sp.cosh, sp.tanh, sp.asinh, sp.acosh, sp.atanh, sp.erf),
)


def first_integrals(
    layer: Sequence[sp.Expr],
    states: Sequence[sp.Symbol],
    *,
    count: int,
    parameters: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> list[sp.Expr]:
    """Up to `count` functionally independent first integrals of z' = `layer`, simplest first.

    Returns fewer when the searches find no more. Those of a quadrature are real where the states are positive, at the
    values of the `parameters`.
    """
    direction = _without_common_factor(layer, states)
    found = _linear(direction, states)
    for degree in (2, 3):
        if len(found) >= count:
            break
        for candidate in _polynomial(direction, states, degree):
            if len(found) < count and _is_independent(found, candidate, states):
                found.append(candidate)
    if len(found) < count:
        for candidate in _quadratures(direction, states, parameters or {}):
            if len(found) < count and _is_independent(found, candidate, states):
                found.append(candidate)
    return found[:count]


def _without_common_factor(layer: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """The layer field divided by what all its components share: orbits, hence integrals, stay the same."""
    common = common_factor(layer, states)
    if common == 1:
        return list(layer)
    return [lowest_terms(component / common) if component != 0 else sp.Integer(0) for component in layer]


def common_factor(layer: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> sp.Expr:
    """Greatest common divisor of the components over their common denominator, free of constant factors."""
    rows = [dict(factor_list(component)[1]) for component in layer if component != 0]
    shared = {f: min(row.get(f, 0) for row in rows) for f in rows[0]}
    return sp.Mul(*[f**k for f, k in shared.items() if not f.free_symbols.isdisjoint(states)])


def _coefficient_rows(polynomials: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> list[dict]:
    """Each polynomial as {monomial: coefficient}, monomials in the states and in functions of them."""
    functions = {
        p for e in polynomials for p in e.atoms(Application, sp.Pow) if not p.free_symbols.isdisjoint(states)
    }
    # Functions of the states count as further unknowns, independent of the states themselves.
    stand_in = {p: sp.Dummy() for p in functions if not (p.is_Pow and p.exp.is_Integer and p.exp > 0)}
    places = {z: i for i, z in enumerate((*states, *stand_in.values()))}
    rows = []
    for polynomial in polynomials:
        stood = polynomial.xreplace(stand_in)
        gens = sorted(stood.free_symbols & places.keys(), key=places.__getitem__)
        terms = sp.Poly(stood, *gens).terms() if gens else [((), stood)]
        # Monomials by what stands in them: one in a thousand states has few factors.
        rows.append({tuple((places[z], k) for z, k in zip(gens, m) if k): c for m, c in terms if c != 0})
    return rows


def _left_null_space(rows: list[dict]) -> list[list[sp.Expr]]:
    """Primitive vectors c with sum_i c_i row_i = 0, entries polynomial in the parameters."""
    monomials = sorted({m for row in rows for m in row}, key=str)
    if not monomials:
        return [[sp.Integer(int(i == j)) for j in range(len(rows))] for i in range(len(rows))]
    places = {m: i for i, m in enumerate(monomials)}
    entries = [(places[m], j) for j, row in enumerate(rows) for m in row]
    found: dict[int, list[sp.Expr]] = {}
    # Elimination of all at once has one common denominator, by which every step multiplies every row.
    for held, columns in connected_parts(entries, len(monomials), len(rows)):
        row_of = {monomials[i]: a for a, i in enumerate(held)}
        own = {(row_of[m], b): c for b, j in enumerate(columns) for m, c in rows[j].items()}
        matrix = sp.SparseMatrix(len(held), len(columns), own)
        null = DomainMatrix.from_Matrix(matrix).to_field().nullspace().to_Matrix() if held else sp.eye(1)
        for k in range(null.rows):
            known = {columns[b]: null[k, b] for b in range(null.cols) if null[k, b] != 0}
            row = coprime_numerators(list(known.values()))
            if row is not None:
                known = dict(zip(known, _with_leading_sign(row)))
                found[max(known)] = [known.get(j, sp.S.Zero) for j in range(len(rows))]
    return [found[last] for last in sorted(found)]


def _with_leading_sign(vector: list[sp.Expr]) -> list[sp.Expr]:
    leading = next(v for v in vector if v != 0)
    return [-v for v in vector] if leading.could_extract_minus_sign() else vector


def _in_fewest_digits(vector: list[sp.Expr]) -> list[sp.Expr]:
    """The vector, or where that has fewer digits its multiple whose largest entry is 1: s + c/2 for 2000 s + 1000 c."""
    entries = [entry for entry in vector if entry is not sp.S.Zero]
    if not all(entry.is_Rational for entry in entries):
        return vector
    largest = max(entries, key=abs)
    as_it_is, scaled = (sum(len(str(entry / unit)) for entry in entries) for unit in (1, largest))
    return vector if as_it_is <= scaled else [entry / largest for entry in vector]


def nonnegative_basis(vectors: list[list[sp.Expr]]) -> list[list[sp.Expr]]:
    """A basis of the same space without negative entries, of the shortest vectors, where there is one; else `vectors`.

    Amounts that a reaction conserves are sums of amounts, and a box of amounts bounds their sums, where differences
    run over what no state has. Entries that are parameters are left as they are.
    """
    entries = [entry for vector in vectors for entry in vector if entry is not sp.S.Zero]
    if not any(entry.is_negative for entry in entries) or not all(entry.is_Rational for entry in entries):
        return vectors
    rays = _extreme_rays(sp.Matrix(vectors))
    found: list[list[sp.Expr]] = []
    for ray in sorted(rays, key=lambda r: (sum(v != 0 for v in r), sum(r), [-v for v in r])):
        if sp.Matrix([*found, ray]).rank() > len(found):
            found.append(ray)
    return found if len(found) == len(vectors) else vectors


def _extreme_rays(basis: sp.Matrix) -> list[list[sp.Expr]]:
    """Primitive nonnegative vectors of least support in the row space of `basis`; none beyond `MOST_RAYS`."""
    dimension, n = basis.shape
    found: list[list[sp.Expr]] = []
    if math.comb(n, dimension - 1) > MOST_RAYS:
        return found
    # An extreme ray vanishes on dimension - 1 independent entries.
    for zeros in itertools.combinations(range(n), dimension - 1):
        null = basis[:, list(zeros)].T.nullspace() if zeros else [sp.ones(dimension, 1)]
        if len(null) != 1:
            continue
        vector = coprime_numerators(list(null[0].T * basis))
        if vector is None:
            continue
        vector = _with_leading_sign(vector)
        if all(entry >= 0 for entry in vector) and vector not in found:
            found.append(vector)
    return found


def linear_relations(
    components: Sequence[sp.Expr], states: Sequence[sp.Symbol]
) -> Sequence[Sequence[sp.Expr]] | None:
    """A basis of the c free of `states` with sum_i c_i L_i = 0 for the `components` L; None over budget.

    Of quotients that are long over one denominator it holds what can be seen as they are written.

    The last entry of each that is not zero stands where all others have zeros.
    """
    return _relations(tuple(components), tuple(states))


# A layer's are asked for by its first integrals and by its directions.
@lru_cache(maxsize=4)
def _relations(
    components: tuple[sp.Expr, ...], states: tuple[sp.Symbol, ...]
) -> Sequence[Sequence[sp.Expr]] | None:
    numerators = coprime_numerators(components)
    if numerators is None:
        # Too long over one denominator. As they are written, quotients count as unknowns.
        if any(quotient(term) is None for component in components for term in sp.Add.make_args(component)):
            return None
        numerators = list(components)
    return _left_null_space(_coefficient_rows(numerators, states))


def _linear(direction: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> list[sp.Expr]:
    relations = linear_relations(direction, states)
    if relations is None:
        return []
    vectors = [_in_fewest_digits(vector) for vector in nonnegative_basis(list(map(list, relations)))]
    held = [[i for i, c in enumerate(vector) if c is not sp.S.Zero] for vector in vectors]
    integrals = [sp.Add(*[vector[i] * states[i] for i in places]) for vector, places in zip(vectors, held)]
    # Single states first, then in the order of the first state they contain.
    return [integrals[k] for k in sorted(range(len(integrals)), key=held.__getitem__)]


def _polynomial(direction: Sequence[sp.Expr], states: Sequence[sp.Symbol], degree: int) -> list[sp.Expr]:
    if not all(component.is_rational_function(*states) for component in direction):
        return []
    monomials = [
        sp.Mul(*choice)
        for d in range(degree, 0, -1)
        for choice in itertools.combinations_with_replacement(states, d)
    ]
    numerators = coprime_numerators(direction) if len(monomials) <= 400 else None
    if numerators is None or sum(len(sp.Add.make_args(n)) for n in numerators) * len(monomials) > TERM_PRODUCTS:
        return []
    rates = [sp.expand(sum(sp.diff(m, z) * n for z, n in zip(states, numerators))) for m in monomials]
    rows = [dict(sp.Poly(rate, *states).terms()) if rate != 0 else {} for rate in rates]
    vectors = _left_null_space(rows)
    integrals = [sp.Add(*[c * m for c, m in zip(vector, monomials)]) for vector in vectors]
    return sorted(integrals, key=lambda phi: (sp.Poly(phi, *states).total_degree(), sp.count_ops(phi)))


def _quadratures(
    direction: Sequence[sp.Expr], states: Sequence[sp.Symbol], parameters: Mapping[sp.Symbol, sp.Expr]
) -> list[sp.Expr]:
    """Integrals of dz_i/dz_j = N_i/N_j where it is separable, or linear in z_i; other states must be constant.

    Those without a logarithm come first: z exp(-t) is an integral everywhere, log(z^2)/2 - t for z != 0 only.
    """
    moving = [z for z, component in zip(states, direction) if component != 0]
    rates = dict(zip(states, direction))
    # Two rates that are equal make a pole of 1/(a - b), and one that is negative sqrt(a) imaginary.
    values = {**{z: sp.Dummy(z.name, positive=True) for z in states}, **parameters}
    found: list[sp.Expr] = []
    for z, t in itertools.permutations(moving, 2):
        ratio: Any = factored(rates[z] / rates[t])
        # Longer quotients are not integrated.
        if ratio.has(*[s for s in moving if s not in (z, t)]) or sp.count_ops(ratio) > 60:
            continue
        for candidate in (_linear_equation(ratio, z, t), _separable(ratio, z, t)):
            candidate = None if candidate is None else _with_real_logarithms(candidate)
            if candidate is None or candidate in found:
                continue
            if candidate.xreplace(values).has(sp.I, sp.zoo, sp.nan, sp.oo, -sp.oo):
                continue
            if vanishes(sp.Add(*[sp.diff(candidate, s) * rates[s] for s in moving])):
                found.append(candidate)
    return sorted(found, key=lambda phi: (phi.has(sp.log), sp.count_ops(phi)))


def _with_real_logarithms(phi: sp.Expr) -> sp.Expr:
    """`phi` with log(u) as log(u^2)/2, of the same slope and real on both sides of u = 0, unless u > 0 everywhere."""
    real = {s: sp.Dummy(s.name, real=True) for s in phi.free_symbols}

    def logarithm(u: sp.Expr) -> sp.Expr:
        if u.xreplace(real).is_positive:
            return sp.log(u)
        return sp.log((-u if u.could_extract_minus_sign() else u) ** 2) / 2

    return phi.replace(sp.log, logarithm)


def _separable(ratio: sp.Expr, z: sp.Symbol, t: sp.Symbol) -> sp.Expr | None:
    of_z, rest = [], []
    for factor in sp.Mul.make_args(ratio):
        if factor.has(z) and factor.has(t):
            return None
        (of_z if factor.has(z) else rest).append(factor)
    left, right = _antiderivative(1 / sp.Mul(*of_z), z), _antiderivative(sp.Mul(*rest), t)
    return None if left is None or right is None else left - right


def _linear_equation(ratio: sp.Expr, z: sp.Symbol, t: sp.Symbol) -> sp.Expr | None:
    slope = sp.diff(ratio, z)
    if slope.has(z):
        return None
    exponent = _antiderivative(slope, t)
    if exponent is None:
        return None
    factor = sp.simplify(sp.exp(-exponent))
    offset = _antiderivative(lowest_terms(ratio - slope * z) * factor, t)
    return None if offset is None else sp.factor_terms(sp.expand(z * factor - offset))


def _antiderivative(expression: sp.Expr, t: sp.Symbol) -> sp.Expr | None:
    """An elementary antiderivative by textbook rules, or None.

    SymPy's general `integrate` can take minutes to fail. Other symbols count as positive meanwhile, so that no
    case distinctions arise; the caller checks what comes back.
    """
    if not _is_tractable(expression, t):
        return None
    constant, integrand = expression.as_independent(t, as_Add=False)
    found = _by_rules(integrand, t)
    return None if found is None else constant * found


# The same integrand comes with every order of the variables, and each may take seconds.
@lru_cache(maxsize=64)
def _by_rules(expression: sp.Expr, t: sp.Symbol) -> sp.Expr | None:
    from sympy.integrals.manualintegrate import manualintegrate

    stand_in = {s: sp.Dummy(s.name, positive=True) for s in expression.free_symbols if s != t}
    back = {dummy: s for s, dummy in stand_in.items()}
    if expression.is_rational_function(t) and _degree_below(expression, t) ** 3 <= TERM_PRODUCTS:
        # The rules try every way to write a quotient before they come to this one.
        expression = sp.apart(expression, t)
    result = manualintegrate(expression.xreplace(stand_in), t).xreplace(back)
    if result.has(sp.Integral, sp.Piecewise, sp.RootSum, sp.I) or not _is_elementary(result):
        return None
    return result


def _degree_below(expression: sp.Expr, t: sp.Symbol) -> int:
    return int(sp.degree(sp.fraction(sp.together(expression))[1], t))


def _is_tractable(expression: sp.Expr, t: sp.Symbol) -> bool:
    """False for quotients whose denominators have factors of degree 2 with parameters, or higher: no useful formula.

    False too for what is over the budget of factorisation.
    """
    found = quotient(expression)
    if found is None:
        return False
    for base, _ in factor_list(found.expression(found.denominator))[1]:
        if not base.has(t) or not base.is_polynomial(t):
            continue
        degree = sp.degree(base, t)
        if degree > 2 or (degree == 2 and base.free_symbols != {t}):
            return False
    return True


def _is_elementary(expression: sp.Expr) -> bool:
    return all(isinstance(piece, ELEMENTARY) for piece in expression.atoms(sp.Function))


def _is_independent(known: list[sp.Expr], candidate: sp.Expr, states: Sequence[sp.Symbol]) -> bool:
    """Whether the gradients are linearly independent at a generic point (exact primes for every symbol)."""
    functions = [*known, candidate]
    symbols = sorted(set().union(*(f.free_symbols for f in functions)) | set(states), key=str)
    point = {s: sp.Rational(sp.prime(i + 3), sp.prime(i + 5)) for i, s in enumerate(symbols)}
    gradient = sp.Matrix([[substituted(sp.diff(f, z), point) for z in states] for f in functions])
    return gradient.rank() == len(functions)
