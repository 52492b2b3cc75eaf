"""Initial-value problems for integrators: nine of relaxation oscillators, chemistry and the sleigh, and a larger one.

Robertson, the Oregonator, HIRES and van der Pol at mu = 1e6: Test Set for IVP Solvers (Mazzia, Magherini 2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy as sp

import gsp


@dataclass(frozen=True, eq=False)
class Problem:
    """An initial-value problem. `floor` is atol/rtol; `grid` (m,) ends with the span.

    Errors are relative to each component's largest value on the grid, or, when `pointwise`, to its value there.
    """

    name: str
    field: gsp.VectorField
    start: dict[str, float]
    span: tuple[float, float]
    epsilon: float | None = None
    floor: float = 1.0
    grid: np.ndarray | None = None
    pointwise: bool = False
    is_stiff: bool = True

    @property
    def times(self) -> np.ndarray:
        """The output grid: by default 100 equal intervals."""
        return np.linspace(*self.span, 101)[1:] if self.grid is None else self.grid

    @property
    def y0(self) -> np.ndarray:
        """The start in the order of the states."""
        return np.array([self.start[symbol.name] for symbol in self.field.states], dtype=float)


x, y, z, v, w, omega, phi, epsilon = sp.symbols("x y z v w omega phi epsilon")
Q = sp.Rational


def van_der_pol(mu: int) -> Problem:
    """x'' = mu ((1 - x^2) x' - x): over one jump, slow time."""
    field = gsp.VectorField({x: y, y: mu * ((1 - x**2) * y - x)}, epsilon=None)
    return Problem(f"van der Pol, mu = {mu:.0e}".replace("+0", ""), field, {"x": 2, "y": 0}, (0.0, 2.0))


def lienard() -> Problem:
    """Van der Pol's oscillator in Lienard's plane, epsilon = 1e-6."""
    field = gsp.VectorField({x: (y - x**3 / 3 + x) / epsilon, y: -x}, epsilon=epsilon)
    return Problem("Lienard, epsilon = 1e-6", field, {"x": 2, "y": 2 / 3}, (0.0, 2.0), epsilon=1e-6)


def robertson() -> Problem:
    """Three species over nine decades of time; relative errors, since all are positive and one is 1e-5 at most."""
    slow, fast = Q(1, 25) * x - 10**4 * y * z, 3 * 10**7 * y**2
    field = gsp.VectorField({x: -slow, y: slow - fast, z: fast}, epsilon=None)
    start = {"x": 1, "y": 0, "z": 0}
    grid = np.geomspace(1e-3, 1e5, 101)
    grid[-1] = 1e5
    return Problem("Robertson", field, start, (0.0, 1e5), floor=1e-8, grid=grid, pointwise=True)


def oregonator() -> Problem:
    """The Belousov-Zhabotinskii reaction over one spike and a half."""
    s, f, q = Q("77.27"), Q("0.161"), Q("8.375e-6")
    rates = {x: s * (y + x * (1 - q * x - y)), y: (z - (1 + x) * y) / s, z: f * (x - z)}
    return Problem("Oregonator", gsp.VectorField(rates, epsilon=None), {"x": 1, "y": 2, "z": 3}, (0.0, 360.0))


def hires() -> Problem:
    """Eight species of a plant's response to light."""
    a = sp.symbols("a1:9")
    bound = 280 * a[5] * a[7]
    rates = {
        a[0]: Q("-1.71") * a[0] + Q("0.43") * a[1] + Q("8.32") * a[2] + Q("0.0007"),
        a[1]: Q("1.71") * a[0] - Q("8.75") * a[1],
        a[2]: Q("-10.03") * a[2] + Q("0.43") * a[3] + Q("0.035") * a[4],
        a[3]: Q("8.32") * a[1] + Q("1.71") * a[2] - Q("1.12") * a[3],
        a[4]: Q("-1.745") * a[4] + Q("0.43") * a[5] + Q("0.43") * a[6],
        a[5]: -bound + Q("0.69") * a[3] + Q("1.71") * a[4] - Q("0.43") * a[5] + Q("0.69") * a[6],
        a[6]: bound - Q("1.81") * a[6],
        a[7]: -bound + Q("1.81") * a[6],
    }
    start = {symbol.name: 0.0 for symbol in a} | {"a1": 1.0, "a8": 0.0057}
    return Problem("HIRES", gsp.VectorField(rates, epsilon=None), start, (0.0, 321.8122), floor=1e-2)


def sleigh_field() -> gsp.VectorField:
    """The Chaplygin sleigh with friction, six states: Eldering (2015), section 3."""
    a = Q(1, 5)
    rates = {
        v: omega * w + a * omega**2,
        w: -v * omega - (1 + a**2) * w / epsilon,
        omega: a * w / epsilon,
        phi: omega,
        x: v * sp.cos(phi) - w * sp.sin(phi),
        y: v * sp.sin(phi) + w * sp.cos(phi),
    }
    return gsp.VectorField(rates, epsilon=epsilon)


# One object: an equal one is found by comparing expressions in each call, which costs as much as the call.
SLEIGH = sleigh_field()


def sleigh(value: float) -> Problem:
    """The sleigh over twenty units of time."""
    return Problem(
        f"sleigh, epsilon = {value:g}",
        SLEIGH,
        {"v": 1, "w": 0, "omega": 1, "phi": 0, "x": 0, "y": 0},
        (0.0, 20.0),
        epsilon=value,
        is_stiff=value < 0.05,
    )


def ring(cells: int) -> Problem:
    """FitzHugh and Nagumo's neurons in a ring, each coupled to its neighbours' potentials, epsilon = 0.01."""
    a, b = sp.symbols(f"v0:{cells}"), sp.symbols(f"w0:{cells}")
    rates = {}
    for i in range(cells):
        coupling = (a[i - 1] - 2 * a[i] + a[(i + 1) % cells]) / 10
        rates[a[i]] = (a[i] - a[i] ** 3 / 3 - b[i] + Q(1, 2) + coupling) / epsilon
        rates[b[i]] = a[i] + Q(7, 10) - Q(4, 5) * b[i]
    phase = 2 * np.pi * np.arange(cells) / cells
    start = {a[i].name: float(np.cos(phase[i])) for i in range(cells)}
    start |= {b[i].name: float(0.3 * np.sin(phase[i])) for i in range(cells)}
    field = gsp.VectorField(rates, epsilon=epsilon)
    return Problem(f"FitzHugh-Nagumo ring, {2 * cells} states", field, start, (0.0, 5.0), epsilon=0.01)


RING = ring(10)
PROBLEMS = (
    van_der_pol(10**3),
    van_der_pol(10**6),
    lienard(),
    robertson(),
    oregonator(),
    hires(),
    sleigh(1e-6),
    sleigh(1e-3),
    sleigh(0.1),
)
