"""`sweep`: a task at every point of a grid, kept on disk and resumed where it stopped; `Sweep`: what is there of it."""

from __future__ import annotations

import json
import math
import os
import shutil
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsp.errors import DeclarationError, OutputError
from gsp.results.card import Card
from gsp.sweeps.execution import (
    connect,
    one_process,
    one_worker,
    run_here,
    run_in_processes,
    run_on_cluster,
)
from gsp.sweeps.ledger import is_gone
from gsp.sweeps.plan import Plan, check_axes
from gsp.sweeps.planning import prepared
from gsp.sweeps.store import kept, zarr_or_remedy
from gsp.sweeps.tasks import name_of
from gsp.systems.arguments import check_flag, check_progress, check_whole, shown

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


class Sweep(Card):
    """What is there of the sweep in `folder`, which may still be running elsewhere.

    Raises `OutputError` when the folder holds none.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._store = kept(self.folder)

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

    `task` is a verb of the package for which its page lists what is recorded, such as `compare`, given by name or as
    it is, with `options` for it; or a function from a module. `model` is a built-in name, a model file or a `Scene`.
    An axis is "epsilon", "tolerance", a parameter, or a state, whose start it moves. A function takes the scene at
    the point, or the coordinates by name when there is no model, and gives a mapping of names to numbers or arrays.

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
                store = prepared(*setting, lambda: one_worker(there))
            else:
                store = prepared(*setting, None if count == 1 else one_process)
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


def _plain(options: Mapping[str, object] | None) -> dict[str, object]:
    """The options as they come back from the plan; raises `DeclarationError` unless they are numbers and text."""
    if options is None or isinstance(options, Mapping):
        with suppress(TypeError, ValueError):
            return json.loads(json.dumps(dict(options or {}), allow_nan=False))
    raise DeclarationError(
        "options maps names to numbers, text and sequences of them.", got=shown(options), value=options
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
