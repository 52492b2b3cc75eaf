"""How a sweep is planned: its model, what a point records, and how many points a chunk holds."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsp.errors import DeclarationError, GspError, ModelFileError, OutputError, one_line
from gsp.readers.toml import bytes_of
from gsp.sweeps.execution import (
    Apart,
    ProcessDied,
)
from gsp.sweeps.fingerprint import PACKAGES, fingerprint_of
from gsp.sweeps.ledger import this_host, write_whole
from gsp.sweeps.plan import Plan, Variable, block_of
from gsp.sweeps.store import STATUS, Store, folders_of_plans, kept
from gsp.sweeps.tasks import as_numbers, check_options, meaning_of
from gsp.sweeps.worker import Subject, subject_of, timed_point
from gsp.systems.arguments import shown

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene

# Seconds of work in a chunk, and how many points are tried for one that tells what a point records.
CHUNK_SECONDS = 1.0
TRIED = 16


def prepared(
    task: str,
    axes: dict[str, tuple[float, ...]],
    root: Path,
    model: str | Path | Scene | None,
    options: dict[str, object],
    anew: bool,
    points: int | None,
    elsewhere: Callable[[], Apart] | None,
) -> Store:
    """The store for this plan: the one that is there, or a new one beside those of other axes.

    Points are computed to plan in a process that `elsewhere` begins, or in this one.
    """
    check_options(task, options)
    content, name = _model(model)
    subject = _subject(content, name)
    subject.check(axes, options, task)
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{root} cannot be made: {error.strerror}.", "Give another folder.") from None
    _refuse_others(root, content, name)
    fingerprint = fingerprint_of(task, options, subject.scene)
    if anew:
        for folder in root.glob("data-*"):
            shutil.rmtree(folder)
        (root / "plan.json").unlink(missing_ok=True)
    else:
        _refuse_changes(root, fingerprint)
    plan = Plan(task, options, name, axes, (1,) * len(axes), {}, fingerprint)
    folder = root / plan.name
    if not (folder / "plan.json").is_file():
        about = {"task": task, "model": name, **{k: v for k, v in fingerprint.items() if k in PACKAGES}}
        building = root / f"{plan.name}.{this_host()}.{os.getpid()}.partial"
        try:
            building.mkdir(exist_ok=True)
            if content is not None:
                (building / name).write_bytes(content)
            ready = _like_earlier(root, plan, points) or _measured(plan, building, points, elsewhere)
            Store(building, ready).create(about)
            if content is not None:
                os.replace(building / name, root / name)
            building.rename(folder)
        except BaseException as error:
            shutil.rmtree(building, ignore_errors=True)
            # Another process may have planned the same sweep meanwhile.
            if not isinstance(error, OSError) or not (folder / "plan.json").is_file():
                raise
    if not (root / "plan.json").is_file() or kept(root).plan.name != plan.name:
        write_whole(root / "plan.json", json.dumps({"data": plan.name}).encode())
    return Store.open(folder)


def _refuse_others(root: Path, content: bytes | None, name: str) -> None:
    """Raises `OutputError` where `root` holds more than a sweep, or what one that was killed has left."""
    if (root / "plan.json").is_file():
        return
    ours = folders_of_plans(root)
    for path in root.iterdir():
        is_model = path.name == name and path.is_file() and path.read_bytes() == content
        if not (is_model or path in ours or path.suffix == ".partial"):
            raise OutputError(
                f"{root} holds other files than those of a sweep.",
                "Give an empty folder.",
                got=shown(path.name),
            )


def _model(model: str | Path | Scene | None) -> tuple[bytes | None, str]:
    """The content of a model file and the name it gets beside the plan; or no content and a built-in name."""
    from gsp.scenes.scene import Scene

    if model is None:
        return None, ""
    if isinstance(model, Scene):
        from gsp.readers.writing import as_toml

        return as_toml(model).encode(), "model.toml"
    if not isinstance(model, (str, Path)):
        raise DeclarationError(
            "the model of a sweep is a built-in name, a model file or a Scene.", got=shown(model), value=model
        )
    path = Path(model)
    if path.suffix or len(path.parts) > 1 or os.path.isfile(path):
        try:
            return bytes_of(path), f"model{path.suffix}"
        except ModelFileError as error:
            raise ModelFileError.of(error, path.name) from None
    return None, str(model)


def _subject(content: bytes | None, name: str) -> Subject:
    if content is None:
        try:
            return subject_of(Path(), name) if name else Subject(None)
        except GspError as error:
            raise DeclarationError(f"model: {error}") from None
    import tempfile

    with tempfile.TemporaryDirectory(prefix="gsp-") as scratch:
        Path(scratch, name).write_bytes(content)
        return subject_of(Path(scratch), name)


def _refuse_changes(root: Path, fingerprint: Mapping[str, str]) -> None:
    """Raises `DeclarationError` when results in `root` were computed with something else."""
    if not (root / "plan.json").is_file():
        return
    before = kept(root).plan.fingerprint
    changed = [part for part in fingerprint.keys() | before.keys() if fingerprint.get(part) != before.get(part)]
    if changed:
        listed = ", ".join(
            f"{part} ({before.get(part)} then, {fingerprint.get(part)} now)" if part in PACKAGES else part
            for part in sorted(changed)
        )
        raise DeclarationError(
            f"the sweep in {root} was made with other values of: {listed}.",
            "Give another folder, or start anew (anew=True, --anew), which removes what is there.",
        )


def _like_earlier(root: Path, plan: Plan, points: int | None) -> Plan | None:
    """The plan with what a point records and costs from one over the same axes; None when there is none."""
    for folder in folders_of_plans(root):
        other = Store.open(folder).plan
        if set(other.axes) == set(plan.axes):
            block = block_of(plan.shape, points or math.prod(other.block))
            return replace(plan, block=block, variables=other.variables)
    return None


def _measured(plan: Plan, root: Path, points: int | None, elsewhere: Callable[[], Apart] | None) -> Plan:
    """The plan with what a point records and, unless given, as many points a chunk as take about `CHUNK_SECONDS`."""
    record, spent = None, []
    known: dict[int, dict[str, object]] = {}
    first_error: Exception | None = None
    # Spread over the grid, so that a corner where nothing works does not decide.
    tried = dict.fromkeys(round(k * (plan.size - 1) / (TRIED - 1)) for k in range(TRIED))
    variables = dict(plan.variables)
    with nullcontext() if elsewhere is None else elsewhere() as apart:
        for number in tried:
            setting = (replace(plan, variables=variables), root, plan.coordinates(plan.point(number)))
            try:
                found, saved, seconds = (
                    timed_point(*setting) if apart is None else apart.compute(timed_point, *setting)
                )
            except Exception as error:
                first_error = first_error or error
                continue
            record, variables = found, dict(saved)
            known[number] = {name: _kept(name, found[name], v) for name, v in variables.items()}
            spent.append(seconds)
            # The first point pays for what is compiled and kept.
            if points is not None or (len(spent) > 2 and sum(spent[1:]) > CHUNK_SECONDS):
                break
    if record is None:
        assert first_error is not None
        if isinstance(first_error, GspError):
            raise first_error
        what = str(first_error) if isinstance(first_error, ProcessDied) else one_line(first_error)
        raise DeclarationError(
            f"the task {plan.task} failed at all of {len(tried)} points that were tried; at the first: {what}"
        ) from first_error
    a_point = sorted(spent[1:] or spent)[len(spent[1:]) // 2]
    each = points or max(1, round(CHUNK_SECONDS / max(a_point, 1e-9)))
    # What a task calls like an axis is kept under another name: a Dataset has each name once.
    task = plan.task.rpartition(":")[2]
    variables = {
        f"{task}_{name}" if name in plan.axes or name == STATUS else name: variable
        for name, variable in variables.items()
    }
    return replace(plan, block=block_of(plan.shape, each), variables=variables, known=known)


def _kept(name: str, value: object, variable: Variable) -> object:
    return meaning_of(value, variable) if variable.meanings else as_numbers(name, value).tolist()
