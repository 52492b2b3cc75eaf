"""The surroundings of a folded node: its scales, its singular canards, and the lines on M0 where sheets begin.

Along the strong and the weak eigendirection of the desingularised reduced flow (`singularities.desingularised`)
the reduced flow has its singular canards; those in between fill the funnel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.errors import DeclarationError
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.singular.singularities.desingularised import FoldedError, desingularise
from gsp.singular.singularities.folded_singularities import FoldedKind, FoldedSingularity
from gsp.systems.flow import values_by_name
from gsp.systems.system import SlowFastSystem, VectorField

# How a singular canard leaves the folded node, in units of the local scale.
DEPARTURE = 0.02
# Desingularised time in which a singular canard gets away from the node or never, over the eigenvalue.
PATIENCE = 40.0
# Singular orbits run off to infinity as a rule; what they meet within this many steps is near enough.
STEPS = 2000
# A section further from the node than this, in local units, does not cut the canards where they turn.
FURTHEST_SECTION = 3.0
# 1 - mu below which gamma_0 and gamma_w are not told apart; at 5e-4 one of the two crossings is lost.
DEGENERATE = 2e-3
_NOTHING = [float("nan")]


@dataclass(frozen=True)
class Plane:
    """The plane on which the state number `index` is `value`; with M0 a line on M0."""

    index: int
    value: float


@dataclass(frozen=True, eq=False)
class Units:
    """Units of states: (z - `centre`)/`sizes`, both (n,)."""

    centre: np.ndarray
    sizes: np.ndarray

    def of(self, z: np.ndarray | float) -> np.ndarray:
        """States (..., n) in these units."""
        return (z - self.centre) / self.sizes

    @property
    def back(self) -> Units:
        """The units of the states that these are of, in these."""
        return Units(-self.centre / self.sizes, 1.0 / self.sizes)


@dataclass(frozen=True, eq=False, repr=False)
class FoldedNodeFrame:
    """A folded node with negative eigenvalues, numerically.

    - `point` (3,), the two slow states before the fast one; `strong` and `weak` (3,) point to the attracting side,
      as long as `unit` in the slow plane; `rates` are their eigenvalues;
    - `sizes` (3,) are how far the states move in the time |T|^(-1/2), the fast one by |T|^(1/2)/|g_yy|; `units`
      those of the model's states in which the system here is written;
    - `width` is the local scale of the fast variable, (epsilon |T|)^(1/2)/|g_yy|, with T of
      `singularities.desingularised`, `depth` that of g, epsilon |T|/|g_yy|, and `unit` of the slow variables
      along the fold, |f| times `time` = (epsilon/|T|)^(1/2), that of slow time. In these the system near the
      node does not depend on epsilon to leading order.
    """

    system: SlowFastSystem
    singularity: FoldedSingularity
    epsilon: float
    point: np.ndarray
    strong: np.ndarray
    weak: np.ndarray
    rates: tuple[float, float]
    sizes: np.ndarray
    units: Units
    width: float
    depth: float
    unit: float
    time: float
    desingularised: VectorField
    critical: CompiledFunction

    def g(self, z: np.ndarray) -> float:
        """g at epsilon = 0."""
        return float(self.critical(z, _NOTHING)[0])

    def gradient(self, z: np.ndarray) -> np.ndarray:
        """Its gradient (3,)."""
        return self.critical(z, _NOTHING)[1:4]

    def on_critical(self, z: np.ndarray, *, held: int | None = None) -> np.ndarray:
        """The point of M0 next to z, with the state number `held` as it is."""
        z = z.copy()
        for _ in range(30):
            slope = self.gradient(z)
            if held is not None:
                slope[held] = 0.0
            step = self.g(z) * slope / (slope @ slope)
            z -= step
            if np.abs(step).max() <= 1e-14 * (1.0 + np.abs(z).max()):
                break
        return z

    def strong_canard(self, side: int) -> Trajectory:
        """The strong singular canard from beside the node outwards, against the desingularised time.

        `side` is 1 on the attracting and -1 on the repelling sheet. The state `contraction` grows by
        g_y^2 for each unit of that time: over epsilon, the powers of e by which orbits approach the sheet.
        """
        return self.outwards(self.point + side * DEPARTURE * self.strong, PATIENCE / abs(self.rates[0]))

    def outwards(self, z: np.ndarray, span: float) -> Trajectory:
        """The singular orbit through the point of M0 next to z, against the desingularised time."""
        return self._run(self.on_critical(z), -span, rtol=1e-9, atol=1e-12)

    def inwards(self, z: np.ndarray) -> Trajectory:
        """The singular orbit from the point z of M0 in the desingularised time, which ends in the node or leaves."""
        return self._run(z, PATIENCE / abs(self.rates[1]), rtol=1e-7, atol=1e-9)

    def _run(self, z: np.ndarray, end: float, *, rtol: float, atol: float) -> Trajectory:
        start = dict(zip([state.name for state in self.desingularised.states], [*z, 0.0]))
        options = RunOptions(max_steps=STEPS)
        return trajectory_of(self.desingularised, start, (0.0, end), rtol=rtol, atol=atol, options=options)


def frame_at(singularity: FoldedSingularity, *, epsilon: float, units: Units | None = None) -> FoldedNodeFrame:
    """The frame of a folded node, with its states in `units` where they are given, about the system's centre.

    Raises `FoldedError` where there is no folded node whose canards cross from the attracting to the repelling
    sheet, or not two slow variables.
    """
    system = singularity.system
    if len(system.x) != 2:
        raise FoldedError(
            "canards of a folded node are sought for two slow variables.",
            "Hold the others constant, as parameters.",
            got=len(system.x),
        )
    _check_kind(singularity)
    if units is None:
        units = Units(np.zeros(3), np.ones(3))
    else:
        singularity = singularity_in(singularity, units.sizes)
        system = singularity.system
    flow = desingularise(system)
    x, y = system.x, system.y[0]
    point = np.array([float(sp.N(singularity.point[s.name])) for s in system.states])
    jacobian = compile_function(
        [derivative(flow.rates[a], b) for a in system.states for b in system.states], arguments=system.states
    )
    values, vectors = np.linalg.eig(jacobian(point, _NOTHING).reshape(3, 3))
    slope = [derivative(flow.g, s) for s in system.states]
    bend = [derivative(flow.fold, s) for s in system.states]
    drift = [derivative(rate, s) for rate in flow.f for s in system.states]
    local = compile_function([*bend, *flow.f, *drift], arguments=system.states)
    at = local(point, _NOTHING)
    exact_eigenvalues = [float(sp.N(value)) for value in singularity.eigenvalues]
    trace = abs(float(sp.N(singularity.trace)))
    time = float(np.sqrt(epsilon / trace))
    unit = float(np.linalg.norm(at[3:5])) * time
    moves = np.abs([*at[3:5], trace / at[2]]) / np.sqrt(trace)
    # Across the fold states move at second order only.
    across = np.abs(at[5:]).reshape(2, 3) @ moves / np.sqrt(trace)
    sizes = moves + np.append(across, 0.0)
    directions = []
    for value in exact_eigenvalues:
        v = np.real(vectors[:, int(np.argmin(np.abs(values - value)))])
        # Where g_y falls the sheet attracts. Along the weak direction of a saddle-node g_y may not change.
        v = v * (-np.sign(at[:3] @ v) or 1.0)
        directions.append(unit * v / np.linalg.norm(v[:2]))
    contraction = sp.Dummy("contraction")
    states = {s: flow.rates[s] for s in system.states}
    desingularised = VectorField(states={**states, contraction: -(flow.fold**2)}, epsilon=None)
    critical = compile_function([flow.g, *slope, flow.fold], arguments=(*x, y))
    return FoldedNodeFrame(
        system=system,
        singularity=singularity,
        epsilon=epsilon,
        point=point,
        strong=directions[0],
        weak=directions[1],
        rates=(exact_eigenvalues[0], exact_eigenvalues[1]),
        sizes=np.where(sizes > 0.0, sizes, 1.0),
        units=units,
        width=float(np.sqrt(epsilon * trace) / abs(at[2])),
        depth=float(epsilon * trace / abs(at[2])),
        unit=unit,
        time=time,
        desingularised=desingularised,
        critical=critical,
    )


def singularity_in(singularity: FoldedSingularity, units: np.ndarray) -> FoldedSingularity:
    """The singularity of the system about its centre, its states in `units` (3,); eigenvalues know of none."""
    system = singularity.system
    # Values have no states in them, though SymPy writes roots of polynomials in an x.
    point = {
        s.name: (singularity.point[s.name] - system.centres.get(s, 0)) / sp.Rational(unit)
        for s, unit in zip(system.states, units.tolist())
    }
    return replace(singularity, system=system.about_centres.moved_into(units), point=MappingProxyType(point))


def section_of(
    frame: FoldedNodeFrame, section: Mapping[str, float] | Mapping[sp.Symbol, float] | None
) -> Plane:
    """The section: by default the slow variable that is the faster at the node beside its size has its value there."""
    system = frame.system
    names = [s.name for s in system.x]
    rates = np.array([float(sp.N(rate)) for rate in _slow_rates(frame)])
    shares = np.abs(rates) / frame.sizes[:2]
    if section is None:
        index = int(np.argmax(shares))
        return Plane(index, float(frame.point[index]))
    index, value = _single(section, names, what="section")
    if shares[index] < 1e-6 * shares.max():
        raise DeclarationError(
            f"the section {names[index]} = {value:g} is not crossed by the slow flow at the folded node, "
            f"where {names[index]}' = {rates[index]:.3g}.",
            f"Take the section in {names[1 - index]}.",
        )
    off = abs(value - frame.point[index]) / (frame.unit * abs(rates[index]) / np.linalg.norm(rates))
    if off > FURTHEST_SECTION:
        raise DeclarationError(
            f"the section {names[index]} = {value:g} lies {off:.1f} local units from the folded node at "
            f"{frame.point[index]:.6g}; the canards turn within {FURTHEST_SECTION:g}.",
            "Move it to the node.",
        )
    return Plane(index, value)


def line_of(
    frame: FoldedNodeFrame, line: Mapping[str, float] | Mapping[sp.Symbol, float], *, what: str
) -> Plane:
    """A line on M0 that the user gave as one state and its value."""
    return Plane(*_single(line, [s.name for s in frame.system.states], what=what))


def _slow_rates(frame: FoldedNodeFrame) -> tuple[sp.Expr, ...]:
    flow = desingularise(frame.system)
    put = dict(zip(frame.system.states, map(float, frame.point)))
    return tuple(rate.xreplace({s: sp.Float(v) for s, v in put.items()}) for rate in flow.f)


def _single(
    plane: Mapping[str, float] | Mapping[sp.Symbol, float], names: list[str], *, what: str
) -> tuple[int, float]:
    given = values_by_name(plane, what=what)
    if len(given) != 1 or next(iter(given)) not in names:
        raise DeclarationError(
            f"{what} fixes one of {', '.join(names)}, as in {{{names[0]!r}: 0.5}}.", got=given or "nothing"
        )
    name, value = next(iter(given.items()))
    return names.index(name), value


def _check_kind(singularity: FoldedSingularity) -> None:
    kind = singularity.kind
    if kind is FoldedKind.NODE and singularity.to_repelling:
        mu = float(sp.N(singularity.mu))
        if 1.0 - mu < DEGENERATE:
            raise FoldedError(
                "canards of a folded node are sought between its strong and its weak direction, gamma_0 and "
                "gamma_w.",
                "Change a parameter.",
                got=(
                    f"mu = {mu:.15g}: at a degenerate node, mu = 1, these are one, and from 1 - mu = "
                    f"{DEGENERATE:g} on they are not told apart"
                ),
            )
        return
    instead = {
        FoldedKind.NODE: "its eigenvalues are positive: orbits cross from the repelling to the attracting sheet only "
        "(faux canards)",
        FoldedKind.SADDLE: "a folded saddle has one canard, along its stable direction, and no others turn about it",
        FoldedKind.FOCUS: "a folded focus has no canards: every orbit jumps at the fold",
        FoldedKind.SADDLE_NODE_I: "mu = 0 at a folded saddle-node: the number of canards is not bounded there",
        FoldedKind.SADDLE_NODE_II: "mu = 0 at a folded saddle-node: the number of canards is not bounded there",
    }.get(kind, singularity.reason)
    raise FoldedError(
        "canards that turn belong to a folded node with negative eigenvalues.",
        "Ask folded_singularities for another, or change a parameter.",
        got=f"a {kind.value}: {instead}",
    )
