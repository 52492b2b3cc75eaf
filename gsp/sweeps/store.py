"""The results of one plan on disk: a zarr group with an array for each variable, of which a chunk is one block each."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gsp.errors import OutputError
from gsp.results.table import library
from gsp.sweeps.ledger import Entry, Ledger, write_whole
from gsp.sweeps.plan import DIED, FAILED, MEANINGS, Plan, Variable, read_plan

STATUS = "status"
_STATUS = Variable(STATUS, meanings=MEANINGS)


class Store:
    """The results of `plan` in `folder`."""

    def __init__(self, folder: Path, plan: Plan) -> None:
        self.folder = folder
        self.plan = plan
        self.ledger = Ledger(folder)

    @classmethod
    def open(cls, folder: Path) -> Store:
        """The store in a folder; raises `OutputError` when there is none."""
        try:
            return cls(folder, read_plan((folder / "plan.json").read_text(encoding="utf-8")))
        except FileNotFoundError:
            raise OutputError(f"{folder} holds no sweep.", "Start one there.") from None

    def create(self, about: Mapping[str, str]) -> None:
        """Make the arrays, every value missing, and the ledger; the plan comes last."""
        zarr = zarr_or_remedy()
        self.folder.mkdir(exist_ok=True)
        self.ledger.create()
        group = zarr.create_group(self._arrays, overwrite=True, attributes=dict(about))
        plan = self.plan
        for name, values in plan.axes.items():
            axis = group.create_array(name, shape=(len(values),), dtype="f8", dimension_names=[name])
            axis[:] = np.array(values)
        for name, variable in self.variables.items():
            group.create_array(
                name,
                shape=(*plan.shape, *variable.shape),
                chunks=(*plan.block, *(max(n, 1) for n in variable.shape)),
                dtype=variable.dtype,
                fill_value=variable.missing if name != STATUS else 0,
                dimension_names=[*plan.axes, *variable.axes],
                attributes=_flags(variable),
                # A block of missing values is a result too.
                config={"write_empty_chunks": True},
            )
        write_whole(self.folder / "plan.json", plan.as_json().encode())

    @property
    def variables(self) -> dict[str, Variable]:
        """What is recorded at each point, with whether it was computed."""
        return {**self.plan.variables, STATUS: _STATUS}

    def write(self, chunk: int, values: Mapping[str, np.ndarray], messages: Mapping[int, str]) -> None:
        """Write the blocks of a chunk, then its entry in the ledger."""
        where = self.plan.slices(chunk)
        # Whether a point was computed is written after what was.
        for name in self.variables:
            self._opened[name][where] = values[name]
        self.ledger.enter(chunk, Entry(self._checksum(chunk), messages))

    def read(self, chunk: int) -> dict[str, np.ndarray]:
        """The blocks of a chunk by variable."""
        where = self.plan.slices(chunk)
        return {name: np.asarray(self._opened[name][where]) for name in self.variables}

    def empty(self, chunk: int) -> dict[str, np.ndarray]:
        """Blocks for a chunk without any value."""
        lengths = tuple(s.stop - s.start for s in self.plan.slices(chunk))
        blocks = {name: np.full((*lengths, *v.shape), v.missing, v.dtype) for name, v in self.variables.items()}
        blocks[STATUS][...] = 0
        return blocks

    def damaged(self) -> list[int]:
        """The chunks whose files are not those that the ledger knows."""
        found = []
        for chunk in sorted(self.ledger.done()):
            entry = self.ledger.entry(chunk)
            if entry is None or entry.checksum != self._checksum(chunk):
                found.append(chunk)
        return found

    def failures(self, most: int) -> list[dict[str, object]]:
        """Coordinates, status and message of up to `most` points that failed."""
        found: list[dict[str, object]] = []
        for chunk, count in sorted(self.ledger.done().items()):
            entry = self.ledger.entry(chunk) if count else None
            if entry is None:
                continue
            status = self.read(chunk)[STATUS].ravel()
            points = self.plan.points(chunk)
            for number, message in entry.messages.items():
                if len(found) == most:
                    return found
                code = int(status[number])
                status_word = MEANINGS[code] if code in (FAILED, DIED) else "unknown"
                found.append(
                    {**self.plan.coordinates(points[number]), "status": status_word, "message": message}
                )
        return found

    def tidy(self) -> None:
        """Remove what processes that were killed have left half written; every chunk is done."""
        self.ledger.tidy()
        for left in self._arrays.rglob("*.partial"):
            left.unlink(missing_ok=True)

    def to_xarray(self) -> Any:
        """The results as a labelled xarray Dataset that reads what it is asked for."""
        xarray = library("xarray", "a Dataset is made by", extra="sweeps")
        found = xarray.open_zarr(self._arrays, consolidated=False, chunks=None)
        labels = {axis: list(values) for v in self.plan.variables.values() for axis, values in v.axes.items()}
        return found[list(self.variables)].assign_coords(labels)

    @property
    def _arrays(self) -> Path:
        return self.folder / "points.zarr"

    @cached_property
    def _opened(self) -> dict[str, Any]:
        zarr = zarr_or_remedy()
        # What is kept of a group is what its metadata say: a missing block reads as missing values.
        group = zarr.open_group(self._arrays, mode="r+")
        return {name: group[name].with_config({"write_empty_chunks": True}) for name in self.variables}

    def _checksum(self, chunk: int) -> str:
        total = hashlib.sha256()
        place = "/".join(map(str, self.plan.place(chunk)))
        for name, variable in sorted(self.variables.items()):
            path = self._arrays / name / "c" / place / "/".join("0" * len(variable.shape))
            try:
                total.update(path.read_bytes())
            except FileNotFoundError:
                return "missing"
        return total.hexdigest()


def _flags(variable: Variable) -> dict[str, object]:
    """The meanings of a code, as the CF conventions write them."""
    if not variable.meanings:
        return {}
    words = [meaning.replace(" ", "_") for meaning in variable.meanings]
    return {"flag_values": list(range(len(words))), "flag_meanings": " ".join(words)}


def zarr_or_remedy() -> Any:
    """The package zarr; raises `OutputError` with the remedy where it is not installed."""
    return library("zarr", "sweeps are kept by", extra="sweeps")


def folders_of_plans(root: Path) -> list[Path]:
    """The folders of the plans of the sweep in `root`, in order, and none that is half built."""
    return sorted(path.parent for path in root.glob("data-*/plan.json") if path.parent.suffix != ".partial")


def kept(root: Path) -> Store:
    """The store that the sweep in `root` fills now; raises `OutputError` when the folder holds none."""
    try:
        saved = json.loads((root / "plan.json").read_text(encoding="utf-8"))
        data = Path(saved["data"]).name
    except (OSError, ValueError, KeyError, TypeError):
        raise OutputError(
            f"{root} holds no sweep.", "Start one with `gsp sweep PLAN -o FOLDER`, or sweep(..., into=...)."
        ) from None
    return Store.open(root / data)
