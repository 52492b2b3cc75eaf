"""Scenes in other units and in other orders, and what is said of a scene: verdicts without their numbers.

`python -m tests.rescaling SCENE...` prints what differs, for the named scenes or all of them.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import sympy as sp

from gsp import load, models
from gsp.analysis.analysis import Analysis, analyse
from gsp.analysis.fold_surroundings import not_followed, surroundings
from gsp.choice.choice import choose
from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.errors import GspError
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, classify
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem, VectorField
from tests.literature import FOLDER, systems

VERBS = ("check", "folds", "expand", "choose", "report")


def scenes() -> list[str]:
    """Names of every scene of the repository."""
    return [*models.names(), *systems()]


def scene(name: str) -> Scene:
    """The scene of that name, built in or from tests/systems."""
    return models.load(name) if name in models.names() else load(FOLDER / f"{name}.toml")


def rescaled(scene: Scene, powers: Mapping[str, int]) -> Scene:
    """The scene with each named state in units in which its numbers are 10**power times what they were."""
    new = _with_rates(
        scene, lambda of: in_units(of, powers), observables=in_units(scene.system.observables, powers)
    )

    def number(name: str, value: float) -> float:
        power = powers.get(name, 0)
        # The nearest double: a product with 1e-6 would be rounded twice.
        return value * 10.0**power if power >= 0 else value / 10.0**-power

    return replace(
        scene,
        system=new,
        region={n: (number(n, a), number(n, b)) for n, (a, b) in scene.region.items()},
        start={n: number(n, v) for n, v in scene.start.items()},
        starts={},
        claims={},
        views={},
        reconstruction=in_units(scene.reconstruction, powers),
    )


def mirrored(scene: Scene) -> Scene:
    """The scene with every state counted in the other direction."""
    turn = {s: -s for s in scene.system.states}

    def mirror(of: Mapping) -> dict:
        return {s: sp.sympify(e).xreplace(turn) for s, e in of.items()}

    new = _with_rates(
        scene, lambda of: {s: -e for s, e in mirror(of).items()}, observables=mirror(scene.system.observables)
    )
    return replace(
        scene,
        system=new,
        region={n: (-high, -low) for n, (low, high) in scene.region.items()},
        start={n: -value for n, value in scene.start.items()},
        starts={},
        claims={},
        views={},
        reconstruction=mirror(scene.reconstruction),
    )


def shifted(scene: Scene, by: Mapping[str, int]) -> Scene:
    """The scene with the numbers of each named state greater by that much: its origin lies elsewhere."""
    back = {sp.Symbol(name): sp.Symbol(name) - number for name, number in by.items()}

    def moved(of: Mapping) -> dict:
        return {s: sp.sympify(e).xreplace(back) for s, e in of.items()}

    new = _with_rates(scene, moved, observables=moved(scene.system.observables))
    return replace(
        scene,
        system=new,
        region={n: (a + by.get(n, 0), b + by.get(n, 0)) for n, (a, b) in scene.region.items()},
        start={n: v + by.get(n, 0) for n, v in scene.start.items()},
        starts={},
        claims={},
        views={},
        reconstruction=moved(scene.reconstruction),
    )


def retimed(scene: Scene, power: int) -> Scene:
    """The scene in a unit of time in which every rate is 10**power times what it was."""
    faster = sp.Integer(10) ** power

    def quickened(of: Mapping) -> dict:
        return {s: faster * sp.sympify(e) for s, e in of.items()}

    new = _with_rates(scene, quickened)
    return replace(
        scene,
        system=new,
        span=(float(scene.span[0] / faster), float(scene.span[1] / faster)),
        starts={},
        claims={},
        views={},
        reconstruction=quickened(scene.reconstruction),
    )


def _with_rates(
    scene: Scene, made: Callable[[Mapping], dict], **other: Mapping
) -> SlowFastSystem | VectorField:
    """The scene's system with what is `made` of its rates, and `other` parameters or observables."""
    system = scene.system
    words = {
        "epsilon": system.epsilon,
        "parameters": system.parameters,
        "observables": system.observables,
        **other,
    }
    if isinstance(system, SlowFastSystem):
        return SlowFastSystem(slow=made(system.slow), fast=made(system.fast), **words)
    return VectorField(made(system.equations), **words)


def in_units(of: Mapping, powers: Mapping[str, int]) -> dict:
    """Expressions by symbol where the numbers of each that is named are 10**power times what they were."""
    inner = {sp.Symbol(name): sp.Symbol(name) / sp.Integer(10) ** power for name, power in powers.items()}
    return {s: sp.Integer(10) ** powers.get(s.name, 0) * sp.sympify(e).xreplace(inner) for s, e in of.items()}


def reordered(scene: Scene, seed: int) -> Scene:
    """The scene with its states, equations and parameters declared in another order."""
    shuffle = random.Random(seed)

    def mixed(of: Mapping) -> dict:
        items = list(of.items())[::-1]
        shuffle.shuffle(items)
        return dict(items)

    new = _with_rates(scene, mixed, parameters=mixed(scene.system.parameters))
    return replace(scene, system=new, region=mixed(scene.region), start=mixed(scene.start), claims={})


