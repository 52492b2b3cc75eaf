"""Which parameter of a scene counts as small, or which of its variables as fast, where its author has not said it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import jacobian
from gsp.algebra.elimination_over_rationals import generic_point, independent_rows, numbers_at
from gsp.algebra.laurent import laurent
from gsp.errors import DeclarationError, SplittingError
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.scenes.scene import LADDER, Scene
from gsp.scenes.slow_time import explain_slow_time, told_in_slow_time
from gsp.splitting.fast_time import divided, divides
from gsp.systems.arguments import check_among, check_each, check_noun, check_text, shown
from gsp.systems.declaration import exact
from gsp.systems.region import Interval, rounded_outwards
from gsp.systems.system import SlowFastSystem, VectorField
from gsp.systems.tolerances import absolute_tolerance

# A run that only says where the states go.
RTOL = 1e-6
# The value of a small parameter that stands in no equation of the model: what is fast is divided by it.
BOOKKEEPING = 1.0


def no_small_parameter(scene: Scene, purpose: str) -> SplittingError:
    """The error for what needs a small parameter; `purpose` says what that is, as in "check needs one"."""
    return SplittingError(
        f"{scene.name or 'the scene'} has no small parameter, and {purpose}.",
        "Name the parameter that is small, --small NAME, or the variables that are fast, --fast NAME,...; in Python "
        "take_small(scene, parameter=NAME) and take_fast(scene, variables=[NAME, ...]). find_reductions(scene) looks "
        "for what is fast.",
    )


def take_small(scene: Scene, *, parameter: str) -> Scene:
    """The scene in which `parameter`, given by its name, is the small one, at the value that it has.

    Where no rate has a pole in it, the time becomes the slow one: every rate is divided by it, and the span is
    multiplied by it. A small parameter that the scene had becomes an ordinary one. States that are not fast and that
    the region does not bound get the interval that the run from the start stays in. Raises `DeclarationError` for a
    name that is no parameter, for a value that is not positive, and for a parameter that stands in no rate or in a
    function, and `SplittingError` for a factor of every rate that stands nowhere else.

    >>> from gsp import models
    >>> take_small(models.load("michaelis_menten"), parameter="kappa").system.epsilon
    kappa
    """
    check_noun(scene, Scene, verb="take_small")
    name = check_text(parameter, what="parameter")
    plain = without_small(scene)
    system = plain.system
    symbol = positive_parameter(
        plain,
        name,
        said=f"parameter is {shown(name)}",
        remedy=f"Give {name} a positive value, or name the variables that are fast.",
    )
    value = float(system.parameters[symbol])
    if not any(rate.has(symbol) for rate in system.rates):
        raise DeclarationError(
            f"{name} stands in no rate, so that it separates no time scales.",
            "Name another parameter.",
            value=name,
        )
    has_pole = any(divides(rate, symbol) for rate in system.rates)
    # In another time the rates of ramps would be others.
    changes = {} if has_pole else told_in_slow_time(plain, symbol, value) | {"ramps": {}}
    field = VectorField(
        dict(zip(system.states, system.rates)),
        epsilon=symbol,
        parameters={s: v for s, v in system.parameters.items() if s != symbol},
        name=system.name,
        observables=system.observables,
    )
    field = divided(field) if changes else field
    rates = field.equations
    fast = [state for state, rate in rates.items() if divides(rate, symbol)]
    # Of fast states that are not so by themselves slow coordinates are made, which need their bounds.
    unbounded = [state.name for state in fast] if are_fast_by_themselves(rates, symbol, fast) else []
    # What turns turns fast by the parameter that the scene says, and not by another.
    phase = scene.phase if symbol == scene.system.epsilon else None
    return replace(
        plain,
        system=field,
        epsilon=value,
        epsilons=None,
        phase=phase,
        **_bounds(plain, unbounded),
        **changes,
    )


def are_fast_by_themselves(
    rates: Mapping[sp.Symbol, sp.Expr], symbol: sp.Symbol, fast: Sequence[sp.Symbol]
) -> bool:
    """Whether no combination of the `fast` states, whose rates have a pole in `symbol`, is slow.

    The rates' leading parts have a Jacobian in these states that is invertible at a generic point.
    """
    if len(fast) < 2:
        return True
    leading = [min(laurent(rates[state], symbol, order=-1).items())[1] for state in fast]
    matrix = jacobian(leading, fast)
    values = numbers_at(matrix, generic_point(sorted(matrix.free_symbols, key=str)))
    return values is not None and len(independent_rows(values)) == len(fast)


def take_fast(scene: Scene, *, variables: Iterable[str]) -> Scene:
    """The scene in which the states that `variables` names are fast: epsilon y' = g, the model itself at epsilon = 1.

    Raises `DeclarationError` for names that are no states, and where none or every state is to be fast.

    >>> from gsp import models
    >>> take_fast(models.load("michaelis_menten"), variables=["s"]).system.y
    (s,)
    """
    check_noun(scene, Scene, verb="take_fast")
    names = check_each(
        variables,
        lambda name: check_text(name, what="every one of variables"),
        what="variables",
        be="a sequence of names of states",
    )
    plain = without_small(scene)
    system = plain.system
    states = [s.name for s in system.states]
    chosen = list(dict.fromkeys(names))
    for name in chosen:
        check_among(name, states, f"variables names {shown(name)}, which is no state.", "The states are")
    if not 0 < len(chosen) < len(states):
        raise DeclarationError(
            "variables are some of the states, not all and not none.",
            f"The states are {', '.join(states)}.",
            got=", ".join(chosen) or "none",
            known=states,
        )
    epsilon = unused_epsilon(plain.full_flow)
    rates = dict(zip(system.states, system.rates))
    slow_fast = SlowFastSystem(
        slow={s: rate for s, rate in rates.items() if s.name not in chosen},
        fast={s: rate for s, rate in rates.items() if s.name in chosen},
        epsilon=epsilon,
        parameters=system.parameters,
        name=system.name,
        observables=system.observables,
    )
    return with_bookkeeping(plain, slow_fast, chosen)


def with_bookkeeping(scene: Scene, system: SlowFastSystem | VectorField, fast: Iterable[str]) -> Scene:
    """The scene with a system that is its own at epsilon = 1; `fast` states get no new bounds."""
    ladder = tuple(BOOKKEEPING * share for share in LADDER)
    return replace(scene, system=system, epsilon=BOOKKEEPING, epsilons=ladder, **_bounds(scene, fast))


def without_small(scene: Scene) -> Scene:
    """The scene with its small parameter as an ordinary one, at the value that the scene asks about."""
    system, epsilon = scene.system, scene.system.epsilon
    if epsilon is None:
        return scene
    field = VectorField(
        dict(zip(system.states, system.rates)),
        parameters={**system.parameters, epsilon: exact(scene.epsilon)},
        name=system.name,
        observables=system.observables,
    )
    return replace(scene, system=field, epsilon=None, epsilons=None, second="", phase=None)


def explain_small(scene: Scene, before: Scene) -> list[str]:
    """Sentences that say what `take_small` or `take_fast` made of the scene `before`, and what it left."""
    system, epsilon = scene.system, scene.system.epsilon
    assert epsilon is not None
    rates = dict(zip(system.states, system.rates))
    fast = [z.name for z, rate in rates.items() if divides(rate, epsilon)]
    if isinstance(system, SlowFastSystem):
        said = [
            f"fast variables: {', '.join(fast)}; their rates are divided by {epsilon}, which is 1 for the model itself"
        ]
        parameters = system.parameters
    else:
        slower = not any(divides(rate, epsilon) for rate in before.system.rates)
        said = [
            f"small parameter: {epsilon} = {scene.epsilon:g}"
            + ("" if slower else f", which divides the rates of {', '.join(fast)}")
        ]
        if scene.epsilon >= 1.0:
            said.append(f"{epsilon} = {scene.epsilon:g} is not small, and series in it are of no use")
        parameters = {s: v for s, v in system.parameters.items() if s != epsilon}
        if slower:
            said += [explain_slow_time(scene, before), f"fast in that time: {', '.join(fast)}"]
        others = [z.name for z, rate in rates.items() if z.name not in fast and rate.has(epsilon)]
        if others:
            said.append(f"{epsilon} stands in the rates of {', '.join(others)} too, and is as small there")
    left = {p: [z.name for z, rate in rates.items() if divides(rate, p)] for p in parameters}
    said += [
        f"left as it is: {p} = {parameters[p]}, which divides the rate of {', '.join(where)}"
        for p, where in left.items()
        if where
    ]
    return said


def positive_parameter(scene: Scene, name: str, *, said: str, remedy: str) -> sp.Symbol:
    """The parameter of this name, which is positive; errors begin with what was `said`, and end with the `remedy`."""
    parameters = scene.system.parameters
    symbol = next((s for s in parameters if s.name == name), None)
    if symbol is None:
        raise DeclarationError.none_of(parameters, name, f"{said}, and no parameter has this name.", "They are")
    value = float(parameters[symbol])
    if value <= 0.0:
        raise DeclarationError(
            f"{name} = {value:g} cannot be the small parameter, which is positive.", remedy, value=value
        )
    return symbol


def unused_epsilon(flow: VectorField) -> sp.Symbol:
    """A symbol for a bookkeeping parameter: epsilon, or epsilon_1 and so on where the flow has one of this name."""
    taken = {s.name for s in (*flow.states, *flow.parameters, *flow.observables)}
    words = ("epsilon", *(f"epsilon_{k}" for k in range(1, len(taken) + 1)))
    return sp.Symbol(next(word for word in words if word not in taken))


def _bounds(scene: Scene, fast: Iterable[str]) -> dict[str, Mapping[str, Interval]]:
    """The `region`, with an interval for every state that has none and is not among the `fast`, unless all are, and
    these as `found_bounds`.

    The interval is that in which the run from the start stays, or one around the start for a state that stays there,
    without what no run from positive values reaches.
    """
    states = [s.name for s in scene.system.states]
    free = [name for name in states if name not in set(fast)] or states
    missing = [name for name in free if name not in scene.region]
    region = dict(scene.region)
    if missing:
        flow, start, span, _ = scene.setting(None, None, None)
        run = trajectory_of(
            flow,
            start=start,
            span=span,
            epsilon=scene.epsilon,
            rtol=RTOL,
            atol=absolute_tolerance(RTOL, region, scene.full_start),
        )
        for name in missing:
            low, high = (sign * _largest(run, name, sign) for sign in (-1.0, 1.0))
            size = max(abs(low), abs(high))
            # What keeps to the tolerance stays within.
            margin = scene.tolerance * size if high - low > RTOL * size else 1.0 + size
            region[name] = rounded_outwards(low - margin, high + margin, RTOL * margin)
        for name in _never_negative(scene.full_flow, [s for s in flow.states if run[s].min() >= 0.0]):
            if name in missing:
                region[name] = max(region[name][0], 0.0), region[name][1]
    found = {**scene.found_bounds, **{name: region[name] for name in missing}}
    return {"region": region, "found_bounds": found}


def _largest(run: Trajectory, name: str, sign: float) -> float:
    """The largest value of `sign` times a state over the run, also where it turns within a step."""
    steps = np.arange(len(run.t))
    times = np.interp(np.linspace(0.0, steps[-1], 8 * steps[-1] + 1), steps, run.t)
    largest = -np.inf
    # About the largest value so far, eight times as finely each time.
    for _ in range(4):
        values = sign * run.sample(times)[name]
        values = np.where(np.isfinite(values), values, -np.inf)
        at = int(np.argmax(values))
        largest = max(largest, float(values[at]))
        times = np.linspace(times[max(at - 1, 0)], times[min(at + 1, len(times) - 1)], 17)
    return largest


def _never_negative(flow: VectorField, candidates: Iterable[sp.Symbol]) -> set[str]:
    """Of the states that are `candidates` those that stay positive or zero once they are: amounts, as of substances.

    The rate of each is not negative where it is zero and the others are not negative, as the signs of its terms say.
    """
    rates = dict(zip(flow.states, flow.rates))
    signs = {p: sp.Dummy(positive=value > 0, negative=value < 0) for p, value in flow.parameters.items()}
    kept: set[sp.Symbol] = set()
    never = set(candidates)
    while kept != never:
        kept = never
        known = {**signs, **{s: sp.Dummy(nonnegative=True) for s in kept}}
        never = {s for s in kept if rates[s].xreplace({**known, s: sp.S.Zero}).is_nonnegative}
    return {s.name for s in kept}
