"""Turning points of the reduced flow in complex time, and the buffer point that they set.

Along the reduced orbit x(t), continued to complex t, the formal slow manifold is singular where an eigenvalue lambda of
g_y vanishes. Near a loss at t_L by a pair +-i omega the slow solution leaves its continuation from the attracting side
by about exp(Re int lambda/epsilon) from the turning point t*, so that no orbit stays longer than to the time t_b with

    Re int_(t*)^(t_b) lambda dt = 0,     that is    int_(t_L)^(t_b) Re lambda dt = Re int_(t_L)^(t*) lambda dt,      (1)

the buffer point (Shishkova 1973; Neishtadt, Differential Equations 23 (1987) 1385-1391 and 24 (1988) 171-176; Baer,
Erneux and Rinzel, SIAM J. Appl. Math. 49 (1989) 55-71). The field must be analytic. Where <l, g_1 - Dh_0 f> is 0 at
t*, as for epsilon z' = (t + i)(z + epsilon), the first order is not singular there, and t* sets no limit. As a rule
M0 folds over complex x where g_y is singular, and x(t) has a branch point at t*: besides t the orbit is continued in
the time tau with dt = det(E_y) dtau, {E = 0} the branch, in which it passes through folds. Where g is linear in the
fast variables M0 has a pole there: when the slow rates do not contain them, x(t) does not know of it, and x(t) alone
is continued.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative, entries
from gsp.algebra.functions import parts
from gsp.algebra.laurent import laurent
from gsp.errors import UnsupportedFunctionError
from gsp.fibres.decaying_signals import chebyshev
from gsp.singular.passage.fold_passage import ZERO
from gsp.singular.passage.slow_orbit import SlowOrbit

# Turning points nearer than this are one, in relative terms.
SAME = 1e-6
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
                f"{e} cannot be continued to complex time.",
                f"The functions that can are {', '.join(_NUMPY)}. A passage with a pair of complex "
                "eigenvalues needs an analytic field.",
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
    """The reduced orbit from the real time `origin` on, in complex tau, or in complex t; states (t, x, y)."""

    def __init__(self, orbit: SlowOrbit, origin: float, *, through_folds: bool) -> None:
        self.through_folds = through_folds
        self.z = np.concatenate([[origin], orbit.at(origin)]).astype(complex)
        self.units = np.concatenate([[orbit.time], orbit.units])
        system, sampler = orbit.branch.system, orbit.sampler
        self.m, self.n = len(system.x), len(system.y)
        values = dict(system.parameters)
        E, g_y = orbit.branch.equations if through_folds else orbit.equations, entries(sampler.g, system.y)
        needed = set[sp.Symbol]().union(*(e.free_symbols for e in (*sampler.f, *g_y)))
        self.slow_alone = not through_folds and needed.isdisjoint(system.y)
        slopes = [] if self.slow_alone else [*entries(E, system.x), *entries(E, system.y)]
        self._field = ComplexFunction([*sampler.f, *slopes], system.states, values)
        self._g_y = ComplexFunction(g_y, system.states, values)
        self._pushes: ComplexFunction | None = None
        if orbit.branch.graph is not None:
            graph = dict(orbit.branch.graph)
            own = [laurent(g, system.epsilon, order=1).get(1, sp.Integer(0)) for g in system.g]
            moved = [
                sp.Add(*(derivative(graph[y], x) * f for x, f in zip(system.x, sampler.f))) for y in system.y
            ]
            self._pushes = ComplexFunction([e.xreplace(graph) for e in (*own, *moved)], system.states, values)

    def rate(self, z: np.ndarray) -> np.ndarray:
        """d(t, x, y)/dtau = (det E_y, f det E_y, -adj(E_y) E_x f), or that over det E_y."""
        m, n = self.m, self.n
        out = self._field(z[1:])
        if self.slow_alone:
            return np.concatenate([[1.0], out, np.zeros(n)])
        f, E_x, E_y = out[:m], out[m : m + n * m].reshape(n, m), out[m + n * m :].reshape(n, n)
        if not self.through_folds:
            return np.concatenate([[1.0], f, -np.linalg.solve(E_y, E_x @ f)])
        determinant = np.linalg.det(E_y)
        return np.concatenate([[determinant], determinant * f, -adjugate(E_y) @ (E_x @ f)])

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """g_y."""
        return self._g_y(z[1:]).reshape(self.n, self.n)

    def slope(self, z: np.ndarray, quantity: Callable[[np.ndarray], complex]) -> complex:
        """d quantity/dtau at z; the difference has an error that Newton's method and a first guess survive."""
        rate = self.rate(z)
        length, speed = (float(np.abs(v / self.units).max()) for v in (z, rate))
        delta = 1e-5 * (1.0 + length) / (1e-300 + speed)
        return (quantity(z + delta * rate) - quantity(z - delta * rate)) / (2.0 * delta)

    def carry(self, z: np.ndarray, step: complex) -> np.ndarray:
        """The orbit `step` later in tau, along a straight line."""
        from scipy.integrate import solve_ivp

        if step == 0:
            return z
        calls = 0

        def scaled(s: float, w: np.ndarray) -> np.ndarray:
            nonlocal calls
            calls += 1
            # Evaluations along one line at most: more are needed only next to a singularity of the orbit.
            if calls > 2000:
                raise np.linalg.LinAlgError("the orbit is nearly singular on the way")
            return step * self.rate(w)

        run = solve_ivp(scaled, (0.0, 1.0), z, method="DOP853", rtol=1e-13, atol=1e-15 * self.units)
        if not run.success or not np.isfinite(run.y).all():
            raise np.linalg.LinAlgError("the orbit is singular on the way")
        return run.y[:, -1]

    def zero(self, guess: complex) -> tuple[complex, complex] | None:
        """(tau, t) next to tau = `guess` where det g_y vanishes, by Newton's method; None when it fails."""
        tau, z, ahead = 0j, self.z, guess
        for _ in range(12):
            z, tau = self.carry(z, ahead - tau), ahead
            slope = self.slope(z, lambda w: complex(np.linalg.det(self.jacobian(w))))
            if slope == 0 or not np.isfinite(slope):
                return None
            step = -complex(np.linalg.det(self.jacobian(z))) / slope
            if abs(step) > 0.5 * abs(guess):
                step *= 0.5 * abs(guess) / abs(step)
            ahead = tau + step
            if abs(ahead) > 4.0 * abs(guess):
                return None
            if abs(step) <= 1e-13 * abs(ahead):
                return ahead, complex(z[0])
        return None

    def is_pushed(self, z: np.ndarray) -> bool:
        """Whether h_1 is singular at a turning point: <l, g_1 - Dh_0 f> is not 0; so where the branch is no graph."""
        if self._pushes is None:
            return True
        unit = self.units[-self.n :]
        left = np.linalg.svd(self.jacobian(z) * unit / unit[:, None])[0][:, -1].conj() / unit
        own, moved = self._pushes(z[1:]).reshape(2, self.n)
        # As coefficients that decide are told from 0 at real losses.
        return bool(abs(left @ (own - moved)) > ZERO * (np.abs(left) @ (np.abs(own) + np.abs(moved))))

    def level(self, end: complex, eigenvalue: complex) -> tuple[float, complex, np.ndarray]:
        """Re int lambda dt to tau = `end` along a straight line, lambda there, and z; lambda is continued."""
        nodes, _, S = chebyshev()
        total, z, tracked = 0j, self.z, eigenvalue
        step = end / PANELS
        for _ in range(PANELS):
            values = [tracked * self.rate(z)[0]]
            for a, b in itertools.pairwise(nodes):
                z = self.carry(z, 0.5 * step * (b - a))
                spectrum = np.linalg.eigvals(self.jacobian(z))
                tracked = complex(spectrum[np.argmin(np.abs(spectrum - tracked))])
                values.append(tracked * self.rate(z)[0])
            total += 0.5 * step * (S @ np.array(values))[-1]
        return float(total.real), tracked, z