def in_other_units(scene: Scene, *, singly: bool = False) -> Iterator[dict[str, int]]:
    """Powers of ten for each state: all alike, apart, and with `singly` one state at a time."""
    names = [s.name for s in scene.system.states]
    for power in (-6, 6):
        yield dict.fromkeys(names, power)
        yield {name: power if k % 2 else -power for k, name in enumerate(names)}
        if singly:
            yield from ({name: power} for name in names)


def _check(asked: Scene | Study) -> object:
    study = study_of(asked)
    return _told(classify(study.branch, region=study.region, epsilon=study.scene.epsilon))


def _told(found: Hyperbolicity) -> object:
    return (
        found.kind.name,
        sorted(loss.kind.name for loss in found.losses),
        sorted(loss.kind.name for loss in found.looked_at),
        [(condition.name, condition.holds) for condition in found.conditions],
        found.exclusion is not None and found.exclusion.is_complete,
    )


def _folds(asked: Scene | Study) -> object:
    study = study_of(asked)
    if not_followed(study) is not None:
        return "not followed"
    found = surroundings(study)
    curves = [found] if isinstance(found, CriticalCurve) else [*found.folds]
    return sorted(sorted(point.kind.name for point in curve.special) for curve in curves)


def _expand(asked: Scene | Study) -> object:
    return expand(study_of(asked).branch, order=2, symbolic=False).order


def _choose(asked: Scene | Study) -> object:
    return _chosen(choose(asked))


def _chosen(found) -> object:
    # Whether it pays is told by a clock.
    return [(c.label, c.valid, c.failure and c.failure.name) for c in found.candidates if c.order is not None]


def _report(asked: Scene | Study) -> object:
    return told(analyse(asked, order=2))


def told(found: Analysis) -> object:
    """What a report says, without its numbers."""
    boundary = found.boundary if "boundary" not in found.lost else None
    return (
        sorted(found.lost),
        None if "hyperbolicity" in found.lost else _told(found.hyperbolicity),
        None if "choice" in found.lost else _chosen(found.choice),
        boundary
        and (
            [(fold.passage is not None, fold.canard is not None) for fold in boundary.folds],
            sorted(str(point.kind) for point in boundary.folded),
            boundary.orbit is not None,
            boundary.period is not None,
        ),
        found.base is not None,
    )


def named_points(found: Analysis, powers: Mapping[str, int]) -> list[float]:
    """The points that a report names, in the units that the states had before they were `rescaled` by `powers`."""
    if "boundary" in found.lost or found.boundary is None:
        return []
    boundary = found.boundary
    places = [fold.point for fold in boundary.folds]
    places += [fold.passage.drop.point for fold in boundary.folds if fold.passage and fold.passage.drop.lands]
    places += [point.point for point in boundary.folded]
    places += [piece.landing for piece in (boundary.orbit.pieces if boundary.orbit else ()) if piece.landing]
    # Coordinates that a splitting made have units of their own.
    values = (
        float(place[name]) * 10.0 ** -powers[name]
        for place in places
        for name in sorted(place)
        if name in powers
    )
    return [*values, *(boundary.period or ())]


def verdict(asked: Scene | Study, verb: str) -> object:
    """What `verb` says: kinds of losses, Yes and No, what holds, statuses; a refusal by its kind."""
    verbs = {"check": _check, "folds": _folds, "expand": _expand, "choose": _choose, "report": _report}
    try:
        return verbs[verb](asked)
    except GspError as error:
        return type(error).__name__


def unordered(found: object) -> object:
    """The same verdict with every list of it sorted: a curve that is mirrored is met from its other end."""
    if isinstance(found, (list, tuple)):
        inner = [unordered(each) for each in found]
        return sorted(inner, key=repr) if isinstance(found, list) else tuple(inner)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.rescaling")
    parser.add_argument("names", nargs="*", metavar="scene")
    parser.add_argument("--verb", action="append", choices=VERBS)
    parser.add_argument("--singly", action="store_true", help="each state by itself too")
    parser.add_argument("--orders", action="store_true", help="other orders of declaration, not units")
    parser.add_argument("--time", action="store_true", help="other units of time, not of the states")
    parser.add_argument("--mirror", action="store_true", help="states in the other direction")
    parser.add_argument("--shift", type=int, help="states with their origin that far away")
    options = parser.parse_args(arguments)
    for name in options.names or scenes():
        plain = scene(name)
        others = (
            {f"order {k}": reordered(plain, k) for k in range(2)}
            if options.orders
            else {f"rates of 1e{power}": retimed(plain, power) for power in (-6, 6)}
            if options.time
            else {f"by {options.shift}": shifted(plain, {s.name: options.shift for s in plain.system.states})}
            if options.shift
            else {"mirrored": mirrored(plain)}
            if options.mirror
            else {str(p): rescaled(plain, p) for p in in_other_units(plain, singly=options.singly)}
        )
        for verb in options.verb or VERBS:
            expected = verdict(plain, verb)
            for what, other in others.items():
                try:
                    got = verdict(other, verb)
                except Exception as error:
                    got = f"{type(error).__name__}: {error}"
                if (unordered(got) != unordered(expected)) if options.mirror else got != expected:
                    print(f"{verb} {name} {what}\n  was {expected}\n  now {got}", flush=True)
            print(f"{verb} {name} looked at", flush=True)


if __name__ == "__main__":
    main()
