"""The passage through a fold, measured: full orbits to a section beyond it, and Omega_0 from a ladder of epsilons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsp.algebra.laurent import laurent
from gsp.critical.common_units import common_units
from gsp.critical.layer_problem import LayerProblem
from gsp.errors import DeclarationError, Status
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.integration.loop import check_tolerances
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.roots import root
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import FoldPassage
from gsp.systems.arguments import check_noun
from gsp.systems.flow import Point, check_epsilon, check_epsilons, complete, in_words, values_by_name

# A start on M0 is forgotten when the attraction has shrunk its distance from M_epsilon by exp(-FORGOTTEN).
FORGOTTEN = 60.0


@dataclass(frozen=True, eq=False, repr=False)
class FoldExit:
    """Where the orbit of the full system meets the section: `point` by name at slow time `t` after the start.

    `run` is the orbit, `expected` the slow coordinates of equation (2) of `gsp.singular.passage.fold_passage`;
    `resolution` bounds what the start, a point of M0, still matters: exp(-C/epsilon), C the attraction on the way.
    """

    epsilon: float
    section: tuple[str, float]
    point: Mapping[str, float]
    t: float
    expected: Mapping[str, float]
    resolution: float
    run: Trajectory
    status: Status

    @property
    def message(self) -> str:
        """One line: whether the section was met, and where."""
        place = in_words(self.point, 12)
        name, value = self.section
        if self.status.ok:
            return f"met the section {name} = {value:g} at {place}"
        return f"did not meet the section {name} = {value:g}; last at {place}; {self.run.message}"

    def __repr__(self) -> str:
        return f"FoldExit(epsilon={self.epsilon:g}, {self.message})"


@dataclass(frozen=True, eq=False, repr=False)
class AiryFit:
    """Omega_0 and the coefficient of epsilon ln epsilon as measured: least squares over exits in one section.

    `delays` (k,) are the slow times l . g_x (x - x_0)/b at `epsilons` (k,); the fit is by epsilon^(2/3),
    epsilon ln epsilon, epsilon, epsilon^(4/3) ln epsilon, epsilon^(4/3), as many of them as the ladder allows.
    `logarithmic` and `expected_logarithmic` are per unit of slow time.
    """

    epsilons: np.ndarray
    delays: np.ndarray
    omega0: float
    logarithmic: float
    expected_logarithmic: float

    def __repr__(self) -> str:
        return f"AiryFit(omega0={self.omega0:.8g}, logarithmic={self.logarithmic:.5g})"

    def __str__(self) -> str:
        low, high = self.epsilons.min(), self.epsilons.max()
        return (
            f"fit over {len(self.epsilons)} epsilons from {low:g} to {high:g}\n"
            f"  Omega_0             {self.omega0:.8f}  (Airy {OMEGA_0:.8f}, error {self.omega0 - OMEGA_0:.1e})\n"
            f"  epsilon ln epsilon  {self.logarithmic:.6f}  (derived {self.expected_logarithmic:.6f})"
        )


def fold_exit(
    passage: FoldPassage,
    *,
    epsilon: float,
    section: Mapping[str, float] | None = None,
    start: Point | None = None,
    rtol: float = 1e-13,
) -> FoldExit:
    """The full orbit through a fold to `section` = {fast variable: value}, located on the orbit to rounding.

    The section is halfway to where the drop lands unless given. The orbit starts at `start`, or on the attracting
    sheet so far upstream that its start is forgotten. An orbit that does not meet the section has another status than
    SUCCESS. Raises `DeclarationError` for a section on the wrong side of the fold, and `PassageError` when a default
    is asked for and there is none.

    >>> from gsp import SlowFastSystem, fold_passage
    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> passage = fold_passage(SlowFastSystem(slow={y: 1}, fast={x: x**2 + y}, epsilon=epsilon), {"x": 0, "y": 0})
    >>> round(fold_exit(passage, epsilon=0.01, section={"x": 1}).point["y"], 10)
    0.0988437926
    """
    check_noun(passage, FoldPassage, verb="fold_exit")
    small = check_epsilon(epsilon)
    rtol = check_tolerances(rtol, 1.0)[0]
    system = passage.system
    name, value = _section(passage, section)
    if start is None:
        first, time, contraction = upstream(passage, small)
    else:
        given = complete(start, system.states, what="start")
        first, time, contraction = np.array(given), None, float("nan")
    states = [s.name for s in system.states]
    column = states.index(name)
    delay = passage.delay(small)
    span = (3.0 * delay + time) if time is not None else 4.0 * _distance(passage, first) + 3.0 * delay
    beyond = {**passage.point, name: value}
    places = np.array(
        [first, [passage.point[s.name] for s in system.states], [beyond[s.name] for s in system.states]]
    )
    atol = rtol * 1e-3 * min(1.0, float(common_units(system, places).min()))
    run, crossing = None, None
    # How often the span is lengthened until the section is met.
    for _ in range(6):
        run = trajectory_of(
            system,
            start=dict(zip(states, map(float, first))),
            span=(0.0, span),
            epsilon=small,
            rtol=rtol,
            atol=atol,
            options=RunOptions(method=Method.RADAU13),
        )
        crossing = _crossing(passage, run, column, value)
        if crossing is not None or not run.status.ok:
            break
        span *= 2.0
    assert run is not None
    if crossing is None:
        status = Status.NOT_CONVERGED if run.status.ok else run.status
        point, t = dict(zip(states, map(float, run.y[:, -1]))), float(run.t[-1])
    else:
        status = Status.SUCCESS
        t, z = _located(run, crossing, column, value, small, rtol, atol)
        point = dict(zip(states, map(float, z)))
    return FoldExit(
        small, (name, value), point, t, passage.exit(small), float(np.exp(-contraction / small)), run, status
    )


def fit_omega0(
    passage: FoldPassage,
    epsilons: Sequence[float] = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6),
    *,
    section: Mapping[str, float] | None = None,
) -> AiryFit:
    """Omega_0 from measured exits at a ladder of `epsilons`, all from one start.

    Raises `DeclarationError` for fewer than four epsilons, `PassageError` when an orbit does not meet the section.
    """
    check_noun(passage, FoldPassage, verb="fit_omega0")
    ladder = np.array(sorted(set(check_epsilons(epsilons)), reverse=True))
    if len(ladder) < 4:
        raise DeclarationError("a fit takes four epsilons or more.", "Lengthen the ladder.", got=len(ladder))
    place = dict([_section(passage, section)])
    begin = upstream(passage, float(ladder[0]))[0]
    start = {s.name: float(v) for s, v in zip(passage.system.states, begin)}
    slope = _slope(passage)
    delays = []
    for epsilon in ladder:
        found = fold_exit(passage, epsilon=float(epsilon), section=place, start=start)
        if not found.status.ok:
            raise PassageError(f"at {passage.system.epsilon} = {epsilon:g} the orbit {found.message}.")
        x = np.array([found.point[s.name] for s in passage.system.x])
        delays.append(float(slope @ (x - passage.x0)) / passage.b)
    measured = np.array(delays)
    logs, third = np.log(ladder), ladder ** (1.0 / 3.0)
    basis = np.stack(
        [third**2, ladder * logs, ladder, third**4 * logs, third**4][: max(3, len(ladder) - 2)], axis=1
    )
    # Rows weighted by the leading term: relative residuals.
    weighted = basis / basis[:, :1]
    size = np.abs(weighted).max(axis=0)
    fitted = np.linalg.lstsq(weighted / size, measured / basis[:, 0], rcond=None)[0] / size
    return AiryFit(
        ladder,
        measured,
        float(fitted[0]) * (passage.a * passage.b) ** (1.0 / 3.0),
        float(fitted[1]),
        float(slope @ passage.logarithmic) / passage.b,
    )


def _slope(passage: FoldPassage) -> np.ndarray:
    """l . g_x at the fold (n_slow,)."""
    u = np.concatenate([passage.x0, passage.y0])
    return passage.left @ LayerProblem.over_all(passage.system).jacobian(u)[:, : len(passage.system.x)]


def upstream(passage: FoldPassage, epsilon: float) -> tuple[np.ndarray, float, float]:
    """A point (x, y) of the attracting sheet on the reduced orbit into the fold, its slow time to it, the attraction.

    The orbit is followed against time as a curve: its tangent (f mu, eta) spans the kernel of (g_x f | g_y), which is
    regular at the fold. Its length is that of (mu, l . eta) in units of the way expected, so that the states' units do
    not enter. The attraction is int |Re lambda| dt, at least FORGOTTEN epsilon where the sheet is long enough.
    """
    system, problem = passage.system, LayerProblem.over_all(passage.system)
    m = len(system.x)
    rates = compile_over(system, [laurent(rate, system.epsilon, order=0).get(0, 0) for rate in system.f])
    p = compile_flow(system).constants
    a, b, left = passage.a, passage.b, passage.left
    # From (1): C = (4/3) a^2 |v|^3/|b|, and v is at this distance for the time a v^2/|b|.
    distance = (0.75 * FORGOTTEN * epsilon * abs(b) / a**2) ** (1.0 / 3.0)
    lasts = abs(a) * distance**2 / abs(b)
    reach = distance * np.abs(passage.right)
    columns = np.append(lasts, np.where(reach > 0.0, reach, reach.max()))

    def tangent(z: np.ndarray, before: np.ndarray) -> np.ndarray:
        """(mu, eta) of unit length, turned like `before`."""
        jacobian = problem.jacobian(z)
        along = np.append(before[0] / lasts**2, (left @ before[1:]) / distance**2 * left)
        equations = np.column_stack([jacobian[:, :m] @ rates(z, p), jacobian[:, m:]])
        matrix = np.vstack([equations, along]) * columns
        sizes = np.abs(matrix).max(axis=1)
        found = columns * np.linalg.solve(matrix / sizes[:, None], np.append(np.zeros(len(left)), 1.0))
        return found / np.hypot(found[0] / lasts, left @ found[1:] / distance)

    def velocity(z: np.ndarray, before: np.ndarray) -> np.ndarray:
        k = tangent(z, before)
        return np.concatenate([rates(z, p) * k[0], k[1:]])

    z = np.concatenate([passage.x0, passage.y0])
    before = np.concatenate([[0.0], -np.sign(a) * passage.right])
    # Steps along the reduced orbit upstream, as a share of the way expected: of fourth order, 1e-10.
    h, time, contraction, rate = 0.01, 0.0, 0.0, 0.0
    path = []
    for _ in range(10000):
        try:
            k1 = velocity(z, before)
            k2 = velocity(z + 0.5 * h * k1, before)
            k3 = velocity(z + 0.5 * h * k2, before)
            k4 = velocity(z + h * k3, before)
            ahead = z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            mu = tangent(z + 0.5 * h * k2, before)[0]
            before = tangent(ahead, before)
        except np.linalg.LinAlgError:
            break
        if not np.isfinite(ahead).all():
            break
        new_rate = float(problem.eigenvalues(ahead[None, :])[0].real.max())
        if new_rate >= 0.0 or mu >= 0.0:
            break
        contraction += 0.5 * (abs(rate) + abs(new_rate)) * abs(mu) * h
        time += abs(mu) * h
        z, rate = ahead, new_rate
        path.append((rate, z, time, contraction))
        if contraction >= FORGOTTEN * epsilon:
            return z, time, contraction
    if not path:
        raise PassageError(
            f"no attracting sheet leads to the fold at {in_words(passage.point)}.", "Give a start."
        )
    # The sheet ends before: the start is where it attracts most, away from both of its ends.
    _, z, time, contraction = min(path, key=lambda place: place[0])
    return z, time, contraction


def _distance(passage: FoldPassage, z: np.ndarray) -> float:
    """Slow time from z to the fold, roughly."""
    x = z[: len(passage.system.x)]
    return float(np.linalg.norm(x - passage.x0) / np.linalg.norm(passage.slow_rate))


def _section(passage: FoldPassage, section: Mapping[str, float] | None) -> tuple[str, float]:
    names = [s.name for s in passage.system.y]
    if section is None:
        if not passage.drop.lands:
            raise PassageError(f"{passage.drop}.", "Give a section, {fast variable: value}.")
        i = int(np.argmax(np.abs(passage.right)))
        return names[i], 0.5 * (passage.y0[i] + passage.drop.point[names[i]])
    given = values_by_name(section, what="section")
    if len(given) != 1 or next(iter(given)) not in names:
        raise DeclarationError(
            "section is one fast variable and its value.",
            f"The fast variables are {', '.join(names)}.",
            got=given,
        )
    name, value = next(iter(given.items()))
    i = names.index(name)
    if (value - passage.y0[i]) * passage.right[i] * np.sign(passage.a) <= 0.0:
        raise DeclarationError(
            f"the section {name} = {value:g} is not beyond the fold, {name} = {passage.y0[i]:.6g}.",
            f"Orbits leave towards {('larger' if passage.right[i] * passage.a > 0 else 'smaller')} {name}; "
            "take it there.",
        )
    return name, value


def _crossing(passage: FoldPassage, run: Trajectory, column: int, value: float) -> int | None:
    """The first step that ends beyond the section."""
    i = column - len(passage.system.x)
    side = np.sign(passage.a * passage.right[i])
    beyond = side * (run.y[column] - value) >= 0.0
    return int(np.argmax(beyond)) if beyond.any() and not beyond[0] else None


def _located(
    run: Trajectory, step: int, column: int, value: float, epsilon: float, rtol: float, atol: float
) -> tuple[float, np.ndarray]:
    """Time and state in the section: on the dense output, then by Newton's method on orbits of full order."""
    low, high = float(run.t[step - 1]), float(run.t[step])
    first, y = low, run.y[:, step - 1]
    ends = float(y[column] - value), float(run.y[column, step] - value)
    found = root(lambda t: float(run.at(t)[column] - value), low, high, ends=ends)
    assert found is not None
    compiled, p = compile_flow(run.flow), parameter_vector(run.flow, epsilon)
    start = {s.name: float(v) for s, v in zip(run.flow.states, y)}
    t, z = found, run.at(found)
    for _ in range(4):
        if t > first:
            short = trajectory_of(
                run.flow,
                start=start,
                span=(first, t),
                epsilon=epsilon,
                rtol=rtol,
                atol=atol,
                options=RunOptions(method=Method.RADAU13),
            )
            z = short.y[:, -1]
        change = (z[column] - value) / compiled.rates(z, p)[column]
        t = max(t - change, first)
        if abs(change) <= 0.5 * np.finfo(float).eps * abs(t):
            break
    return t, z
