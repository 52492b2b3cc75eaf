"""A plan: one task over a grid of numbers, what it records at every point, and the chunks in which it is done."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property

import numpy as np

from gsp.errors import DeclarationError
from gsp.systems.arguments import as_float, check_each, check_text, shown

# A point that was not computed, was computed, raised an error, or took the process that computed it down with it.
MEANINGS = ("not computed", "computed", "failed", "died")
NOT_COMPUTED, COMPUTED, FAILED, DIED = range(4)
FORMAT = 1


@dataclass(frozen=True)
class Variable:
    """What a task records at every point: a number, or an array over `axes` of the given labels.

    With `meanings` it is a code, the place of its meaning in the list, and -1 where it was not computed. `recorded` is
    what the task calls it.
    """

    recorded: str
    axes: Mapping[str, tuple[str | int, ...]] = field(default_factory=dict)
    meanings: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(map(len, self.axes.values()))

    @property
    def dtype(self) -> np.dtype:
        """Doubles, or small integers for a code."""
        return np.dtype(np.int8 if self.meanings else np.float64)

    @property
    def missing(self) -> float:
        """What stands where nothing was computed."""
        return -1 if self.meanings else math.nan


@dataclass(frozen=True)
class Plan:
    """One `task` with its `options` over `axes`, {name: values}; the last axis runs fastest.

    `task` is a verb of the package or "module:function", `model` a built-in name, the name of a file beside the plan,
    or empty. A chunk is a block of `block` points along the axes. `variables` is what a point records. `fingerprint`
    tells by parts what the results depend on besides the axes. `known` are points that were computed to plan.
    """

    task: str
    options: Mapping[str, object]
    model: str
    axes: Mapping[str, tuple[float, ...]]
    block: tuple[int, ...]
    variables: Mapping[str, Variable]
    fingerprint: Mapping[str, str]
    known: Mapping[int, Mapping[str, object]] = field(default_factory=dict)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(map(len, self.axes.values()))

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    @cached_property
    def blocks(self) -> tuple[int, ...]:
        """Number of blocks along each axis."""
        return tuple(-(-n // b) for n, b in zip(self.shape, self.block))

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return math.prod(self.blocks)

    @cached_property
    def name(self) -> str:
        """The name of the folder for its results: the same for the same task, options, model and axes."""
        content = json.dumps([self.task, self.options, self.model, self.axes], sort_keys=False)
        return f"data-{hashlib.sha256(content.encode()).hexdigest()[:12]}"

    def place(self, chunk: int) -> tuple[int, ...]:
        """The place of a chunk among the blocks."""
        return tuple(map(int, np.unravel_index(chunk, self.blocks)))

    def slices(self, chunk: int) -> tuple[slice, ...]:
        """The points of a chunk along each axis."""
        corners = [k * b for k, b in zip(self.place(chunk), self.block)]
        return tuple(slice(c, min(c + b, n)) for c, b, n in zip(corners, self.block, self.shape))

    def points(self, chunk: int) -> list[tuple[int, ...]]:
        """Indices along the axes of the points of a chunk, the last axis fastest."""
        return list(itertools.product(*(range(s.start, s.stop) for s in self.slices(chunk))))

    def coordinates(self, point: tuple[int, ...]) -> dict[str, float]:
        """The values along the axes at a point."""
        return {name: values[i] for (name, values), i in zip(self.axes.items(), point)}

    def number(self, point: tuple[int, ...]) -> int:
        """The place of a point among all, the last axis fastest."""
        return int(np.ravel_multi_index(point, self.shape))

    def point(self, number: int) -> tuple[int, ...]:
        """The indices along the axes of the point with this number."""
        return tuple(map(int, np.unravel_index(number, self.shape)))

    def chunk_of(self, point: tuple[int, ...]) -> int:
        """The chunk that holds a point."""
        place = tuple(i // b for i, b in zip(point, self.block))
        return int(np.ravel_multi_index(place, self.blocks))

    def as_json(self) -> str:
        """The plan as text; numbers come back as they are."""
        return json.dumps({"format": FORMAT, **asdict(self)}, indent=1)


def read_plan(text: str) -> Plan:
    """The plan of `Plan.as_json`; raises `DeclarationError` for text that is none."""
    try:
        content = json.loads(text)
        if content.pop("format") != FORMAT:
            raise DeclarationError(
                "the plan was written by another version of the package.", "Start the sweep anew."
            )
        variables = {
            name: Variable(v["recorded"], {k: tuple(w) for k, w in v["axes"].items()}, tuple(v["meanings"]))
            for name, v in content.pop("variables").items()
        }
        return Plan(
            **{
                **content,
                "axes": {name: tuple(map(float, values)) for name, values in content["axes"].items()},
                "block": tuple(content["block"]),
                "known": {int(number): record for number, record in content["known"].items()},
            },
            variables=variables,
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, DeclarationError):
            raise
        raise DeclarationError(
            f"the plan of the sweep cannot be read ({error}).", "Start the sweep anew."
        ) from None


def check_axes(over: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """The axes of a sweep; raises `DeclarationError` unless each is a sequence of different finite numbers."""
    if not isinstance(over, Mapping) or not over:
        raise DeclarationError(
            'over maps each axis to its values, as in {"epsilon": (0.01, 0.02)}.', got=shown(over), value=over
        )
    axes = {}
    for name, values in over.items():
        check_text(name, what="the name of an axis")
        what = f"over[{shown(name)}]"
        found = check_each(values, as_float, what=what, be="a sequence of finite numbers")
        if not found or not all(map(math.isfinite, found)):
            raise DeclarationError(
                f"{what} is a sequence of finite numbers, one at least.", got=shown(values), value=values
            )
        twice = [value for value, next_one in itertools.pairwise(sorted(found)) if value == next_one]
        if twice:
            raise DeclarationError(f"{what} has the value {twice[0]:g} twice.", "Give each value once.")
        axes[name] = found
    return axes


def block_of(shape: tuple[int, ...], points: int) -> tuple[int, ...]:
    """The block of about `points` points: whole along the last axes, a part of one, one point along the others."""
    # More chunks make the folder slow to list; a chunk then holds more points.
    chunk_size = max(points, -(-math.prod(shape) // 100_000))
    block = [1] * len(shape)
    for axis in reversed(range(len(shape))):
        block[axis] = min(shape[axis], max(1, chunk_size))
        chunk_size //= block[axis]
        if block[axis] < shape[axis]:
            break
    return tuple(block)
