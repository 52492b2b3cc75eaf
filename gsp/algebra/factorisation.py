"""Factors, numerators and lowest terms of expressions, within a budget.

An expression is a quotient of polynomials in its symbols and its other indivisible parts, the atoms: exp(u) is one
atom whatever u is, and commensurable exponents and fractional powers of one base share theirs, as in exp(u) and
exp(2 u). python-flint does the algebra. A factorisation is a convenience: what is over the budget is left as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from math import gcd, lcm
from typing import NamedTuple

import flint
import sympy as sp

from gsp.algebra.polynomials import FACTOR_TERMS, centred, polynomial_expression, primitive_multiple, rational

# Products of terms in one multiplication; a polynomial that takes more is not written out.
TERM_PRODUCTS = 20_000
# Nor are polynomials of a higher degree in one generator factored.
FACTOR_DEGREE = 40
# Exponents and roots share an atom when they are such multiples of it at most: exp(6000 u) is none of exp(u).
MULTIPLE = 12


class _TooLarge(Exception):
    """The budget does not suffice."""


class Quotient(NamedTuple):
    """numerator / denominator, coprime, with the generators' meanings in `atoms`."""

    numerator: flint.fmpq_mpoly
    denominator: flint.fmpq_mpoly
    atoms: tuple[sp.Expr, ...]

    def expression(self, polynomial: flint.fmpq_mpoly) -> sp.Expr:
        """One of the polynomials as an expression, a sum of terms about its centres or those of the denominator."""
        return polynomial_expression(polynomial, self.atoms, (self.denominator,))


def quotient(expression: sp.Expr) -> Quotient | None:
    """`expression` in lowest terms with integer coefficients and a positive leading one below; None over budget.

    Generators are ordered by name, so that signs and orders do not depend on how the expression was written.
    """
    atoms = _Atoms(expression)
    try:
        top, bottom = atoms.read(expression)
        if top == 0:
            return Quotient(top, atoms.one, atoms.meaning)
        if not bottom.is_constant():
            _check(top, bottom)
            divisor = top.gcd(bottom)
            top, bottom = top / divisor, bottom / divisor
    except _TooLarge:
        return None
    leading = flint.fmpq(bottom.leading_coefficient())
    bottom, scale = primitive_multiple(bottom * (1 / leading))
    top, lift = primitive_multiple(top * (flint.fmpq(int(scale)) / leading))
    return Quotient(top, bottom * flint.fmpq(int(lift)), atoms.meaning)


def numerator(expression: sp.Expr) -> sp.Expr:
    """Numerator in lowest terms, expanded; the expression itself when that is over the budget."""
    found = quotient(expression)
    return expression if found is None else found.expression(found.numerator)


def lowest_terms(expression: sp.Expr) -> sp.Expr:
    """Numerator over denominator, both expanded; the expression itself when that is over the budget."""
    found = quotient(expression)
    return expression if found is None else _divided_out(found)


def _divided_out(found: Quotient) -> sp.Expr:
    if found.denominator.is_constant():
        return found.expression(found.numerator / found.denominator)
    return found.expression(found.numerator) / found.expression(found.denominator)


def coprime_numerators(expressions: Sequence[sp.Expr]) -> list[sp.Expr] | None:
    """Multiples of `expressions` by one common quotient: expanded, with integer coefficients and no common divisor.

    The leading coefficient of the first that is not zero is positive. None when that is over the budget.
    """
    atoms = _Atoms(*expressions)
    try:
        fractions = [atoms.read(e) for e in expressions]
        below = reduce(_least_common_multiple, (bottom for top, bottom in fractions if top != 0), atoms.one)
        tops = [_product(top, below / bottom) if top != 0 else top for top, bottom in fractions]
        divisor = tops[0] * 0
        for top in tops:
            _check(top, divisor)
            divisor = top.gcd(divisor)
    except _TooLarge:
        return None
    if divisor == 0:
        return [sp.Integer(0)] * len(tops)
    tops = [top / divisor for top in tops]
    numbers = [flint.fmpq(c) for top in tops for c in top.coeffs()]
    content = flint.fmpq(gcd(*(int(c.p) for c in numbers)), lcm(*(int(c.q) for c in numbers)))
    leading = next(top for top in tops if top != 0).leading_coefficient()
    scale = 1 / content if leading > 0 else -1 / content
    return [polynomial_expression(top * scale, atoms.meaning) for top in tops]


