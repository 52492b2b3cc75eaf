"""Kernels compiled by a second process, from the last that a report needs to the first, while the report compiles them
from the first on.

Whatever one of the two has compiled the other reads from numba's cache, so that they meet, and each has done its share.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from numba import types

from gsp.kernels.addresses import JET, METHOD
from gsp.kernels.bordered_collocation import border, condense
from gsp.kernels.compilation import address_of
from gsp.kernels.compiling import told_when_compiling
from gsp.kernels.dense_output import interpolate_many
from gsp.kernels.dop853 import dop853
from gsp.kernels.evaluate import evaluate_many, observe
from gsp.kernels.grid import read_grid, runs_along
from gsp.kernels.jets import flow_jet_with_tangents
from gsp.kernels.landing import correct
from gsp.kernels.launch import launch, launch_watched, read_explicit_run, read_run
from gsp.kernels.radau import radau
from gsp.kernels.slow_points import to_tolerance

_REAL, _WHOLE = types.float64, types.int64
_REALS, _ROWS, _LAYERS = (types.Array(_REAL, axes, "C") for axes in (1, 2, 3))
_SHEETS = types.Array(_REAL, 4, "C")
_WHOLES, _TAPE = types.Array(_WHOLE, 1, "C"), types.Array(_WHOLE, 2, "C")
_KEPT = tuple(types.Array(_REAL, axes, "C", readonly=True) for axes in (1, 2, 3))
_RECORD = (_REALS, _ROWS, _LAYERS)
_POINTS = (types.Tuple((_WHOLE, _TAPE, _REALS, _WHOLES, _REAL, _WHOLE)), _ROWS, _ROWS)

IN_ORDER: tuple[tuple[Any, Any], ...] = (
    (evaluate_many, (_WHOLE, _ROWS, _REALS, _ROWS)),
    (runs_along, (_REALS, _REAL, _REAL)),
    (radau, METHOD),
    (launch, (_WHOLES, _REALS)),
    (read_run, (_REALS, _REALS, _ROWS)),
    (dop853, METHOD),
    (launch_watched, (_WHOLES, _WHOLES, _REALS)),
    (interpolate_many, (*_KEPT, _REALS, _ROWS)),
    (flow_jet_with_tangents, JET),
    (to_tolerance, (*_POINTS, _REAL, _WHOLE, _WHOLES, _REALS, _WHOLES)),
    (
        condense,
        (
            types.UniTuple(_WHOLE, 3),
            _REALS,
            _REAL,
            types.Tuple((_REALS, _ROWS, _LAYERS)),
            types.Tuple((_ROWS, _REALS)),
            _WHOLE,
            _LAYERS,
            _LAYERS,
        ),
    ),
    (
        border,
        (
            _LAYERS,
            _LAYERS,
            types.Tuple((_ROWS, _ROWS, _ROWS, _LAYERS, _ROWS)),
            _REALS,
            types.Tuple((_LAYERS, _SHEETS, _ROWS)),
        ),
    ),
    (observe, (_WHOLE, _KEPT[1], _REAL, _KEPT[0], _ROWS)),
    (read_explicit_run, (_WHOLES, _REALS, _REALS, _ROWS)),
    (read_grid, (*_RECORD, _REALS, _WHOLE, _ROWS)),
    (
        correct,
        (_WHOLES, _REALS, types.UniTuple(_REAL, 2), types.Tuple(_RECORD), _REALS, _ROWS, _WHOLES, _REALS),
    ),
)
"""What `gsp report` runs as it comes to be needed: for the arguments that it has there, or by a signature's address."""


@contextmanager
def compiled_ahead() -> Iterator[None]:
    """Have a second process compile `IN_ORDER` from its end, from when this one compiles a kernel to the context's end.

    Where no process can be begun this one compiles alone.
    """
    helper: Any = multiprocessing.get_context("spawn").Process(target=_help, daemon=True)

    def begin() -> None:
        with suppress(OSError):
            helper.start()

    with told_when_compiling(begin):
        try:
            yield
        finally:
            if helper.pid is not None:
                helper.kill()
                helper.join()


def compile_backwards() -> None:
    """Compile `IN_ORDER`, the last first; what is on disk is read from there."""
    for kernel, signature in reversed(IN_ORDER):
        if isinstance(signature, tuple):
            kernel.compile(signature)
        else:
            address_of(kernel, signature)


def _help() -> None:
    """What the second process does; the first's Ctrl-C is to answer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    compile_backwards()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
