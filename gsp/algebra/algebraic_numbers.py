"""Real points of polynomial systems, exactly: each a rational map of one real algebraic number.

The ideal is made radical by the squarefree parts of its elimination polynomials (Seidenberg's lemma); then a
coordinate, or a linear form, separates the points and every coordinate is a polynomial in it (the shape lemma;
Cox, Little and O'Shea, "Using algebraic geometry", chapter 2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import flint
import sympy as sp
from sympy.polys.orderings import grevlex
from sympy.polys.polyerrors import PolynomialError

from gsp.algebra.polynomials import rational
from gsp.algebra.precision import precision
from gsp.errors import GspError

# So is one with more complex solutions, counted with multiplicity; past this, elimination takes minutes.
SOLUTION_LIMIT = 16
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
        """An enclosure of the real number `a`, with about `bits` correct bits in theta."""
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
        a = self.reduce(a)
        if a.is_zero():
            return 0
        bits = 64
        while True:
            with precision(bits):
                value = self.ball(a, bits)
                if value > 0:
                    return 1
                if value < 0:
                    return -1
            bits *= 2

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
        with precision(BITS):
            return {symbol: float(self.field.ball(value, BITS).mid()) for symbol, value in self.values.items()}

    def near(self, bits: int) -> dict[sp.Symbol, sp.Rational]:
        """The coordinates as fractions, to about `bits` bits."""
        found = {}
        with precision(bits):
            for symbol, value in self.values.items():
                mantissa, power = self.field.ball(value, bits).mid().man_exp()
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
    symbols = list(unknowns)
    extra: list[sp.Symbol] = []
    if poles.free_symbols:
        inverse = sp.Dummy("inverse")
        numerators.append(1 - inverse * poles)
        extra = [inverse]
    basis = sp.groebner(numerators, *extra, *symbols, order="grevlex", domain="QQ")
    if basis.exprs == [1]:
        return []
    if not basis.is_zero_dimensional:
        raise InfinitelyManyPoints(
            f"the equations {', '.join(f'{e} = 0' for e in equations)} have solutions that are not isolated "
            f"in {', '.join(map(str, symbols))}."
        )
    if _too_many_solutions([polynomial.LM(order=grevlex).exponents for polynomial in basis.polys]):
        return None
    eliminants = [_eliminant(basis.exprs, [*extra, *symbols], s) for s in symbols]
    squarefree = [sp.Mul(*[factor for factor, _ in sp.factor_list(p)[1]]) for p in eliminants]
    radical = [*basis.exprs, *squarefree]
    for form in _forms(symbols):
        found = _shape(radical, [*extra, *symbols], symbols, form)
        if found is not None:
            return sorted(found, key=lambda point: tuple(point.numbers().values()))
    return None


def _too_many_solutions(leading: Sequence[tuple[int, ...]]) -> bool:
    """Whether more than `SOLUTION_LIMIT` monomials are divisible by none of the leading ones of a Groebner basis."""
    size = len(leading[0])
    level = {(0,) * size}
    count = 0
    while level and count <= SOLUTION_LIMIT:
        level = {m for m in level if not any(all(a <= b for a, b in zip(lead, m)) for lead in leading)}
        count += len(level)
        level = {tuple(e + (i == j) for j, e in enumerate(m)) for m in level for i in range(size)}
    return count > SOLUTION_LIMIT


def _forms(symbols: Sequence[sp.Symbol]) -> Iterator[sp.Expr]:
    yield from symbols
    # Linear forms u + c s + c^2 a that are tried as separating elements after the coordinates.
    for c in (1, 2, 3, 5, 7):
        yield sp.Add(*[(c**i) * s for i, s in enumerate(symbols)])


def _eliminant(exprs: Sequence[sp.Expr], symbols: Sequence[sp.Symbol], last: sp.Symbol) -> sp.Expr:
    order = [s for s in symbols if s != last] + [last]
    basis = sp.groebner(list(exprs), *order, order="grevlex", domain="QQ").fglm("lex")
    return basis.exprs[-1]


def _shape(
    radical: Sequence[sp.Expr], everything: Sequence[sp.Symbol], symbols: Sequence[sp.Symbol], form: sp.Expr
) -> list[AlgebraicPoint] | None:
    """The points as polynomials in the value t of `form`; None when it does not separate them."""
    t = sp.Dummy("t")
    basis = sp.groebner([*radical, t - form], *everything, t, order="grevlex", domain="QQ").fglm("lex")
    eliminant = basis.exprs[-1]
    if eliminant.free_symbols != {t}:
        return None
    graph: dict[sp.Symbol, sp.Poly] = {}
    for expression in basis.exprs[:-1]:
        for symbol in symbols:
            if expression.has(symbol) and expression.free_symbols <= {symbol, t}:
                polynomial = sp.Poly(expression, symbol)
                if polynomial.degree() == 1 and polynomial.LC().is_Rational:
                    graph[symbol] = sp.Poly(-polynomial.coeff_monomial(1) / polynomial.LC(), t, domain="QQ")
    if set(graph) != set(symbols):
        return None
    points = []
    for factor, _ in sp.factor_list(sp.Poly(eliminant, t, domain="QQ"))[1]:
        for root in sp.Poly(factor.as_expr(), t, domain="QQ").real_roots(radicals=factor.degree() <= 2):
            field = NumberField(_fmpq_poly(factor.monic()), root)
            if root.is_Rational:
                field = NumberField(flint.fmpq_poly([0, 1]) - flint.fmpq(int(root.p), int(root.q)), root)
            points.append(AlgebraicPoint(field, {s: field.reduce(_fmpq_poly(p)) for s, p in graph.items()}))
    return [AlgebraicPoint(p.field, {s: p.values[s] for s in symbols}) for p in points]


def _fmpq_poly(polynomial: sp.Poly) -> flint.fmpq_poly:
    coefficients = [sp.Rational(c) for c in reversed(polynomial.all_coeffs())]
    return flint.fmpq_poly([flint.fmpq(int(c.p), int(c.q)) for c in coefficients])
