"""The formal canard: a slow manifold that passes smoothly through a fold, and the parameter that lets it.

Near a fold of epsilon y' = g(x, y, a, epsilon), x' = f(x, y, a, epsilon) the slow manifold is written over the FAST
variable, x = X(y, epsilon). Its invariance reads

    epsilon f(X, y, a, epsilon) = X_y(y, epsilon) g(X, y, a, epsilon).                                        (1)

With g = epsilon G_1 + epsilon^2 G_2 + ... on the manifold, order k of (1) is

    X_0' G_k = F_(k-1) - sum_(i=1..k-1) X_i' G_(k-i),   g_x X_k = G_k - (terms known before, and g_a a_k).    (2)

X_0' vanishes at the fold, so the right side of (2) must vanish there too: that fixes a_(k-1). The formal series so
found is the common asymptotic expansion of all maximal canards (Zvonkin and Shubin, Russian Math. Surveys 39 (1984)
69-131; Krupa and Szmolyan, SIAM J. Math. Anal. 33 (2001) 286-314). In Taylor series about the fold, each order costs
two powers of y.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.power_series import SeriesProgram
from gsp.algebra.taylor_ring import Rationals, Scalar, Taylor, TaylorRing


@dataclass(frozen=True, eq=False)
class PlanarField:
    """f and g of a planar system in the symbols `x` (slow), `y` (fast), `a` and `epsilon`, all else put in."""

    f: sp.Expr
    g: sp.Expr
    x: sp.Symbol
    y: sp.Symbol
    a: sp.Symbol
    epsilon: sp.Symbol

    @property
    def symbols(self) -> tuple[sp.Symbol, sp.Symbol, sp.Symbol]:
        """(x, y, a)."""
        return self.x, self.y, self.a


def program_of(ring: TaylorRing, epsilon: sp.Symbol, inputs: dict[sp.Symbol, list[Taylor]]) -> SeriesProgram:
    """A `SeriesProgram` whose coefficients are Taylor series."""
    return SeriesProgram(cast(Any, ring), epsilon=epsilon, inputs=cast(Any, inputs), constants={})


@dataclass(frozen=True, eq=False)
class FormalCanard:
    """The coefficients a_0..a_n, and X_0..X_n as Taylor series about the fold, as scalars of one kind."""

    parameter: list[Scalar]
    manifold: list[Taylor]


def formal_canard(
    field: PlanarField, scalars: Rationals, point: dict[sp.Symbol, Scalar], *, order: int
) -> FormalCanard:
    """The solution of (2) through a_`order` at the canard point, with a few further Taylor coefficients."""
    ring = TaylorRing(scalars, 2 * order + 4)
    x, y, a = field.symbols
    X = [ring.scalar(point[x])]
    A = [ring.scalar(point[a])]
    inputs = {x: X, y: [ring.scalar(point[y], slope=1)], a: A}
    program = program_of(ring, field.epsilon, inputs)
    at_zero = program_of(ring, field.epsilon, inputs)
    f, g = program.compile(field.f), program.compile(field.g)
    rates = {
        name: at_zero.compile(derivative(rate, symbol))
        for name, rate, symbol in (
            ("g_x", field.g, x),
            ("g_a", field.g, a),
            ("f_x", field.f, x),
            ("f_a", field.f, a),
        )
    }
    _solve_critical(X, program, at_zero, g, rates["g_x"])
    first = {name: cast(Taylor, cast(Any, node.coefficients[0])) for name, node in rates.items()}
    slope = X[0].derivative()
    over_slope = slope.over_t().inverse()
    over_g_x = first["g_x"].inverse()
    Q = -(first["g_a"] * over_g_x)

    program.extend(0)
    G = [ring.zero, _coefficient(f, 0).over_t() * over_slope]
    # How the right side of (2) answers to a_(k-1): the same at every order.
    response = first["f_a"] + first["f_x"] * Q - Q.derivative() * G[1]
    over_response = scalars.inverse(response[0])
    slopes = [slope]
    for k in range(2, order + 2):
        inputs[y].append(ring.zero)
        X.append(ring.zero)
        A.append(ring.zero)
        program.extend(k - 1)
        X[k - 1] = (G[k - 1] - _coefficient(g, k - 1)) * over_g_x
        program.extend(k - 1)
        slopes.append(X[k - 1].derivative())
        right = _coefficient(f, k - 1)
        for i in range(1, k):
            right = right - slopes[i] * G[k - i]
        value = -scalars.product(right[0], over_response)
        A[k - 1] = ring.scalar(value)
        X[k - 1] = X[k - 1] + A[k - 1] * Q
        slopes[k - 1] = X[k - 1].derivative()
        program.extend(k - 1)
        G.append((right + A[k - 1] * response).over_t() * over_slope)
    return FormalCanard([series[0] for series in A], X)


def _coefficient(node: Any, k: int) -> Taylor:
    return node.coefficients[k]


def _solve_critical(X: list[Taylor], program: SeriesProgram, at_zero: SeriesProgram, g: Any, g_x: Any) -> None:
    """X_0(y) from g(X_0, y, a_0, 0) = 0 by Newton's method in power series."""
    ring, start = X[0].ring, X[0][0]
    known = 1
    while True:
        program.extend(0)
        at_zero.extend(0)
        if known >= ring.length:
            break
        known *= 2
        X[0] = X[0] - _coefficient(g, 0) * _coefficient(g_x, 0).inverse()
        if not ring.scalars.is_exact:
            # The fold is where it is: what rounding leaves of X_0 - x_0 and X_0' there is no information.
            items = [X[0][i] for i in range(ring.length)]
            items[0], items[1] = start, ring.scalars.number(sp.Integer(0))
            X[0] = Taylor(ring, ring.scalars.polynomial(items), ring.length)


