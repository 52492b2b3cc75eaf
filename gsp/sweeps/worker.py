"""The work on one chunk, by whichever process: claim it, compute its points, write them, enter it in the ledger."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsp.errors import DeclarationError, one_line
from gsp.results.point_verbs import Record, point_verbs
from gsp.sweeps.plan import COMPUTED, DIED, FAILED, Plan, Variable
from gsp.sweeps.store import STATUS, Store, folders_of_plans
from gsp.sweeps.tasks import encoded, function_of, is_verb, variables_of
from gsp.systems.arguments import check_among, check_positive

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene
    from gsp.scenes.study import Study

# Verbs share stages of the theory, and those of a process are made one at a time.
_ALONE = threading.Lock()


class Subject:
    """What a sweep is about: the scene of a model, and its studies at other numbers."""

    def __init__(self, scene: Scene | None) -> None:
        self.scene = scene
        # The last study, by what its exact stages depend on; an epsilon that runs faster than parameters shares it.
        self._last: tuple[object, Study] | None = None

    def check(self, axes: Mapping[str, object], options: Mapping[str, object], task: str) -> None:
        """Raises `DeclarationError` for an axis that is no number of the scene, and for one that is given twice."""
        scene = self.scene
        if scene is None:
            if is_verb(task):
                raise DeclarationError(f"{task} is done to a model.", "Give one: model='chaplygin_sleigh'.")
            return
        if is_verb(task) and not scene.has_small and point_verbs()[task].needs_small:
            from gsp.scenes.small_parameter import no_small_parameter

            raise no_small_parameter(scene, f"{task} needs one")
        known = self.names
        for name in axes:
            if scene.has_small and name == str(scene.system.epsilon) and name not in known:
                raise DeclarationError(
                    f"{name} is the small parameter, which every sweep calls epsilon.", "Call the axis epsilon."
                )
            check_among(name, known, f"{name} is no number of the model.", "Its numbers are")
            if name in options:
                raise DeclarationError(f"{name} is an axis and an option.", "Give it once.")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The numbers of the scene that may be an axis."""
        assert self.scene is not None
        system = self.scene.system
        small = ["epsilon"] if self.scene.has_small else []
        names = [*small, "tolerance", *map(str, system.parameters), *self.scene.start]
        return tuple(dict.fromkeys(names))

    def at(self, coordinates: Mapping[str, float]) -> tuple[Study, float, float]:
        """The study at other parameters and another start, the last one if they are the same; epsilon; tolerance."""
        # What has a model needs most of the package; a function of its own needs none of it.
        from gsp.scenes.settings import ask_again
        from gsp.scenes.study import Study
        from gsp.systems.flow import check_epsilon

        assert self.scene is not None
        scene = self.scene
        parameters = {k: v for k, v in coordinates.items() if k in map(str, scene.system.parameters)}
        start = {k: v for k, v in coordinates.items() if k in scene.start and k not in parameters}
        key = (parameters, start)
        if self._last is None or self._last[0] != key:
            if parameters:
                scene = ask_again(scene, parameters=parameters)
            if start:
                scene = replace(scene, start={**scene.start, **start})
            self._last = (key, Study(scene))
        epsilon, tolerance = (coordinates.get(name) for name in ("epsilon", "tolerance"))
        return (
            self._last[1],
            scene.epsilon if epsilon is None else check_epsilon(epsilon),
            scene.tolerance if tolerance is None else check_positive(tolerance, what="tolerance"),
        )

    def forget(self) -> None:
        """Let go of the last study and what it has kept."""
        self._last = None


def subject_of(folder: Path, model: str) -> Subject:
    """What the sweep in `folder` is about."""
    path = folder / model
    return _subject(folder, model, _stamp(path) if model and path.is_file() else None)


@lru_cache(maxsize=8)
def _subject(folder: Path, model: str, stamp: object) -> Subject:
    if not model:
        return Subject(None)
    path = folder / model
    if stamp is not None:
        from gsp.readers import load

        return Subject(load(path))
    from gsp import models

    return Subject(models.load(model))


