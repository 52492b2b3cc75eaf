"""The field at a nilpotent point in coordinates in which no term is hidden: the form from which weights are read.

With l g_y = 0, g_y r = 0, l . r = 1 the fast variables are v = l . (y - y_0) and u, the others without their part along
r. On the centre manifold u = h(v, x, epsilon, p), p the parameters less their values, in fast time

    v' = G(v, x, epsilon, p),   x' = epsilon F(v, x, epsilon, p),   G(v, 0, 0, 0) = a_p v^p + ...                    (1)

1. v is shifted by the phi(x, p) with d^(p-1) G/dv^(p-1) = 0 there: no v^(p-1) is left (Tschirnhaus).
2. Where the coefficient of v^j, j < p - 1, has a linear part in x that is new, it becomes a slow variable itself.
3. Where the rate of one of those vanishes at the point, its part in the slow variables that are left becomes one too.

So a fold over two slow variables has v' = X + a v^2, whatever the coordinates, and the second variable runs along it.
A double zero with one null vector, v' = w, w' = G, is taken to this form likewise.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gsp.algebra.local_series import LocalRing, LocalSeries
from gsp.errors import GspError


class BlowUpError(GspError):
    """A point that is not blown up: it is not nilpotent, or no weights exist; the message says which."""


class LocalForm:
    """Equation (1), before and after the three steps: `fast` are the rates of the block, `slow` the F of the others.

    `names` are the symbols of the ring's variables: the block, slow variables, parameters, epsilon. Row i of `linear`
    is the linear part of variable i in the given ones, the point as their origin; `block` are those of the block.
    """

    def __init__(
        self,
        ring: LocalRing,
        names: Sequence[sp.Symbol],
        fast: list[LocalSeries],
        slow: list[LocalSeries],
        block: Sequence[sp.Expr] = (),
    ) -> None:
        self.ring, self.names = ring, list(names)
        self.fast, self.slow = fast, slow
        self.linear: list[sp.Expr] = [*block, *names[len(block) :]]

    @property
    def slow_at(self) -> range:
        """The places of the slow variables."""
        return range(len(self.fast), len(self.fast) + len(self.slow))

    @property
    def small(self) -> int:
        """The place of epsilon."""
        return len(self.names) - 1

    def image(self, series: LocalSeries) -> sp.Expr:
        """The linear part of `series` in the given variables."""
        slopes = (self.ring.expression(series.slope(i)) for i in range(len(self.linear)))
        return sp.expand(sp.Add(*(c * own for c, own in zip(slopes, self.linear) if c != 0)))

    def replace(self, i: int, image: LocalSeries) -> None:
        """Put `image` for variable i in all rates."""
        self.fast = [g.with_variable(i, image) for g in self.fast]
        self.slow = [f.with_variable(i, image) for f in self.slow]

    def rate_of(self, series: LocalSeries) -> LocalSeries:
        """The derivative of a series in the slow variables along the flow, in slow time."""
        total = self.ring.zero
        for i, f in zip(self.slow_at, self.slow):
            total = total + series.derivative(i) * f
        return total

    def solved(self, function: LocalSeries, i: int) -> LocalSeries:
        """Variable i where `function`, which has a slope along it, is put in its place."""
        ring = self.ring
        slope, variable, inverse = function.slope(i), ring.variable(i), ring.zero
        first, rest = ring.scalar(ring.inverse(slope)), function - ring.scalar(slope) * variable
        # x = (X - the rest of the function at x)/slope, one more degree at each step.
        for _ in range(ring.degree):
            inverse = first * (variable - rest.with_variable(i, inverse))
        return inverse

    def shift(self, i: int, by: LocalSeries) -> None:
        """v - `by` for the fast variable i, `by` a series in slow variables and parameters."""
        if by.is_zero:
            return
        self.replace(i, self.ring.variable(i) + by)
        self.fast[i] = self.fast[i] - self.ring.variable(self.small) * self.rate_of(by)
        self.linear[i] = self.linear[i] - self.image(by)

    def straighten(self, i: int, function: LocalSeries) -> None:
        """Make `function`, with a slope along the slow variable i, the slow variable i itself."""
        self.linear[i] = self.image(function)
        self.slow[i - len(self.fast)] = self.rate_of(function)
        self.replace(i, self.solved(function, i))


def straightened(form: LocalForm) -> LocalForm:
    """Steps 1 to 3 of the module for a block of one or two zero eigenvalues."""
    if len(form.fast) > 1:
        _companion(form)
    order = fibre_order(form)
    if order is None:
        return form
    form.shift(0, _vertex(form, order))
    own = range(len(form.fast))
    pivots: list[int] = []
    for j in range(order - 1):
        coefficient = _coefficients(form, order)[j]
        pivot = _pivot(form, coefficient, pivots)
        if pivot is not None:
            form.straighten(pivot, coefficient)
            pivots.append(pivot)
    if not pivots and len(form.slow) > 1:
        pivots = _split_squares(form, order)
    for i in list(pivots):
        rate = form.slow[i - len(form.fast)]
        if rate[0].is_zero():
            others = rate.without([*own, *pivots, *range(form.slow_at.stop, len(form.names))])
            pivot = _pivot(form, others, pivots)
            if pivot is not None:
                form.straighten(pivot, others)
                pivots.append(pivot)
    return form


def fibre_order(form: LocalForm) -> int | None:
    """p of (1): the least power of v along the fast fibre; None where there is none up to the ring's degree."""
    own = form.fast[-1].without(range(1, len(form.names)))
    return next((k for k, part in enumerate(own.parts) if not part.is_zero()), None)


