"""The desingularised reduced flow: slow motion on a critical manifold with folds, in a time that stands still on them.

With one fast variable y and slow x, epsilon y' = g(x, y, epsilon), x' = f(x, y, epsilon), the reduced flow on
{g = 0} is singular at folds g_y = 0. In the time that -g_y scales it becomes the desingularised reduced flow

    x' = -g_y f,    y' = g_x . f,                                                                          (1)

(Szmolyan and Wechselberger, J. Differential Equations 177 (2001) 419-453), reversed in time where g_y > 0. Its
equilibria with g = g_y = 0, q = g_x . f = 0 are the folded singularities. There (1) has the eigenvalue 0 as often as
there are slow variables less one (g is conserved, and the singularities form a manifold when there are more than two
slow variables), and two more, with

    T = trace = g_x . f_y,    D = g_yy (f . q_x) - (f . g_xy) q_y,    lambda^2 - T lambda + D = 0.            (2)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent, vanishes
from gsp.errors import GspError
from gsp.systems.arguments import check_noun
from gsp.systems.system import SlowFastSystem


class FoldedError(GspError):
    """Folded singularities that cannot be told, because there is no fold or they are not isolated."""


@dataclass(frozen=True, eq=False)
class Desingularised:
    """The desingularised reduced flow (1) of a system with one fast variable, parameters put in, at epsilon = 0.

    `rates` maps every state to its rate; {g = 0} is invariant. `fold` is g_y, and `q` = g_x . f.
    """

    g: sp.Expr
    f: tuple[sp.Expr, ...]
    x: tuple[sp.Symbol, ...]
    y: sp.Symbol
    rates: Mapping[sp.Symbol, sp.Expr]
    fold: sp.Expr
    q: sp.Expr

    @property
    def trace(self) -> sp.Expr:
        """T of (2)."""
        return sp.Add(*[derivative(self.g, s) * derivative(rate, self.y) for s, rate in zip(self.x, self.f)])

    @property
    def determinant(self) -> sp.Expr:
        """D of (2)."""
        along = sp.Add(*[rate * derivative(self.q, s) for s, rate in zip(self.x, self.f)])
        turning = sp.Add(*[rate * derivative(derivative(self.g, s), self.y) for s, rate in zip(self.x, self.f)])
        return derivative(derivative(self.g, self.y), self.y) * along - turning * derivative(self.q, self.y)


def desingularise(system: SlowFastSystem) -> Desingularised:
    """The desingularised reduced flow of a system with one fast variable.

    Raises `FoldedError` for another number of fast variables, and when the critical manifold has no folds.

    >>> x, z, y, eps = sp.symbols("x z y epsilon")
    >>> desingularise(SlowFastSystem(slow={x: z, z: 1}, fast={y: x - y**2}, epsilon=eps)).rates[x]
    2*y*z
    """
    check_noun(system, SlowFastSystem, verb="folded_singularities")
    if len(system.y) != 1:
        raise FoldedError(
            "folded singularities are computed for one fast variable.",
            "Reduce the fast variables to the centre manifold of the fold first.",
            got=len(system.y),
        )
    zero = sp.Integer(0)
    put_in = dict(system.parameters)
    g = laurent(system.g[0], system.epsilon, order=0).get(0, zero).xreplace(put_in)
    f = tuple(laurent(rate, system.epsilon, order=0).get(0, zero).xreplace(put_in) for rate in system.f)
    y = system.y[0]
    fold = derivative(g, y)
    if vanishes(fold):
        raise FoldedError(f"there is no fold: the fast rate does not depend on {y}.", got=f"g = {g}", value=g)
    q = sp.Add(*[derivative(g, s) * rate for s, rate in zip(system.x, f)])
    rates = {**{s: sp.expand_mul(-fold * rate) for s, rate in zip(system.x, f)}, y: q}
    return Desingularised(g, f, system.x, y, MappingProxyType(rates), fold, q)