def compute_point(plan: Plan, subject: Subject, coordinates: Mapping[str, float]) -> Record:
    """What the task of a plan records at one point; raises what the task raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if is_verb(plan.task):
            return point_verbs()[plan.task].record(*subject.at(coordinates), **plan.options)
        function = function_of(plan.task)
        if subject.scene is None:
            return function(**coordinates, **plan.options)
        study, epsilon, tolerance = subject.at(coordinates)
        return function(replace(study.scene, epsilon=epsilon, tolerance=tolerance), **plan.options)


def timed_point(
    plan: Plan, folder: Path, coordinates: Mapping[str, float]
) -> tuple[Record, Mapping[str, Variable], float]:
    """The record at one point, what it says that the task records, and the seconds that it took."""
    subject = subject_of(folder, plan.model)
    begun = time.perf_counter()
    record = compute_point(plan, subject, coordinates)
    spent = time.perf_counter() - begun
    if plan.variables:
        return record, plan.variables, spent
    study = subject.at(coordinates)[0] if subject.scene is not None else None
    return record, variables_of(plan.task, record, study, plan.options), spent


def compute_chunk(folder: str, data: str, chunk: int) -> bool:
    """Compute a chunk of the sweep in `folder` and enter it; False when another process is at work on it."""
    root = Path(folder)
    store = _store(root / data)
    if store.ledger.entry(chunk) is not None:
        return True
    with store.ledger.claimed(chunk) as is_claimed, _ALONE:
        if not is_claimed:
            return False
        if store.ledger.entry(chunk) is None:
            subject = subject_of(root, store.plan.model)
            earlier = [_store(other) for other in folders_of_plans(root) if other.name != data]
            fill(store, chunk, lambda point: _found(store, earlier, subject, point))
            subject.forget()
    return True


def fill(store: Store, chunk: int, found: Callable[[tuple[int, ...]], Record | str]) -> None:
    """Write a chunk of which `found` gives the record at each point, or the message of a process that died."""
    blocks, messages = store.empty(chunk), {}
    points = store.plan.points(chunk)
    shape = blocks[STATUS].shape
    for number, point in enumerate(points):
        place = np.unravel_index(number, shape)
        try:
            record = found(point)
            if isinstance(record, str):
                blocks[STATUS][place], messages[number] = DIED, record
                continue
            values = {name: encoded(record, variable) for name, variable in store.plan.variables.items()}
        except Exception as error:
            # A message in the ledger is at most so long.
            blocks[STATUS][place], messages[number] = FAILED, one_line(error, 500)
            continue
        for name, value in values.items():
            blocks[name][place] = value
        blocks[STATUS][place] = COMPUTED
    store.write(chunk, blocks, messages)


def _found(store: Store, earlier: list[Store], subject: Subject, point: tuple[int, ...]) -> Record:
    """The record at a point: known from planning, from an earlier plan, or computed."""
    plan = store.plan
    known = plan.known.get(plan.number(point))
    if known is not None:
        return known
    coordinates = plan.coordinates(point)
    for other in earlier:
        record = _looked_up(other, coordinates, plan.variables)
        if record is not None:
            return record
    return compute_point(plan, subject, coordinates)


def _looked_up(
    store: Store, coordinates: Mapping[str, float], variables: Mapping[str, Variable]
) -> Record | None:
    """What an earlier plan has computed at these coordinates."""
    plan = store.plan
    if set(plan.axes) != set(coordinates) or dict(plan.variables) != dict(variables):
        return None
    places = _places(store)
    point = tuple(places[name].get(coordinates[name], -1) for name in plan.axes)
    if -1 in point:
        return None
    chunk = plan.chunk_of(point)
    blocks = _block(store, chunk)
    if blocks is None:
        return None
    inside = tuple(i % b for i, b in zip(point, plan.block))
    if blocks[STATUS][inside] != COMPUTED:
        return None
    return {
        v.recorded: np.take(v.meanings, blocks[name][inside]).tolist() if v.meanings else blocks[name][inside]
        for name, v in plan.variables.items()
    }


def _store(folder: Path) -> Store:
    return _store_as_of(folder, _stamp(folder / "plan.json"))


@lru_cache(maxsize=8)
def _store_as_of(folder: Path, stamp: object) -> Store:
    return Store.open(folder)


def _stamp(path: Path) -> tuple[int, int, int]:
    """What tells a file from another that stood there before: a worker outlives a sweep that is begun anew."""
    found = path.stat()
    return found.st_ino, found.st_mtime_ns, found.st_size


@lru_cache(maxsize=8)
def _places(store: Store) -> dict[str, dict[float, int]]:
    return {name: {value: i for i, value in enumerate(values)} for name, values in store.plan.axes.items()}


@lru_cache(maxsize=8)
def _block(store: Store, chunk: int) -> dict[str, Any] | None:
    return None if store.ledger.entry(chunk) is None else store.read(chunk)
