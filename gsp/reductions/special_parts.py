"""Candidates from special parameter values: what is small is the distance along the ray to one of them.

A Tikhonov-Fenichel value (Goeke, Walcher and Zerz 2015) says exactly which parameters may be called small together. How
small they are here is measured: the reduction at the special value is run against the full run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.algebra.brevity import brief
from gsp.algebra.laurent import laurent, pole_order
from gsp.choice.candidates import GRID_POINTS, LARGEST_LAYER
from gsp.choice.forecast import LAYER_LEFT
from gsp.errors import GspError, Status
from gsp.integration.methods import Method
from gsp.integration.spread_times import spread_times
from gsp.integration.trajectory import PLAIN, RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_function import compile_function
from gsp.scales.small_parameter import SmallParameter
from gsp.scales.special_values import small_parameters
from gsp.scenes.scene import Scene
from gsp.systems.system import VectorField
from gsp.systems.tolerances import absolute_tolerance

# Runs that rank the candidates.
RTOL = 1e-6
# So many explicit steps are made while an implicit one is compiled, which is used once.
EXPLICIT_STEPS = 100_000

# Layers by the vanishing parameters that divide in them, and the order of the ray's pole.
Layers = dict[tuple[frozenset[str], int], VectorField]


@dataclass(frozen=True)
class SpecialPart:
    """A special value as a candidate: the field in epsilon along the ray, which is 1 at the scene's own values."""

    small: SmallParameter
    states = None

    @property
    def name(self) -> str:
        """Which parameters vanish, and on which manifold."""
        gone = ", ".join(self.small.vanishing)
        on = ", ".join(f"{brief(e.lhs)} = 0" for e in self.small.manifold)
        return f"motion onto {on}, for small {gone}"

    @property
    def count(self) -> int:
        """How many fast directions there are."""
        return self.small.critical.codimension

    def field(self, original: VectorField) -> VectorField:
        """The field in epsilon."""
        return self.small.field


def special_parts(field: VectorField, is_separated: Callable[[int], bool]) -> list[SmallParameter]:
    """The special values with so many fast directions as `is_separated` allows, whose manifolds attract, as graphs."""
    dimensions = [d for d in range(1, len(field.states)) if is_separated(len(field.states) - d)]
    # Choices of vanishing parameters, 2^count, that are looked at in a search.
    if not dimensions or len(field.parameters) > 8:
        return []
    try:
        found = small_parameters(field, dimensions=dimensions)
    except GspError:
        return []
    return [e for e in found if e.attracts is not False and e.is_positive is not False and e.graph is not None]


def without_repetition(found: Iterable[SmallParameter]) -> tuple[SmallParameter, ...]:
    """Those whose manifold the start leads to and on which something moves, one for each reduction on it."""
    useful: dict[object, SmallParameter] = {}
    for each in found:
        graph = each.graph
        if graph is not None and each.error is not None and np.isfinite(each.error) and not each.is_trivial:
            # More parameters that vanish, to the same reduction on the same manifold, say nothing new.
            useful.setdefault((frozenset(graph.items()), frozenset(each.reduced.items())), each)
    return tuple(useful.values())


def with_errors(
    scene: Scene,
    run: Trajectory,
    found: Sequence[SmallParameter],
    *,
    progress: Callable[[float], object] = lambda share: None,
) -> tuple[SmallParameter, ...]:
    """Each with its `error` at the scene's values, least first; infinite where the start leads to no such manifold.

    One whose manifold is implicit, or beyond the exact algebra's reach, stays without, and comes last; all do where the
    full run does not reach its end.

    The largest of |difference| over the states that stay, relative to the largest value of each, of the reduction from
    where the layer's flow leads, against the full run behind the layer; over the others, where those that stay do not
    depend on them.
    """
    if not run.status.ok:
        return tuple(found)
    measured = []
    layers: Layers = {}
    for k, each in enumerate(found):
        progress(k / len(found))
        measured.append(
            replace(each, error=_error(scene, run, each, layers)) if each.graph is not None else each
        )
    return tuple(sorted(measured, key=lambda each: each.error if each.error is not None else float("inf")))