def factor_list(expression: sp.Expr) -> tuple[sp.Rational, list[tuple[sp.Expr, int]]]:
    """(c, [(factor, multiplicity), ...]) of the numerator: irreducible factors with positive leading coefficients.

    One factor, the numerator as a whole or the expression itself, when that is over the budget.
    """
    found = quotient(expression)
    if found is None:
        return sp.Integer(1), [(expression, 1)]
    return _factor_list(found, found.numerator)


def _factor_list(
    found: Quotient, polynomial: flint.fmpq_mpoly
) -> tuple[sp.Rational, list[tuple[sp.Expr, int]]]:
    """(c, [(factor, multiplicity), ...]) of one of the polynomials of a quotient."""
    if polynomial.is_constant():
        return rational(polynomial.leading_coefficient() if polynomial != 0 else flint.fmpq(0)), []
    powers = [(polynomial, 1)]
    if len(polynomial) <= FACTOR_TERMS and max(polynomial.degrees()) <= FACTOR_DEGREE:
        powers = [(piece, int(k)) for piece, k in polynomial.factor()[1]]
    result = []
    constant = polynomial.leading_coefficient()
    for piece, k in powers:
        primitive = primitive_multiple(piece * (1 / flint.fmpq(piece.leading_coefficient())))[0]
        constant = constant / primitive.leading_coefficient() ** k
        result.append((_main_degree(primitive), len(primitive), found.expression(primitive), k))
    if len(result) > 1:
        result.sort(key=lambda row: (row[0], row[1], sp.default_sort_key(row[2])))
    return rational(constant), [(e, k) for _, _, e, k in result]


