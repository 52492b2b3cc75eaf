"""Turning points of the reduced flow in complex time, and the buffer point that they set.

Along the reduced orbit x(t), continued to complex t, the formal slow manifold is singular where an eigenvalue lambda of
g_y vanishes. Near a loss at t_L by a pair +-i omega the slow solution leaves its continuation from the attracting side
by about exp(Re int lambda/epsilon) from the turning point t*, so that no orbit stays longer than to the time t_b with

    Re int_(t*)^(t_b) lambda dt = 0,     that is    int_(t_L)^(t_b) Re lambda dt = Re int_(t_L)^(t*) lambda dt,      (1)

the buffer point (Shishkova 1973; Neishtadt, Differential Equations 23 (1987) 1385-1391 and 24 (1988) 171-176; Baer,
Erneux and Rinzel, SIAM J. Appl. Math. 49 (1989) 55-71). The field must be analytic.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.decaying import chebyshev
from gsp.errors import UnsupportedFunctionError
from gsp.functions import parts
from gsp.passage.slow_orbit import SlowOrbit

# Newton's method in complex time starts at these multiples of what the eigenvalue's slope predicts.
RADII, ANGLES = (0.5, 1.0, 2.0), (0.0, 0.6, -0.6)
NEWTON_STEPS = 30
# Turning points nearer than this are one, and an eigenvalue this small there has vanished, in relative terms.
SAME, VANISHED = 1e-7, 1e-6
# Panels along the path to a turning point, with 17 nodes each.
PANELS = 6

_NUMPY = {
    "exp": np.exp, "log": np.log, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos, "tan": np.tan, "sinh": np.sinh,
    "cosh": np.cosh, "tanh": np.tanh, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan,
    "asinh": np.arcsinh, "acosh": np.arccosh, "atanh": np.arctanh,
}  # fmt: skip


@dataclass(frozen=True)
class TurningPoint:
    """A complex time `t` (from the start) where an eigenvalue vanishes, and `level`, the right side of (1)."""

    t: complex
    level: float


class ComplexFunction:
    """Expressions as functions of complex values of `symbols`, evaluated node by node."""

    def __init__(self, outputs: Sequence[sp.Expr], symbols: Sequence[sp.Symbol], values: dict) -> None:
        self.outputs = [sp.sympify(e, strict=True).xreplace(values) for e in outputs]
        self.symbols = tuple(symbols)
        for e in self.outputs:
            self._check(e)

    def _check(self, e: sp.Expr) -> None:
        for piece in sp.preorder_traversal(e):
            if piece.is_Symbol or piece.is_Add or piece.is_Mul or piece.is_number or piece.is_Pow:
                continue
            if parts(piece)[0] not in _NUMPY:
                raise UnsupportedFunctionError(
                    f"{piece} cannot be continued to complex time. The functions that can are {', '.join(_NUMPY)}. "
                    "A passage with a pair of complex eigenvalues needs an analytic field."
                )

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Values (k,) at one complex point (n,)."""
        known: dict[sp.Expr, complex] = dict(zip(self.symbols, z))

        def value(e: sp.Expr) -> complex:
            if e not in known:
                known[e] = fresh(e)
            return known[e]

        def fresh(e: sp.Expr) -> complex:
            if e.is_number:
                return complex(e)
            if e.is_Add:
                return sum((value(a) for a in e.args), 0j)
            if e.is_Mul:
                product = 1 + 0j
                for a in e.args:
                    product *= value(a)
                return product
            if isinstance(e, sp.exp):
                return np.exp(value(e.args[0]))
            if e.is_Pow:
                exponent = int(e.exp) if e.exp.is_Integer else value(e.exp)
                return value(e.base) ** exponent
            return _NUMPY[parts(e)[0]](value(e.args[0]))

        return np.array([value(e) for e in self.outputs], dtype=complex)