def _layer(small: SmallParameter, known: Layers) -> VectorField:
    """The leading part of the field along the ray, without its 1/epsilon.

    Of the vanishing parameters those that stand below a line are on the ray, and the others are 0 in what is `known`
    of these: its code is compiled once.
    """
    field, epsilon, whole, order = small.original, small.epsilon, small.critical.whole, small.critical.ray.order
    below = {p.name for p, i in whole.places.items() for _, b in whole.rates if any(k[i] for k, _ in b)}
    divides = frozenset(below & set(small.vanishing))
    if (divides, order) not in known:
        ray = {p: epsilon * p for p in field.parameters if p.name in divides}
        rates = {z: rate.xreplace(ray) / epsilon ** (1 - order) for z, rate in field.equations.items()}
        if any(pole_order(rate, epsilon) > 1 for rate in rates.values()):
            # As of p/q^2 with both on it.
            rates, divides = small.field.equations, frozenset(small.vanishing)
        layer = {z: laurent(rate, epsilon, order=-1).get(-1, sp.S.Zero) for z, rate in rates.items()}
        known[divides, order] = VectorField(layer, parameters=field.parameters)
    return known[divides, order].with_parameters(**dict.fromkeys(set(small.vanishing) - divides, 0.0))


def _error(scene: Scene, run: Trajectory, small: SmallParameter, layers: Layers) -> float | None:
    first, last = scene.span

    def over(flow: VectorField, start: dict[str, float], options: RunOptions = PLAIN) -> Trajectory:
        atol = absolute_tolerance(RTOL, scene.region, start)
        return trajectory_of(flow, start, scene.span, None, RTOL, atol, options=options)

    try:
        landing = over(_layer(small, layers), dict(scene.start))
        if not landing.status.ok or not _is_on(small, landing.y[:, -1], scene):
            return float("inf")
        size = np.abs(landing.y).max(axis=1)
        away = (np.abs(landing.y - landing.y[:, -1:]) / np.where(size > 0.0, size, 1.0)[:, None]).max(axis=0)
        felt = np.flatnonzero(away > LAYER_LEFT * scene.tolerance)
        begun = first if not felt.size else float(landing.t[min(felt[-1] + 1, len(landing.t) - 1)])
        # As of any candidate: what is told behind a longer layer is told of the end of the run.
        if not begun - first <= LARGEST_LAYER * (last - first):
            return float("inf")
        if not small.is_within_reach:
            return None
        # Refused where a rate of the reduction divides by 0 at the scene's own values.
        reduced = small.reduced_field
        names = [s.name for s in reduced.states]
        landed = dict(zip((s.name for s in landing.flow.states), landing.y[:, -1]))
        begin = {name: landed[name] for name in names}
        own = over(reduced, begin, RunOptions(method=Method.DOP853, max_steps=EXPLICIT_STEPS))
        if own.status is Status.TOO_MANY_STEPS:
            own = over(reduced, begin)
    except GspError:
        return float("inf")
    if not own.status.ok:
        return float("inf")
    times = spread_times(run, begun, last, GRID_POINTS)
    exact, kept = run.sample(times), own.sample(times)
    got = {name: kept[name] for name in names}
    assert small.graph is not None
    gone = list(small.graph)
    if not any(small.original.equations[s].has(*gone) for s in reduced.states):
        # What stays is exact whatever is left out, and it is the others that count.
        places = np.stack([got.get(s.name, np.zeros(len(times))) for s in small.original.states], axis=1)
        got = dict(zip((z.name for z in gone), _graph(small, places).T))
    gaps = [np.abs(got[n] - exact[n]).max() / (np.abs(exact[n]).max() or 1.0) for n in got]
    return float(max(gaps))


def _graph(small: SmallParameter, places: np.ndarray) -> np.ndarray:
    """The manifold's values (m, r) of the states that are gone, over places (m, n)."""
    assert small.graph is not None
    parameters = small.original.parameters
    function = compile_function(
        tuple(small.graph.values()),
        arguments=small.original.states,
        epsilon=None,
        parameters=tuple(parameters),
    )
    return function(places, np.array([0.0, *map(float, parameters.values())]))


def _is_on(small: SmallParameter, place: np.ndarray, scene: Scene) -> bool:
    """Whether the layer's flow has come to rest on this manifold, to the tolerance."""
    assert small.graph is not None
    there = np.array([place[small.original.states.index(z)] for z in small.graph])
    size = np.maximum(np.abs(place).max(), np.abs(there))
    return bool((np.abs(_graph(small, place[None, :])[0] - there) <= scene.tolerance * size).all())
