"""Real points of polynomial systems, exactly: each a rational map of one real algebraic number.

The ideal is made radical by the squarefree parts of its elimination polynomials (Seidenberg's lemma); then a
coordinate, or a linear form, separates the points and every coordinate is a polynomial in it (the shape lemma;
Cox, Little and O'Shea, "Using algebraic geometry", chapter 2).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import flint
import sympy as sp
from sympy.polys.polyerrors import PolynomialError

from gsp.algebra.polynomials import rational
from gsp.algebra.precision import precision
from gsp.errors import GspError

# So is one with more complex solutions, counted with multiplicity; past this, elimination takes minutes.
SOLUTION_LIMIT = 16
# Polynomials of a basis, terms of one and bits of its coefficients: with more of them a basis takes minutes.
BASIS_LIMITS = (100, 400, 2**12)
# Precision at which coordinates are rounded to doubles.
BITS = 80


class InfinitelyManyPoints(GspError):
    """A polynomial system whose solutions are not isolated."""


class NumberField:
    """QQ[theta]/(m): elements are polynomials in theta of degree below that of m."""

    def __init__(self, minimal: flint.fmpq_poly, theta: sp.Expr) -> None:
        self.minimal = minimal
        self.theta = theta
        self.degree = minimal.degree()

    def reduce(self, a: flint.fmpq_poly) -> flint.fmpq_poly:
        """The representative of `a` of least degree."""
        return a % self.minimal if a.degree() >= self.degree else a

    def multiply(self, a: flint.fmpq_poly, b: flint.fmpq_poly) -> flint.fmpq_poly:
        """The product of two elements."""
        return self.reduce(a * b)

    def inverse(self, a: flint.fmpq_poly) -> flint.fmpq_poly:
        """1/a; raises `ZeroDivisionError` for 0."""
        if a.is_zero():
            raise ZeroDivisionError("0 has no inverse")
        common, s, _ = a.xgcd(self.minimal)
        return self.reduce(s * (1 / flint.fmpq(common[0])))

    def ball(self, a: flint.fmpq_poly, bits: int) -> flint.arb:
        """An enclosure of the real number `a` with at least `bits` correct bits, whatever cancels in the sum."""
        a = self.reduce(a)
        if a.is_zero():
            return flint.arb(0)
        within = bits + 16
        # The value is not 0, so that this ends.
        while True:
            with precision(within):
                value = self._enclosed(a, within)
            if value.rel_accuracy_bits() >= bits:
                return value
            within *= 2

    def _enclosed(self, a: flint.fmpq_poly, bits: int) -> flint.arb:
        """An enclosure of `a` from about `bits` correct bits of theta."""
        if a.degree() <= 0:
            return arb(rational(a[0]))
        digits = max(15, int(bits * 0.30103) + 5)
        middle = sp.N(self.theta, digits)
        radius = arb(sp.Rational(1, 10 ** (digits - 4))) * (1 + abs(flint.arb(str(middle))))
        theta = flint.arb(str(middle)) + radius * flint.arb(0, 1)
        result = flint.arb(0)
        for coefficient in reversed(a.coeffs()):
            result = result * theta + arb(rational(coefficient))
        return result

    def sign(self, a: flint.fmpq_poly) -> int:
        """-1, 0 or 1, decided exactly."""
        value = self.ball(a, 32)
        return int(value > 0) - int(value < 0)

    def expression(self, a: flint.fmpq_poly) -> sp.Expr:
        """The element as a SymPy expression in theta."""
        terms = [rational(c) * self.theta**i for i, c in enumerate(self.reduce(a).coeffs())]
        total = sp.Add(*terms)
        return sp.expand(total) if self.degree == 2 else total


def arb(value: sp.Rational | flint.fmpq) -> flint.arb:
    """An enclosure of a rational number at the present precision."""
    return flint.arb(flint.fmpq(int(value.p), int(value.q)))


@dataclass(frozen=True, eq=False)
class AlgebraicPoint:
    """A real point with coordinates in `field`; `values` are elements of it, by symbol."""

    field: NumberField
    values: Mapping[sp.Symbol, flint.fmpq_poly]

    @property
    def is_rational(self) -> bool:
        """Whether every coordinate is rational."""
        return all(value.degree() <= 0 for value in self.values.values())

    def expressions(self) -> dict[sp.Symbol, sp.Expr]:
        """The coordinates as SymPy expressions."""
        return {symbol: self.field.expression(value) for symbol, value in self.values.items()}

    def numbers(self) -> dict[sp.Symbol, float]:
        """The coordinates as floats, the same for equal ones in whatever field they are given."""
        return {symbol: float(self.field.ball(value, BITS).mid()) for symbol, value in self.values.items()}

    def near(self, bits: int) -> dict[sp.Symbol, sp.Rational]:
        """The coordinates as fractions, to about `bits` bits."""
        found = {}
        with precision(bits):
            for symbol, value in self.values.items():
                # A product has the present precision.
                rounded = 1 * self.field.ball(value, bits)
                mantissa, power = rounded.mid().man_exp()
                found[symbol] = sp.Rational(int(mantissa)) * sp.Integer(2) ** int(power)
        return found

    def value(self, expression: sp.Expr) -> flint.fmpq_poly:
        """The element that a rational function of the coordinates takes here."""
        field = self.field
        if expression.is_Symbol:
            return self.values[expression]  # pyright: ignore[reportArgumentType]
        if expression.is_Rational:
            return flint.fmpq_poly([flint.fmpq(int(expression.p), int(expression.q))])
        if expression.is_Add:
            total = flint.fmpq_poly([0])
            for part in expression.args:
                total = total + self.value(part)  # pyright: ignore[reportArgumentType]
            return total
        if expression.is_Mul:
            product = flint.fmpq_poly([1])
            for part in expression.args:
                product = field.multiply(product, self.value(part))  # pyright: ignore[reportArgumentType]
            return product
        if expression.is_Pow and expression.exp.is_Integer:
            base, exponent = self.value(expression.base), int(expression.exp)
            if exponent < 0:
                base, exponent = field.inverse(base), -exponent
            result = flint.fmpq_poly([1])
            for _ in range(exponent):
                result = field.multiply(result, base)
            return result
        raise PolynomialError(f"{expression} is not rational")


def rational_point(values: Mapping[sp.Symbol, sp.Rational]) -> AlgebraicPoint:
    """The point with the given rational coordinates."""
    field = NumberField(flint.fmpq_poly([0, 1]), sp.Integer(0))
    return AlgebraicPoint(
        field, {s: flint.fmpq_poly([flint.fmpq(int(v.p), int(v.q))]) for s, v in values.items()}
    )


def real_points(equations: Sequence[sp.Expr], unknowns: Sequence[sp.Symbol]) -> list[AlgebraicPoint] | None:
    """Every real solution of rational equations off their poles, or `None` when they are no task for exact algebra.

    Raises `InfinitelyManyPoints` when the solutions over the complex numbers are not isolated.

    >>> x, y = sp.symbols("x y")
    >>> [point.expressions() for point in real_points([x**2 - 2*y, y - 1], [x, y])]
    [{x: -sqrt(2), y: 1}, {x: sqrt(2), y: 1}]
    """
    if not all(e.is_rational_function(*unknowns) and not e.free_symbols - set(unknowns) for e in equations):
        return None
    numerators, poles = [], sp.Integer(1)
    for equation in equations:
        above, below = sp.fraction(sp.cancel(equation))
        if above == 0:
            continue
        numerators.append(above)
        poles *= sp.Mul(*[factor for factor, _ in sp.factor_list(below)[1]])
    try:
        polynomials = [sp.Poly(n, *unknowns, domain="QQ") for n in numerators]
    except PolynomialError:
        return None
    if any(p.is_ground for p in polynomials):
        return []
    bezout = sp.prod([p.total_degree() for p in polynomials])
    # A system whose Bezout number is larger is left to numerical methods.
    if bezout > 200:
        return None
    symbols = tuple(unknowns)
    found = _points(numerators, symbols, symbols)
    if not isinstance(found, list) and poles.free_symbols:
        # With the poles left out of the ideal fewer solutions are left, and isolated ones.
        inverse = sp.Dummy("inverse")
        found = _points([*numerators, 1 - inverse * poles], (inverse, *symbols), symbols)
    if found is _Unsolved.INFINITE:
        raise InfinitelyManyPoints(
            f"the equations {', '.join(f'{e} = 0' for e in equations)} have solutions that are not isolated "
            f"in {', '.join(map(str, symbols))}."
        )
    if found is _Unsolved.LONG:
        return None
    regular = [point for point in found if not point.value(poles).is_zero()]
    return sorted(regular, key=lambda point: tuple(point.numbers().values()))


class _Unsolved(Enum):
    """Why the points of an ideal were not found: they are not isolated, or finding them takes too long."""

    INFINITE = 0
    LONG = 1


def _points(
    equations: Sequence[sp.Expr], unknowns: Sequence[sp.Symbol], symbols: Sequence[sp.Symbol]
) -> list[AlgebraicPoint] | _Unsolved:
    """The real zeros of polynomials in `unknowns`, their coordinates `symbols`."""
    context = flint.fmpz_mpoly_ctx.get([f"x{i}" for i in range(len(unknowns))], flint.Ordering.degrevlex)
    polynomials = []
    for equation in equations:
        _, cleared = sp.Poly(equation, *unknowns, domain="QQ").clear_denoms(convert=True)
        polynomials.append(context.from_dict({m: int(c) for m, c in cleared.terms()}))
    algebra = _QuotientAlgebra.of(polynomials)
    if not isinstance(algebra, _QuotientAlgebra):
        return algebra
    if not algebra.monomials:
        return []
    minimal = [flint.fmpq_poly(matrix.minpoly()) for matrix in algebra.by]
    squarefree = [p // p.gcd(p.derivative()) for p in minimal]
    if squarefree != minimal:
        for v, p in zip(context.gens(), squarefree):
            polynomials.append(sum((c * v**k for k, c in enumerate(p.numer())), context.constant(0)))
        algebra = _QuotientAlgebra.of(polynomials)
        if not isinstance(algebra, _QuotientAlgebra):
            return algebra
    own = [list(unknowns).index(s) for s in symbols]
    for weights in _forms(len(symbols)):
        form = sum((w * algebra.by[i] for w, i in zip(weights, own) if w), 0 * algebra.by[0])
        graph = algebra.graph(form, own)
        if graph is not None:
            return [
                AlgebraicPoint(field, {s: field.reduce(p) for s, p in zip(symbols, graph)})
                for field in _fields(form.charpoly())
            ]
    return _Unsolved.LONG


@dataclass(frozen=True)
class _QuotientAlgebra:
    """QQ[x]/I for an ideal with isolated zeros: its `monomials`, exponents that no leading one of a Groebner basis
    divides, and the matrices `by[i]` of multiplication by generator i in them."""

    monomials: list[tuple[int, ...]]
    by: list[flint.fmpq_mat]

    @classmethod
    def of(cls, polynomials: Sequence[flint.fmpz_mpoly]) -> _QuotientAlgebra | _Unsolved:
        """That of the ideal of the polynomials."""
        context = polynomials[0].context()
        basis, is_whole = flint.fmpz_mpoly_vec(polynomials, context).buchberger_naive(limits=BASIS_LIMITS)
        if not is_whole:
            return _Unsolved.LONG
        rows = [p.to_dict() for p in basis.autoreduction(groebner=True)]  # pyright: ignore[reportAttributeAccessIssue]
        leading = {max(row, key=_order): row for row in rows}
        n = context.nvars()
        if any(not any(sum(m) == m[i] for m in leading) for i in range(n)):
            return _Unsolved.INFINITE
        monomials = _standard(leading, n)
        if len(monomials) > SOLUTION_LIMIT:
            return _Unsolved.LONG
        place = {m: k for k, m in enumerate(monomials)}
        size = len(monomials)
        known = {m: [flint.fmpq(int(k == place[m])) for k in range(size)] for m in monomials}
        border = {_times(m, i) for m in monomials for i in range(n)} - set(monomials)
        # Faugere, Gianni, Lazard and Mora (1993): in the order of the basis what a monomial reduces to is known.
        for m in sorted(border, key=_order):
            if m in leading:
                row, top = leading[m], flint.fmpq(leading[m][m])
                known[m] = [-flint.fmpq(row.get(b, 0)) / top for b in monomials]
                continue
            i, below = next((i, b) for i in range(n) if (b := _times(m, i, -1)) in border)
            known[m] = [flint.fmpq(0)] * size
            for c, b in zip(known[below], monomials):
                if c != 0:
                    known[m] = [old + c * new for old, new in zip(known[m], known[_times(b, i)])]
        return cls(
            monomials,
            [
                flint.fmpq_mat(size, size, [known[_times(m, i)][k] for k in range(size) for m in monomials])
                for i in range(n)
            ],
        )

    def graph(self, form: flint.fmpq_mat, own: Sequence[int]) -> list[flint.fmpq_poly] | None:
        """The generators `own` as polynomials in that by which `form` multiplies; None when it does not separate the
        points."""
        size = len(self.monomials)
        one = flint.fmpq_mat(size, 1, [int(not any(m)) for m in self.monomials])
        powers = [one]
        for _ in range(size - 1):
            powers.append(form * powers[-1])
        matrix = flint.fmpq_mat(size, size, [power[k, 0] for k in range(size) for power in powers])
        if matrix.rank() < size:
            return None
        solved = [matrix.solve(self.by[i] * one) for i in own]
        return [flint.fmpq_poly([column[k, 0] for k in range(size)]) for column in solved]


def _order(exponents: Sequence[int]) -> tuple:
    return sum(exponents), tuple(-e for e in reversed(exponents))


def _times(exponents: tuple[int, ...], i: int, power: int = 1) -> tuple[int, ...]:
    return tuple(e + power * (k == i) for k, e in enumerate(exponents))


def _standard(leading: Iterable[tuple[int, ...]], n: int) -> list[tuple[int, ...]]:
    """Monomials that are divisible by none of the leading ones, one more than `SOLUTION_LIMIT` at most."""
    found, level = [], {(0,) * n}
    while level and len(found) <= SOLUTION_LIMIT:
        level = {m for m in level if not any(all(a <= b for a, b in zip(lead, m)) for lead in leading)}
        found += sorted(level, key=_order)
        level = {_times(m, i) for m in level for i in range(n)}
    return found


def _forms(count: int) -> Iterator[list[int]]:
    for k in range(count):
        yield [int(i == k) for i in range(count)]
    # Linear forms u + c s + c^2 a that are tried as separating elements after the coordinates.
    for c in (1, 2, 3, 5, 7):
        yield [c**i for i in range(count)]


def _fields(eliminant: flint.fmpq_poly) -> Iterator[NumberField]:
    """The fields of the real roots."""
    for factor, _ in eliminant.factor()[1]:
        whole = sp.Poly([rational(c) for c in reversed(factor.coeffs())], sp.Dummy("t"), domain="QQ")
        for root in whole.real_roots(radicals=factor.degree() <= 2):
            if root.is_Rational:
                yield NumberField(flint.fmpq_poly([0, 1]) - flint.fmpq(int(root.p), int(root.q)), root)
            else:
                yield NumberField(factor / factor.leading_coefficient(), root)