def _coefficients(form: LocalForm, order: int) -> list[LocalSeries]:
    """The coefficients of 1, v, ..., v^(p-2) in (1) at epsilon = 0, the other variables of the block being 0."""
    at_rest = form.fast[-1].without([*range(1, len(form.fast)), form.small])
    return at_rest.powers(0)[: order - 1]


def _vertex(form: LocalForm, order: int) -> LocalSeries:
    """phi with d^(p-1) G/dv^(p-1) = 0 at v = phi(x, p), by Newton's method with the slope at the point."""
    test = form.fast[-1].without([*range(1, len(form.fast)), form.small])
    for _ in range(order - 1):
        test = test.derivative(0)
    slope = form.ring.scalar(form.ring.inverse(test.slope(0)))
    phi = form.ring.zero
    # What the derivatives have cut off would be wrong terms of phi.
    for _ in range(form.ring.degree):
        phi = phi - slope * test.with_variable(0, phi)
    return LocalSeries(form.ring, phi.parts[: form.ring.degree + 2 - order])


def _pivot(form: LocalForm, function: LocalSeries, taken: Sequence[int]) -> int | None:
    """The first slow variable that is not taken along which `function` has a slope, the taken ones being 0."""
    return next((i for i in form.slow_at if i not in taken and not function.slope(i).is_zero()), None)


def _split_squares(form: LocalForm, order: int) -> list[int]:
    """Make slow variables of the linear forms that the squares of G(0, x) hold, so that the others are not in them."""
    pivots = []
    for i in form.slow_at:
        squares = _coefficients(form, order)[0][2]
        own = LocalSeries(form.ring, [form.ring.nothing, squares.derivative(i + 1)])
        own = own.without(range(form.slow_at.stop, len(form.names)))
        if not own.slope(i).is_zero():
            form.straighten(i, own)
            pivots.append(i)
    return pivots


def _companion(form: LocalForm) -> None:
    """Make w = G_1(v, w, x, p) at epsilon = 0 the second variable of a block v' = w + ..."""
    function = form.fast[0].without([form.small])
    rate = form.ring.variable(form.small) * form.rate_of(function)
    for i, g in enumerate(form.fast):
        rate = rate + function.derivative(i) * g
    form.linear[1] = form.image(function)
    form.fast[1] = rate
    form.replace(1, form.solved(function, 1))
