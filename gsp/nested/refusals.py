"""What is asked of two small parameters, and what is refused by name: their order, their values, hidden time scales."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import sympy as sp

from gsp.algebra.laurent import misplaced_epsilon, pole_order
from gsp.errors import DeclarationError, DegenerateError, SplittingError
from gsp.results.table import Names
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import positive_parameter, unused_epsilon, without_small
from gsp.scenes.study import Study
from gsp.systems.arguments import check_each, check_text, shown
from gsp.systems.system import VectorField


def asked(scene: Scene, small: Iterable[str | Iterable[str]] | None) -> tuple[Scene, str, str]:
    """The scene with two parameters that are to be small, and their names: those given, or the scene's own.

    Several parameters that vanish in proportion, and one that stands in both places with others, are multiplied by a
    new one, whose value is 1. One that is both, as in mu y' = g and mu^2 x' = h, is so in the latter as mu epsilon.
    """
    if small is None and scene.second:
        return scene, str(scene.system.epsilon), scene.second
    if small is None:
        raise DeclarationError(
            f"{scene.name or 'the scene'} does not say which two parameters are small.",
            'Name them, that of the fastest scale first: --small epsilon,delta; in Python small=["epsilon", "delta"].',
        )
    be = "two names of parameters, or sequences of names, that of the fastest scale first"
    groups = check_each(small, lambda group: _group(group, be), what="small", be=be)
    if len(groups) == 2 and groups[0] == groups[1] and len(groups[0]) == 1:
        return _squared(scene, groups[0][0])
    if len(groups) != 2 or groups[0] == groups[1] or not all(groups):
        given = ", ".join("+".join(group) for group in groups) or "none"
        raise DeclarationError(f"small are {be}.", got=given, value=groups)
    for group in groups:
        twice = next((name for name in group if group.count(name) > 1), None)
        if twice is not None:
            raise DeclarationError(
                f"{twice} is named twice among those that vanish together.",
                "Name it once.",
                got="+".join(group),
            )
    if all(len(group) == 1 for group in groups):
        return scene, groups[0][0], groups[1][0]
    plain = without_small(scene)
    system = plain.system
    symbols = {p.name: p for p in system.parameters}
    free = Names(
        s.name for s in (*system.states, *system.parameters, *system.observables, *plain.reconstruction)
    )
    ray, new = {p: p for p in system.parameters}, {}
    for group, name in zip(groups, ("epsilon", "delta")):
        factor = sp.Symbol(free(name))
        new[factor] = sp.Integer(1)
        for each in group:
            if each not in symbols:
                raise DeclarationError.none_of(
                    symbols, each, f"small names {shown(each)}, and no parameter has this name.", "They are"
                )
            ray[symbols[each]] *= factor
    field = VectorField(
        {z: rate.xreplace(ray) for z, rate in zip(system.states, system.rates)},
        parameters={**system.parameters, **new},
        name=system.name,
        observables={o: e.xreplace(ray) for o, e in system.observables.items()},
    )
    return replace(plain, system=field), *(s.name for s in new)


def _squared(scene: Scene, name: str) -> tuple[Scene, str, str]:
    """The scene with a new small parameter for one of the factors where `name` has a pole of order two."""
    plain = without_small(scene)
    system = plain.system
    symbol = second_of(plain, name)
    new = unused_epsilon(plain.full_flow)
    rates = {
        z: sp.expand(rate * symbol / new) if pole_order(rate, symbol) > 1 else rate
        for z, rate in zip(system.states, system.rates)
    }
    field = VectorField(
        rates,
        parameters={**system.parameters, new: system.parameters[symbol]},
        name=system.name,
        observables=system.observables,
    )
    if rates == dict(zip(system.states, system.rates)):
        raise SplittingError(
            f"no rate has a pole of order two in {name}, so that it makes no third time scale.",
            "Name two parameters.",
        )
    return replace(plain, system=field), new.name, name


def _group(group: str | Iterable[str], be: str) -> tuple[str, ...]:
    if isinstance(group, (str, bytes)):
        return (check_text(group, what="every one of small"),)
    return check_each(group, lambda name: check_text(name, what="every one of small"), what="small", be=be)


def second_of(scene: Scene, name: str) -> sp.Symbol:
    """The second small parameter by its name, once it is known to be one."""
    symbol = positive_parameter(
        scene, name, said=f"small names {name}", remedy=f"Give {name} a positive value."
    )
    for rate in scene.system.rates:
        wrong = misplaced_epsilon(rate, symbol)
        if wrong is not None:
            raise DeclarationError(
                f"{name} stands in {wrong}, which is no pole or power of {name}.",
                f"Replace it by its Taylor polynomial in {name}, or rescale.",
            )
    return symbol


def refuse_other_way(first: Study, second: sp.Symbol) -> None:
    """Raise `SplittingError` where the second divides only rates that the first makes fast already."""
    system = first.system
    divided = {y: rate for y, rate in system.fast.items() if pole_order(rate, second)}
    moving = [x for x, rate in system.slow.items() if rate.has(second)]
    if divided and not moving:
        raise SplittingError(
            f"{second} stands in no slow rate: it divides that of {', '.join(y.name for y in divided)}, which "
            f"{system.epsilon} makes fast already, so that the two are nested the other way round.",
            f"Name {second} first: ({second}, {system.epsilon}).",
        )


def refuse_values(scene: Scene, second: sp.Symbol, weight: int) -> None:
    """Raise `SplittingError` where the first is not small beside the power of the second that it has to be."""
    value = float(scene.system.parameters[second])
    beside = value ** (weight - 1)
    if weight > 1 and scene.epsilon >= beside:
        raise SplittingError(
            f"{scene.system.epsilon} = {scene.epsilon:g} is not small beside {second ** (weight - 1)} = {beside:g}, so "
            "that they are not nested in this order.",
            f"Name {second} first, or give {scene.system.epsilon} a smaller value.",
        )


def hidden_scale(first: Study, second: sp.Symbol, fact: str) -> DegenerateError:
    """The error for a rate that the leading nested reduction does not see."""
    epsilon = first.system.epsilon
    return DegenerateError(
        f"the nested reduction is degenerate, and a time scale is hidden: {fact}. What moves there depends on "
        f"{epsilon}/{second}.",
        f"Say how the two are related: put {epsilon} = a*{second}^2 or so into the equations, and take {second} alone.",
    )
