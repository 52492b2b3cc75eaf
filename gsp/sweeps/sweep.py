"""`sweep`: a task at every point of a grid, kept on disk and resumed where it stopped; `Sweep`: what is there of it."""

from __future__ import annotations

import json
import math
import os
import shutil
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsp.errors import DeclarationError, GspError, ModelFileError, OutputError, one_line
from gsp.readers.toml import bytes_of
from gsp.results.card import Card
from gsp.sweeps.execution import (
    Apart,
    ProcessDied,
    connect,
    one_process,
    one_worker,
    run_here,
    run_in_processes,
    run_on_cluster,
)
from gsp.sweeps.fingerprint import PACKAGES, fingerprint_of
from gsp.sweeps.ledger import is_gone, this_host, write_whole
from gsp.sweeps.plan import Plan, Variable, block_of, check_axes
from gsp.sweeps.store import STATUS, Store, zarr_or_remedy
from gsp.sweeps.tasks import as_numbers, check_options, meaning_of, name_of
from gsp.sweeps.worker import Subject, subject_of, timed_point
from gsp.systems.arguments import check_flag, check_progress, check_whole, shown

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene

# Seconds of work in a chunk, and how many points are tried for one that tells what a point records.
CHUNK_SECONDS = 1.0
TRIED = 16


