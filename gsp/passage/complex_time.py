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
import operator
from collections.abc import Callable, Sequence
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
    """Expressions as functions of complex values of `symbols`: each different node once, in the order of need."""

    def __init__(self, outputs: Sequence[sp.Expr], symbols: Sequence[sp.Symbol], values: dict) -> None:
        self._places: dict[sp.Expr, int] = {symbol: i for i, symbol in enumerate(symbols)}
        self._nodes: list[tuple[Callable[..., complex], tuple[int, ...]]] = []
        self._inputs = len(self._places)
        self._outputs = [self._place(sp.sympify(e, strict=True).xreplace(values)) for e in outputs]

    def _place(self, e: sp.Expr) -> int:
        if e not in self._places:
            node = self._node(e)
            self._places[e] = self._inputs + len(self._nodes)
            self._nodes.append(node)
        return self._places[e]

    def _node(self, e: sp.Expr) -> tuple[Callable[..., complex], tuple[int, ...]]:
        if e.is_number:
            number = complex(e)
            return (lambda: number), ()
        if e.is_Add or e.is_Mul:
            return (_sum if e.is_Add else _product), tuple(self._place(a) for a in e.args)
        if e.is_Pow and e.exp.is_Integer:
            exponent = int(e.exp)
            return (lambda base: base**exponent), (self._place(e.base),)
        if e.is_Pow and not isinstance(e, sp.exp):
            return operator.pow, (self._place(e.base), self._place(e.exp))
        name, operands = parts(e)
        if name not in _NUMPY:
            raise UnsupportedFunctionError(
                f"{e} cannot be continued to complex time. The functions that can are {', '.join(_NUMPY)}. "
                "A passage with a pair of complex eigenvalues needs an analytic field."
            )
        return _NUMPY[name], (self._place(operands[0]),)

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Values (k,) at one complex point (n,)."""
        known = [complex(value) for value in z]
        for function, places in self._nodes:
            known.append(function(*[known[i] for i in places]))
        return np.array([known[i] for i in self._outputs], dtype=complex)


def _sum(*values: complex) -> complex:
    return sum(values, 0j)


def _product(*values: complex) -> complex:
    result = 1 + 0j
    for value in values:
        result *= value
    return result


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