def factors(expression: sp.Expr, variables: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """The factors of `factor_list` that contain `variables` and can vanish: an exponential cannot.

    A power of |u| vanishes where u does, and so does the sign of u: beside u they are no factors of their own.
    """
    found: dict[sp.Expr, None] = {}
    for factor, _ in factor_list(expression)[1]:
        base = factor.base if factor.is_Pow and factor.exp.is_positive else factor
        if isinstance(base, sp.Abs):
            found |= dict.fromkeys(factors(base.args[0], variables))
        elif factor.has(*variables) and not isinstance(factor, sp.exp):
            found[factor] = None
    return [e for e in found if not (isinstance(e, sp.sign) and found.keys() & {e.args[0], -e.args[0]})]


def factored(expression: sp.Expr) -> sp.Expr:
    """The numerator as a product of its factors, times the reciprocal of the denominator's."""
    found = quotient(expression)
    return expression if found is None else _multiplied(found)


def short_forms(expression: sp.Expr) -> tuple[sp.Expr, ...]:
    """`factored`, in `lowest_terms`, and with what its terms share in front; the last alone over the budget."""
    found = quotient(expression)
    if found is None:
        return (_common_in_front(expression),)
    multiplied, divided = _multiplied(found), _divided_out(found)
    if (
        divided == expression
        and found.denominator.is_constant()
        and all(atom.is_Symbol for atom in found.atoms)
    ):
        return multiplied, divided, _content_in_front(found)
    return multiplied, divided, _common_in_front(expression)


def _common_in_front(expression: sp.Expr) -> sp.Expr:
    """The expression as it is written, with what its terms share in front, in its parts too."""
    # One function of one argument stays one, whatever its argument's factors.
    stand_in = {function: sp.Dummy() for function in expression.atoms(sp.Function)}
    back = {dummy: function for function, dummy in stand_in.items()}
    return sp.factor_terms(expression.xreplace(stand_in)).xreplace(back)


def _content_in_front(found: Quotient) -> sp.Expr:
    """The same of an expanded polynomial in symbols, from its coefficients and powers.

    A number below the line is in front where it is below every term.
    """
    polynomial = found.numerator / found.denominator
    if len(polynomial) < 2:
        return found.expression(polynomial)
    numbers = [flint.fmpq(c) for c in polynomial.coeffs()]
    shared = flint.fmpq(gcd(*(int(c.p) for c in numbers)))
    if all(c.q != 1 for c in numbers):
        shared /= lcm(*(int(c.q) for c in numbers))
    if all(c < 0 for c in numbers):
        shared = -shared
    content = found.numerator.term_content()
    content = content / content.leading_coefficient() * shared
    if content == 1:
        return found.expression(polynomial)
    parts = sp.Mul.make_args(found.expression(content))
    return sp.Mul(*parts, found.expression(polynomial / content), evaluate=False)


def _multiplied(found: Quotient) -> sp.Expr:
    parts = []
    for polynomial, sign in ((found.numerator, 1), (found.denominator, -1)):
        constant, powers = _factor_list(found, polynomial)
        parts.append(sp.Mul(constant**sign, *[e ** (sign * k) for e, k in powers]))
    return sp.Mul(*parts)


def coefficients(expression: sp.Expr, symbol: sp.Symbol) -> list[sp.Expr] | None:
    """Coefficients of the numerator by powers of `symbol`, highest first; None if no polynomial, or over budget."""
    found = quotient(expression)
    if found is None or any(atom.has(symbol) for atom in found.atoms if atom != symbol):
        return None
    if symbol not in found.atoms:
        return [found.expression(found.numerator)]
    place = found.atoms.index(symbol)
    rows: dict[int, dict] = {}
    for powers, c in found.numerator.to_dict().items():
        row = rows.setdefault(int(powers[place]), {})
        row[tuple(0 if i == place else k for i, k in enumerate(powers))] = c
    context = found.numerator.context()
    return [found.expression(context.from_dict(rows.get(k, {}))) for k in range(max(rows, default=0), -1, -1)]


def centre(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """c, free of `symbol`, of which the numerator is shorter in `symbol` - c than in `symbol`; 0 where it is not."""
    found = quotient(expression)
    if found is None or symbol not in found.atoms:
        return sp.Integer(0)
    about = symbol - centred(found.numerator, found.atoms)[1][found.atoms.index(symbol)]
    # What stands for another generator may have the symbol in it.
    return sp.Integer(0) if about.has(symbol) else about


def degree(expression: sp.Expr, symbols: Sequence[sp.Symbol]) -> int | None:
    """Total degree of the numerator in `symbols`; None where it is no polynomial in them, or over budget."""
    found = quotient(expression)
    if found is None or any(atom.has(*symbols) for atom in found.atoms if atom not in symbols):
        return None
    places = [i for i, atom in enumerate(found.atoms) if atom in symbols]
    return max((sum(int(powers[i]) for i in places) for powers in found.numerator.monoms()), default=0)


def _main_degree(polynomial: flint.fmpq_mpoly) -> int:
    return next((degree for degree in polynomial.degrees() if degree), 0)


def exponentials(expressions: Iterable[sp.Expr]) -> list[sp.Expr]:
    """The exp(u) of which all the others with commensurable exponents, in no other function, are whole powers."""
    return [atom for atom in _Atoms(*expressions).meaning if isinstance(atom, sp.exp)]


Fraction = tuple[flint.fmpq_mpoly, flint.fmpq_mpoly]


class _Atoms:
    """The generators that expressions need, and their reading in them."""

    def __init__(self, *expressions: sp.Expr) -> None:
        self.shared: dict[sp.Expr, tuple[sp.Expr, int]] = {}
        found: dict[sp.Expr, None] = {}
        seen: set[sp.Expr] = set()
        for expression in expressions:
            _collect(expression, found, seen)
        self._share_exponentials(found)
        self._share_roots(found)
        meaning = {self.shared.get(atom, (atom, 1))[0]: None for atom in found}
        self.meaning = tuple(sorted(meaning, key=lambda atom: (not atom.is_Symbol, sp.default_sort_key(atom))))
        names = [f"t{i}" for i in range(len(self.meaning))]
        self.context = flint.fmpq_mpoly_ctx.get(names, flint.Ordering.lex)
        self.one = self.context.constant(1)
        self._generators = dict(zip(self.meaning, self.context.gens()))
        self._memory: dict[sp.Expr, Fraction] = {}

    def _share_exponentials(self, found: Iterable[sp.Expr]) -> None:
        """One exp(u) for each class of commensurable exponents."""
        classes: dict[sp.Expr, list[tuple[sp.Expr, sp.Rational]]] = {}
        for atom in found:
            if isinstance(atom, sp.exp):
                multiple, direction = _direction(atom.args[0])
                classes.setdefault(direction, []).append((atom, multiple))
        for direction, members in classes.items():
            self._share(members, lambda unit, u=direction: sp.exp(unit * u))

    def _share_roots(self, found: Iterable[sp.Expr]) -> None:
        """One root for all fractional powers of a base, and for the base itself where it is a symbol."""
        classes: dict[sp.Expr, list[tuple[sp.Expr, sp.Rational]]] = {}
        for atom in found:
            if atom.is_Pow and atom.exp.is_Rational:
                classes.setdefault(atom.base, []).append((atom, atom.exp))
        for base, members in classes.items():
            if base.is_Symbol and base in found:
                members.append((base, sp.Integer(1)))
            self._share(members, lambda unit, b=base: b**unit)

    def _share(
        self, members: Sequence[tuple[sp.Expr, sp.Rational]], power: Callable[[sp.Rational], sp.Expr]
    ) -> None:
        bottom = lcm(*(int(multiple.q) for _, multiple in members))
        tops = [int(multiple * bottom) for _, multiple in members]
        unit = gcd(*tops) * (-1 if all(top < 0 for top in tops) else 1)
        if len(members) > 1 and max(map(abs, tops)) <= MULTIPLE * abs(unit):
            atom = power(sp.Rational(unit, bottom))
            self.shared |= {member: (atom, top // unit) for (member, _), top in zip(members, tops)}

    def read(self, expression: sp.Expr) -> Fraction:
        """(numerator, denominator) of `expression`; raises `_TooLarge`."""
        if expression not in self._memory:
            self._memory[expression] = self._read(expression)
        return self._memory[expression]

    def _read(self, expression: sp.Expr) -> Fraction:
        if expression.is_Rational:
            return self.one * flint.fmpq(int(expression.p), int(expression.q)), self.one
        if expression.is_Add:
            return reduce(self._sum, map(self.read, expression.args))
        if expression.is_Mul:
            parts = [self.read(part) for part in expression.args]
            return tuple(reduce(_product, column) for column in zip(*parts))  # pyright: ignore[reportReturnType]
        if expression.is_Pow and expression.exp.is_Integer:
            top, bottom = self.read(expression.base)
            exponent = int(expression.exp)
            if exponent < 0:
                top, bottom, exponent = bottom, top, -exponent
            if bottom == 0:
                raise _TooLarge
            return self._power(top, exponent), self._power(bottom, exponent)
        atom, exponent = self.shared.get(expression, (expression, 1))
        generator = self._generators[atom]
        return (generator**exponent, self.one) if exponent > 0 else (self.one, generator**-exponent)

    def _sum(self, a: Fraction, b: Fraction) -> Fraction:
        if a[1] == b[1]:
            return a[0] + b[0], a[1]
        _check(a[1], b[1])
        common = a[1].gcd(b[1])
        left, right = b[1] / common, a[1] / common
        return _product(a[0], left) + _product(b[0], right), _product(a[1], left)

    def _power(self, base: flint.fmpq_mpoly, exponent: int) -> flint.fmpq_mpoly:
        if len(base) <= 1:
            return base**exponent
        result = self.one
        while exponent:
            if exponent & 1:
                result = _product(result, base)
            exponent >>= 1
            if exponent:
                base = _product(base, base)
        return result


def _collect(expression: sp.Expr, found: dict[sp.Expr, None], seen: set[sp.Expr]) -> None:
    """The atoms of `expression`, in the order in which they are met."""
    if expression in seen or expression.is_Rational:
        return
    seen.add(expression)
    if expression.is_Add or expression.is_Mul:
        for part in expression.args:
            _collect(part, found, seen)
    elif expression.is_Pow and expression.exp.is_Integer:
        _collect(expression.base, found, seen)
    else:
        found[expression] = None


def _direction(exponent: sp.Expr) -> tuple[sp.Rational, sp.Expr]:
    """(c, u) with `exponent` = c u, u the same for all rational multiples."""
    content, rest = exponent.primitive()
    return (-content, -rest) if rest.could_extract_minus_sign() else (content, rest)


def _check(a: flint.fmpq_mpoly, b: flint.fmpq_mpoly) -> None:
    if len(a) * len(b) > TERM_PRODUCTS:
        raise _TooLarge


def _least_common_multiple(a: flint.fmpq_mpoly, b: flint.fmpq_mpoly) -> flint.fmpq_mpoly:
    _check(a, b)
    return _product(a, b / a.gcd(b))


def _product(a: flint.fmpq_mpoly, b: flint.fmpq_mpoly) -> flint.fmpq_mpoly:
    _check(a, b)
    return a * b
