"""The flow on a solved slow manifold: x' = f(x, h(x), epsilon) with h the Chebyshev interpolant, compiled.

The interpolant becomes a polynomial in machine code. Its basis is built by T_2k = 2 T_k^2 - 1 and T_2k+1 =
2 T_k T_k+1 - T_1, which loses a factor k^2 of rounding; Clenshaw's recurrence loses less, but it is nested so deep
that SymPy multiplies it out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.integration.restriction import real_or_nan
from gsp.slow.chebyshev import ChebyshevSurface
from gsp.slow.sampled_manifold import SampledManifold
from gsp.systems.declaration import exact
from gsp.systems.flow import Flow, Values

# Beyond so many coefficients compiling takes seconds.
LARGEST_SIZE = 400


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceFlow(Flow):
    """The slow flow on `manifold`, at its epsilon, which is put in; an ordinary, non-stiff `Flow`.

    Its states are the slow variables, then those of a reconstruction. It means nothing outside the manifold's region,
    where the polynomial goes on.
    """

    manifold: SampledManifold
    states: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]
    observables: Values
    epsilon: None = None
    parameters: Values = field(default_factory=dict)
    is_stiff: bool = False

    def __repr__(self) -> str:
        return f"SurfaceFlow({self.manifold!r})"


def flow_on(
    manifold: SampledManifold,
    *,
    shift: Sequence[float] | np.ndarray | None = None,
    reconstruction: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> SurfaceFlow:
    """The slow flow on a solved manifold; `shift` (n_fast,) moves the fast variables, to see what that does.

    Raises `DeclarationError` for a manifold that was not solved, or whose interpolant has over 400 coefficients.

    >>> from gsp.integration.surface_flow import flow_on
    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x}, epsilon=eps)
    >>> manifold = solve_manifold(solve_critical(system).branches[0], region={"y": (0, 1)}, epsilon=0.1)
    >>> integrate(flow_on(manifold), start={"y": 1}, span=(0, 1)).at(1.0).round(8)
    array([0.32399842])
    """
    surface = manifold.surface
    if surface is None:
        raise DeclarationError(
            "the manifold has no surface to run on.",
            "Solve it on a region where it holds.",
            got=manifold.message,
        )
    size = int(np.prod(surface.coefficients.shape))
    if size > LARGEST_SIZE:
        raise DeclarationError(
            f"the interpolant has {size} coefficients, more than {LARGEST_SIZE}.",
            "Loosen the tolerance of solve_manifold, or shrink its region.",
            limit=LARGEST_SIZE,
        )
    system = manifold.branch.system
    values = {**system.parameters, system.epsilon: exact(manifold.epsilon)}
    offs = [0.0] * len(system.y) if shift is None else shift
    heights = {
        y: height + sp.Float(off) if off else height
        for y, height, off in zip(system.y, _expressions(surface, system.x), offs)
    }
    observables = dict(heights)
    for symbol, expression in system.observables.items():
        observables[symbol] = expression.xreplace(values).xreplace(heights)
    driven = dict(reconstruction or {})
    rates = [rate.xreplace(values).xreplace(heights) for rate in system.f]
    rates += [sp.sympify(rate, strict=True).xreplace(values).xreplace(observables) for rate in driven.values()]
    return SurfaceFlow(manifold, (*system.x, *driven), tuple(rates), real_or_nan(observables))


def _expressions(surface: ChebyshevSurface, x: tuple[sp.Symbol, ...]) -> list[sp.Expr]:
    bases = [
        _basis(symbol, low, high, n)
        for symbol, (low, high), n in zip(x, surface.box, surface.coefficients.shape)
    ]
    return [_sum(surface.coefficients[..., k], bases) for k in range(surface.coefficients.shape[-1])]


def _sum(coefficients: np.ndarray, bases: list[list[sp.Expr]]) -> sp.Expr:
    if not bases:
        return sp.Float(float(coefficients))
    return sp.Add(*[T * _sum(row, bases[1:]) for T, row in zip(bases[0], coefficients)])


def _basis(x: sp.Symbol, low: float, high: float, size: int) -> list[sp.Expr]:
    """T_0, ..., T_(size - 1) of the box's own coordinate."""
    unit = sp.Float(2.0 / (high - low)) * x - sp.Float((high + low) / (high - low))
    T: list[sp.Expr] = [sp.Integer(1), unit]
    for k in range(2, size):
        half = k // 2
        T.append(2 * T[half] ** 2 - 1 if k % 2 == 0 else 2 * T[half] * T[half + 1] - unit)
    return T[:size]