class Sweep(Card):
    """What is there of the sweep in `folder`, which may still be running elsewhere.

    Raises `OutputError` when the folder holds none.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            saved = json.loads((self.folder / "plan.json").read_text(encoding="utf-8"))
            data = Path(saved["data"]).name
        except (OSError, ValueError, KeyError, TypeError):
            raise OutputError(
                f"{self.folder} holds no sweep.", "Start one with sweep(..., into=...)."
            ) from None
        self._store = Store.open(self.folder / data)

    @property
    def plan(self) -> Plan:
        """The task, its axes and its chunks."""
        return self._store.plan

    @property
    def size(self) -> int:
        """Number of points."""
        return self.plan.size

    @property
    def computed(self) -> int:
        """Number of points in the chunks that are done, the failed ones among them."""
        plan = self.plan
        return sum(math.prod(s.stop - s.start for s in plan.slices(c)) for c in self._store.ledger.done())

    @property
    def failed(self) -> int:
        """Number of points whose task raised an error or took its process with it."""
        return sum(self._store.ledger.done().values())

    @property
    def is_complete(self) -> bool:
        """Whether every chunk is done."""
        return len(self._store.ledger.done()) == self.plan.chunks

    def failures(self, most: int = 100) -> list[dict[str, object]]:
        """Coordinates, status and message of up to `most` points that failed."""
        return self._store.failures(check_whole(most, what="most"))

    def to_xarray(self) -> Any:
        """The results as a labelled `xarray.Dataset`, which reads from disk what it is asked for.

        `status` tells for every point whether it was computed; where it was not, numbers are nan and codes -1. Raises
        `OutputError` where xarray is not installed.
        """
        return self._store.to_xarray()

    def as_dataset(self) -> Any:
        """Deprecated: the name that `to_xarray` had in 0.2.0."""
        warnings.warn("Sweep.as_dataset is deprecated. Write to_xarray.", DeprecationWarning, stacklevel=2)
        return self.to_xarray()

    def strike_damaged(self) -> int:
        """Take out the chunks that differ from their checksums, for the next run to make; how many there were."""
        damaged = self._store.damaged()
        for chunk in damaged:
            self._store.ledger.strike(chunk)
        return len(damaged)

    def __repr__(self) -> str:
        return (
            f"Sweep({self.plan.task} over {', '.join(self.plan.axes)}: {self.computed} of {self.size} points)"
        )

    def __str__(self) -> str:
        plan = self.plan
        lines = [
            f"{plan.task}{f' of {plan.model}' if plan.model else ''}: {self.computed:,} of {self.size:,} points"
        ]
        for name, values in plan.axes.items():
            lines.append(f"  {name}: {len(values)} values from {min(values):.6g} to {max(values):.6g}")
        if self.failed:
            lines.append(f"  {self.failed:,} failed; the first:")
            for failure in self.failures(3):
                where = ", ".join(f"{name} = {failure[name]:.6g}" for name in plan.axes)
                lines.append(f"    {where}: {failure['message']}")
        return "\n".join(lines)


def sweep(
    task: str | Callable[..., Any],
    *,
    over: Mapping[str, Sequence[float]],
    into: str | Path,
    model: str | Path | Scene | None = None,
    options: Mapping[str, object] | None = None,
    workers: int | None = None,
    client: Any = None,
    anew: bool = False,
    points_per_chunk: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Sweep:
    """Do `task` at every point of the grid `over`, {axis: values}, and keep the results in the folder `into`.

    `task` is a verb of the package (integrate, classify, certify, compare, choose, failure_map, canard_value,
    periodic_orbit), given by name or as it is, with `options` for it; or a function from a module. `model` is a
    built-in name, a model file or a `Scene`. An axis is "epsilon", "tolerance", a parameter, or a state, whose start it
    moves. A function takes the scene at the point, or the coordinates by name when there is no model, and gives a
    mapping of names to numbers or arrays.

    The same call goes on where an earlier one stopped, and computes what is new when the axes have changed; no point is
    computed twice. A changed model, task or package is refused unless `anew`, which removes what is there. `workers`
    processes share the work, all cores by default; 1 stays in this process. `client` is a Dask client or the address of
    its scheduler. Any number of such calls, on any hosts that see the folder, share the work too. Results do not depend
    on who computes them.

    A point whose task raises an error, or takes a worker's process with it, is kept with its message; it stops nothing.
    Ctrl-C and a full disk leave a whole store. Raises `DeclarationError` for a call that is not well formed,
    `OutputError` for a folder that cannot be used.
    """
    zarr_or_remedy()
    check_progress(progress)
    check_flag(anew, what="anew")
    count = (os.cpu_count() or 1) if workers is None else check_whole(workers, what="workers", least=1)
    if workers is not None and client is not None:
        raise DeclarationError(
            "workers are processes of this machine, and a client has its own.", "Give one of the two."
        )
    if points_per_chunk is not None:
        check_whole(points_per_chunk, what="points_per_chunk", least=1)
    if not isinstance(into, (str, os.PathLike)) or not os.fspath(into):
        raise DeclarationError("into is the path of a folder.", got=shown(into), value=into)
    if not isinstance(client, (str, type(None))) and not hasattr(client, "get_executor"):
        raise DeclarationError(
            "client is a Dask client or the address of its scheduler.", got=shown(client), value=client
        )
    if isinstance(client, str):
        # Before anything is planned: an address may be wrong.
        connect(client).close()
    root = Path(into)
    setting = (name_of(task), check_axes(over), root, model, _plain(options), anew, points_per_chunk)
    try:
        with connect(client) if isinstance(client, str) else nullcontext(client) as there:
            if there is not None:
                store = _prepared(*setting, lambda: one_worker(there))
            else:
                store = _prepared(*setting, None if count == 1 else one_process)
            # Chunks that others enter between these looks are found by all.
            if not Sweep(root).is_complete:
                if there is not None:
                    run_on_cluster(store, there, progress)
                elif count == 1:
                    run_here(store, progress)
                else:
                    run_in_processes(store, min(count, store.plan.chunks), progress)
                store.tidy()
                _tidy(root)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the same call goes on with the sweep in {root}") from None
    except OSError as error:
        raise OutputError(
            f"the work on the sweep in {root} stopped: {error.strerror or error}.",
            "What is entered there is kept, and the same call goes on with it.",
        ) from error
    return Sweep(root)


def resume(
    folder: str | Path, *, workers: int | None = None, client: Any = None, progress: Any = None
) -> Sweep:
    """Go on with the sweep in `folder` as it was planned, or join those who are at work on it."""
    plan = Sweep(folder).plan
    return sweep(
        plan.task,
        over=plan.axes,
        into=folder,
        model=Path(folder, plan.model) if Path(folder, plan.model).is_file() else plan.model or None,
        options=plan.options,
        workers=workers,
        client=client,
        progress=progress,
    )


def _prepared(
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
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{root} cannot be made: {error.strerror}.", "Give another folder.") from None
    entries = [path for path in root.iterdir() if not path.name.endswith(".partial")]
    if entries and not (root / "plan.json").is_file():
        raise OutputError(f"{root} holds other files than those of a sweep.", "Give an empty folder.")
    check_options(task, options)
    content, name = _model(model)
    subject = _subject(content, name)
    subject.check(axes, options, task)
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
        if content is not None:
            write_whole(root / name, content)
        about = {"task": task, "model": name, **{k: v for k, v in fingerprint.items() if k in PACKAGES}}
        building = root / f"{plan.name}.{this_host()}.{os.getpid()}.partial"
        try:
            ready = _like_earlier(root, plan, points) or _measured(plan, root, points, elsewhere)
        except BaseException:
            if content is not None and not (root / "plan.json").is_file():
                (root / name).unlink(missing_ok=True)
            raise
        Store(building, ready).create(about)
        try:
            building.rename(folder)
        except OSError:
            # Another process has planned the same sweep meanwhile.
            shutil.rmtree(building)
    if not (root / "plan.json").is_file() or Sweep(root).plan.name != plan.name:
        write_whole(root / "plan.json", json.dumps({"data": plan.name}).encode())
    return Store.open(folder)


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


def _plain(options: Mapping[str, object] | None) -> dict[str, object]:
    """The options as they come back from the plan; raises `DeclarationError` unless they are numbers and text."""
    if options is None or isinstance(options, Mapping):
        with suppress(TypeError, ValueError):
            return json.loads(json.dumps(dict(options or {}), allow_nan=False))
    raise DeclarationError(
        "options maps names to numbers, text and sequences of them.", got=shown(options), value=options
    )


def _refuse_changes(root: Path, fingerprint: Mapping[str, str]) -> None:
    """Raises `DeclarationError` when results in `root` were computed with something else."""
    if not (root / "plan.json").is_file():
        return
    before = Sweep(root).plan.fingerprint
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


def _tidy(root: Path) -> None:
    """Remove what processes that were killed while they planned have left."""
    for left in root.glob("*.partial"):
        if not left.is_dir():
            left.unlink(missing_ok=True)
            continue
        host, _, process = left.stem.removeprefix(left.name.partition(".")[0] + ".").rpartition(".")
        if is_gone(host, process):
            shutil.rmtree(left, ignore_errors=True)


def _like_earlier(root: Path, plan: Plan, points: int | None) -> Plan | None:
    """The plan with what a point records and costs from one over the same axes; None when there is none."""
    for folder in sorted(root.glob("data-*")):
        if (folder / "plan.json").is_file():
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
