"""The field of a planar slow-fast system, x' = f, epsilon y' = g + epsilon h, with its derivatives: over balls to
prove, over doubles to search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.laurent import pole_order
from gsp.lowering.compiled_function import compile_function
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.equations import without_decimals
from gsp.systems.system import SlowFastSystem


class EnclosedField:
    """f, g and h of (x, y, epsilon): the field is x' = f, epsilon y' = g + epsilon h.

    Raises `UnsupportedFunctionError` for a function without an enclosure.
    """

    def __init__(self, arguments: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> None:
        x, y, small = self.arguments = tuple(arguments)
        self.rates = tuple(rates)
        slopes = [sp.diff(e, s) for e in self.rates for s in (x, y)]
        self._values = BallFunction(self.arguments, self.rates)
        self._all = BallFunction(self.arguments, [*self.rates, *slopes])
        self._divergences = self._all.among((0, 3, 6, 8)), self._all.among((1, 2, 3, 6, 8))
        f, g, h = self.rates
        whole = g + small * h
        searched = [f, whole, *(sp.diff(e, s) for e in (f, whole) for s in (x, y)), sp.diff(whole, y, 2), g, h]
        self._doubles = compile_function(searched, arguments=(x, y), epsilon=small)

    @classmethod
    def of(cls, system: SlowFastSystem) -> EnclosedField:
        """That of a planar system, parameters at their values; what of its g has the factor epsilon is in h."""
        (x,), (y,) = system.x, system.y
        return cls((x, y, system.epsilon), exact_rates(system))

    @cached_property
    def bends(self) -> BallFunction:
        """g_xx, g_xy and g_yy."""
        x, y, _ = self.arguments
        return BallFunction(
            self.arguments, [sp.diff(self.rates[1], *pair) for pair in ((x, x), (x, y), (y, y))]
        )

    @property
    def depends_on_epsilon(self) -> bool:
        """Whether the field does."""
        return self.rates[2] != 0 or any(e.has(self.arguments[2]) for e in self.rates)

    def over(self, x: arb, y: arb, epsilon: arb) -> list[arb]:
        """f, g and h."""
        return self._values([x, y, epsilon])

    def with_slopes(self, x: arb, y: arb, epsilon: arb) -> list[arb]:
        """f, g, h, f_x, f_y, g_x, g_y, h_x and h_y."""
        return self._all([x, y, epsilon])

    def divergence(self, axis: int, along: arb, epsilon: arb) -> Callable[[arb], tuple[arb, arb]]:
        """The rate f (`axis` 0) or g + epsilon h (1), and epsilon times the divergence, over a ball of x or y as a
        function of one of the other.
        """
        function = self._divergences[axis].given([None, along, epsilon] if axis else [along, None, epsilon])

        def over(across: arb) -> tuple[arb, arb]:
            *rate, f_x, g_y, h_y = function([across, along, epsilon] if axis else [along, across, epsilon])
            whole = rate[0] + epsilon * rate[1] if axis else rate[0]
            return whole, g_y + epsilon * (h_y + f_x)

        return over

    def nearby(self, points: Sequence | np.ndarray, epsilon: float) -> np.ndarray:
        """f, G = g + epsilon h, f_x, f_y, G_x, G_y, G_yy, g and h at points (k, 2), as rows (9, k); rounded."""
        return self._doubles(points, (epsilon,)).T


def exact_rates(system: SlowFastSystem) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """f, g and h of a planar system, with fractions for decimals and for parameters."""
    small = system.epsilon
    values = {p: without_decimals(v) for p, v in system.parameters.items()}
    # A derivative of a decimal would be rounded by SymPy.
    f, g = (without_decimals(e.xreplace(values)) for e in (*system.f, *system.g))
    kept, others = g.as_independent(small, as_Add=True)
    rest = sp.Add(*(term / small for term in sp.Add.make_args(others)))
    if not pole_order(rest, small):
        return f, kept, rest
    if not g.is_polynomial(small):
        return f, g, sp.S.Zero
    kept, *terms = reversed(sp.Poly(g, small).all_coeffs())
    return f, kept, sp.Add(*(term * small**k for k, term in enumerate(terms)))