def adjugate(matrix: np.ndarray) -> np.ndarray:
    """adj(A), A adj(A) = det(A), of a matrix that may be singular, by its singular value decomposition."""
    u, sizes, vh = np.linalg.svd(matrix)
    others = np.array([np.prod(np.delete(sizes, i)) for i in range(len(sizes))])
    return np.linalg.det(u) * np.linalg.det(vh) * (vh.conj().T * others) @ u.conj().T


def turning_points(orbit: SlowOrbit, loss: float, eigenvalue: complex) -> list[TurningPoint]:
    """Turning points next to a loss at time `loss` by the pair of `eigenvalue` = i omega; those that bound the delay.

    Found by Newton's method from fifteen starts around -i omega/(dlambda/dt), in t and in tau; one may be missed.
    """
    found: list[TurningPoint] = []
    symbols = set(orbit.branch.system.states)
    straight = not any(
        derivative(e, y).free_symbols & symbols for e in orbit.branch.equations for y in orbit.branch.system.y
    )
    # Where det E_y is constant tau is a multiple of t.
    for through_folds in (False,) if straight else (False, True):
        continued = ComplexOrbit(orbit, loss, through_folds=through_folds)
        for point in _turning_points(continued, 1j * eigenvalue.imag):
            if all(abs(point.t - other.t) > SAME * (orbit.time + abs(point.t)) for other in found):
                found.append(point)
    return sorted(found, key=lambda point: point.level)


def _turning_points(continued: ComplexOrbit, start: complex) -> list[TurningPoint]:

    def nearest(z: np.ndarray) -> complex:
        spectrum = np.linalg.eigvals(continued.jacobian(z))
        return complex(spectrum[np.argmin(np.abs(spectrum - start))])

    slope = continued.slope(continued.z, nearest)
    if slope == 0:
        return []
    time, seen = float(continued.units[0]), list[complex]()
    found: list[TurningPoint] = []
    # Newton's method in complex time starts at these multiples of what the eigenvalue's slope predicts.
    for radius, angle in itertools.product((1.0, 0.5, 2.0), (0.0, 0.7, -0.7, 1.3, -1.3)):
        try:
            zero = continued.zero(-radius * np.exp(1j * angle) * start / slope)
            if zero is None or any(
                min(abs(zero[1] - t), abs(zero[1] - t.conjugate())) <= SAME * (time + abs(t)) for t in seen
            ):
                continue
            seen.append(zero[1])
            for tau in (zero[0], zero[0].conjugate()):
                level, last, z = continued.level(tau, start)
                # An eigenvalue this small, in relative terms, has vanished.
                if abs(last) <= 1e-5 * abs(start) and level > 0.0:
                    if continued.is_pushed(z):
                        found.append(TurningPoint(complex(z[0]), level))
                    break
        except (np.linalg.LinAlgError, FloatingPointError, ZeroDivisionError, OverflowError):
            continue
    return found