def hopf_series(
    field: PlanarField, scalars: Rationals, point: dict[sp.Symbol, Scalar], *, order: int
) -> list[Scalar]:
    """The parameter at the singular Hopf point: f = g = 0 and trace g_y + epsilon f_x = 0, as a series in epsilon.

    The trace is that of the Jacobian in fast time.
    """
    ring = TaylorRing(scalars, 1)
    x, y, a = field.symbols
    inputs = {symbol: [ring.scalar(point[symbol])] for symbol in (x, y, a)}
    program = program_of(ring, field.epsilon, inputs)
    trace = derivative(field.g, y) + field.epsilon * derivative(field.f, x)
    equations = (field.f, field.g, trace)
    nodes = [program.compile(e) for e in equations]
    slopes = program_of(ring, field.epsilon, inputs)
    matrix = [[slopes.compile(derivative(e, s)) for s in (x, y, a)] for e in equations]
    slopes.extend(0)
    program.extend(0)
    rows = [[_coefficient(node, 0) for node in row] for row in matrix]
    inverse = _inverse_rows(rows)
    for k in range(1, order + 1):
        for symbol in (x, y, a):
            inputs[symbol].append(ring.zero)
        program.extend(k)
        residual = [_coefficient(node, k) for node in nodes]
        for symbol, row in zip((x, y, a), inverse):
            inputs[symbol][k] = -(row[0] * residual[0] + row[1] * residual[1] + row[2] * residual[2])
        program.extend(k)
    return [series[0] for series in inputs[a]]


def _inverse_rows(m: list[list[Taylor]]) -> list[list[Taylor]]:
    """The inverse of a 3 x 3 matrix by its adjugate."""

    def minor(i: int, j: int) -> Taylor:
        r, s = (k for k in range(3) if k != i)
        p, q = (k for k in range(3) if k != j)
        value = m[r][p] * m[s][q] - m[r][q] * m[s][p]
        return -value if (i + j) % 2 else value

    adjugate = [[minor(j, i) for j in range(3)] for i in range(3)]
    determinant = m[0][0] * adjugate[0][0] + m[0][1] * adjugate[1][0] + m[0][2] * adjugate[2][0]
    over = determinant.inverse()
    return [[entry * over for entry in row] for row in adjugate]