class ComplexOrbit:
    """The reduced orbit in complex time from the point z (n,) at the real time `origin`."""

    def __init__(self, orbit: SlowOrbit, origin: float) -> None:
        self.origin = origin
        self.z = orbit.at(origin).astype(complex)
        system, equations = orbit.branch.system, orbit.equations
        self.m, self.n = len(system.x), len(system.y)
        values = dict(system.parameters)
        self._field = ComplexFunction([*equations.f, *equations.E_x, *equations.E_y], system.states, values)
        self._g_y = ComplexFunction(equations.g_y, system.states, values)

    def rate(self, z: np.ndarray) -> np.ndarray:
        """(x', y')."""
        m, n = self.m, self.n
        out = self._field(z)
        f, E_x, E_y = out[:m], out[m : m + n * m].reshape(n, m), out[m + n * m :].reshape(n, n)
        return np.concatenate([f, -np.linalg.solve(E_y, E_x @ f)])

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """g_y."""
        return self._g_y(z).reshape(self.n, self.n)

    def carry(self, z: np.ndarray, step: complex) -> np.ndarray:
        """The orbit a complex time `step` later, along a straight line."""
        from scipy.integrate import solve_ivp

        if step == 0:
            return z
        run = solve_ivp(
            lambda s, w: step * self.rate(w), (0.0, 1.0), z, method="DOP853", rtol=1e-13, atol=1e-15
        )
        if not run.success or not np.isfinite(run.y).all():
            raise np.linalg.LinAlgError("the orbit is singular on the way")
        return run.y[:, -1]

    def zero(self, guess: complex) -> complex | None:
        """The complex time next to `guess` where det g_y vanishes, by Newton's method; None when it fails."""
        t, z = complex(self.origin), self.z
        ahead = guess
        reach = 4.0 * abs(guess - self.origin)
        for _ in range(NEWTON_STEPS):
            z, t = self.carry(z, ahead - t), ahead
            rate = self.rate(z)
            delta = 1e-5 / (1e-300 + float(np.abs(rate).max())) * (1.0 + float(np.abs(z).max()))
            value = np.linalg.det(self.jacobian(z))
            # The determinant along the tangent: its difference has an error of delta^2, Newton's rate survives.
            slope = (
                np.linalg.det(self.jacobian(z + delta * rate)) - np.linalg.det(self.jacobian(z - delta * rate))
            ) / (2.0 * delta)
            if slope == 0 or not np.isfinite(slope):
                return None
            step = -value / slope
            if abs(step) > 0.5 * abs(guess - self.origin):
                step *= 0.5 * abs(guess - self.origin) / abs(step)
            ahead = t + step
            if abs(ahead - self.origin) > reach:
                return None
            if abs(step) <= 1e-13 * (1.0 + abs(t)):
                return ahead
        return None

    def level(self, end: complex, eigenvalue: complex) -> tuple[float, complex]:
        """Re int lambda dt from the origin to `end` along a straight line, and lambda there; lambda is continued."""
        nodes, _, S = chebyshev()
        total, z, tracked = 0j, self.z, eigenvalue
        step = (end - self.origin) / PANELS
        for _ in range(PANELS):
            values = [tracked]
            for a, b in itertools.pairwise(nodes):
                z = self.carry(z, 0.5 * step * (b - a))
                spectrum = np.linalg.eigvals(self.jacobian(z))
                tracked = complex(spectrum[np.argmin(np.abs(spectrum - tracked))])
                values.append(tracked)
            total += 0.5 * step * (S @ np.array(values))[-1]
        return float(total.real), tracked


def turning_points(orbit: SlowOrbit, loss: float, eigenvalue: complex) -> list[TurningPoint]:
    """Turning points next to a loss at time `loss` by the pair of `eigenvalue` = i omega; those that bound the delay.

    Found by Newton's method from nine starts around t_L - i omega/lambda'(t_L), so that one may be missed.
    """
    continued = ComplexOrbit(orbit, loss)
    rate = continued.rate(continued.z)
    delta = 1e-5 / (1e-300 + float(np.abs(rate).max())) * (1.0 + float(np.abs(continued.z).max()))

    def nearest(z: np.ndarray) -> complex:
        spectrum = np.linalg.eigvals(continued.jacobian(z))
        return complex(spectrum[np.argmin(np.abs(spectrum - eigenvalue))])

    slope = (nearest(continued.z + delta * rate) - nearest(continued.z - delta * rate)) / (2.0 * delta)
    if slope == 0:
        return []
    first = -1j * eigenvalue.imag / slope
    found: list[TurningPoint] = []
    for radius in RADII:
        for angle in ANGLES:
            try:
                t = continued.zero(loss + radius * np.exp(1j * angle) * first)
                if t is None or any(
                    min(abs(t - p.t), abs(t - p.t.conjugate())) <= SAME * (1.0 + abs(t)) for p in found
                ):
                    continue
                for candidate in (t, t.conjugate()):
                    level, last = continued.level(candidate, 1j * eigenvalue.imag)
                    if abs(last) <= VANISHED * abs(eigenvalue) and level > 0.0:
                        found.append(TurningPoint(candidate, level))
                        break
            except (np.linalg.LinAlgError, FloatingPointError, ZeroDivisionError, OverflowError):
                continue
    return sorted(found, key=lambda point: point.level)
