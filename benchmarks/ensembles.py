"""Ensembles: microseconds a run of 10^4 sleighs, on one thread and on more, against loops in Python and in SciPy.

The figures to reach: under 10 us a run on two cores, 1.8 times faster on two threads than on one. Everything is
measured in turns in one run. Beside the time on the clock stands that of the processor, all threads together, which
a busy machine disturbs less: what threads add to it is what they lose. `--json` prints the same as data.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from gsp.comparison.work_precision import machine
from gsp.integration.ensemble import integrate_many
from gsp.integration.trajectory import integrate
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.models import load

MEMBERS = 10_000
LOOPED = 300
SCIPY = 10
TURNS = 15
EPSILON = 1e-3
OPTIONS = {"span": (0.0, 20.0), "rtol": 1e-6, "atol": 1e-6}

FIELD = load("chaplygin_sleigh").system
STARTS = np.random.default_rng(0).uniform(-1, 1, (MEMBERS, len(FIELD.states)))
NAMES = [symbol.name for symbol in FIELD.states]


def many(threads: int) -> int:
    """All members in `threads` threads; how many."""
    ensemble = integrate_many(FIELD, STARTS, epsilon=EPSILON, threads=threads, **OPTIONS)
    assert not len(ensemble.failed), ensemble.message
    return len(ensemble)


def loop() -> int:
    """Some members by `integrate`, one after the other."""
    for start in STARTS[:LOOPED]:
        integrate(FIELD, start=dict(zip(NAMES, start)), epsilon=EPSILON, **OPTIONS)
    return LOOPED


def scipy() -> int:
    """A few members by SciPy's Radau with our compiled field and Jacobian."""
    compiled = compile_flow(FIELD)
    p = parameter_vector(FIELD, EPSILON)
    n = compiled.size
    span, rtol, atol = OPTIONS["span"], OPTIONS["rtol"], OPTIONS["atol"]
    for start in STARTS[:SCIPY]:
        solve_ivp(
            lambda t, z: compiled.rates(z, p), span, start, method="Radau", rtol=rtol, atol=atol,
            jac=lambda t, z: compiled.derivatives(z, p).reshape(n, n),
        )  # fmt: skip
    return SCIPY


def measure(turns: int = TURNS) -> dict[str, dict[str, float]]:
    """By way: microseconds a run on the clock and of the processor, and both as ratios to one thread's."""
    cores = os.cpu_count() or 1
    ways: dict[str, Callable[[], int]] = {
        "1 thread": lambda: many(1),
        **({"2 threads": lambda: many(2)} if cores > 1 else {}),
        **({f"{cores} threads": lambda: many(cores)} if cores > 2 else {}),
        "a loop over integrate": loop,
        "a loop over SciPy's Radau": scipy,
    }
    measured: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for turn in range(turns + 1):
        for name, way in ways.items():
            clock, processor = time.perf_counter(), time.process_time()
            runs = way()
            spent = (time.perf_counter() - clock, time.process_time() - processor)
            if turn:
                measured[name].append((1e6 * spent[0] / runs, 1e6 * spent[1] / runs))
    found = {name: np.array(values) for name, values in measured.items()}
    base = found["1 thread"]
    return {
        name: {
            "best_us": float(values[:, 0].min()),
            "median_us": float(np.median(values[:, 0])),
            "processor_us": float(np.median(values[:, 1])),
            "best_ratio_to_one_thread": float(values[:, 0].min() / base[:, 0].min()),
            "ratio_to_one_thread": float(np.median(values[:, 0] / base[:, 0])),
            "processor_ratio_to_one_thread": float(np.median(values[:, 1] / base[:, 1])),
        }
        for name, values in found.items()
    }


def show(rows: dict[str, dict[str, float]]) -> None:
    """Print what `measure` found."""
    steps = integrate_many(FIELD, STARTS, epsilon=EPSILON, **OPTIONS).steps
    print(f"{MEMBERS} sleighs, epsilon = {EPSILON:g}, {OPTIONS}; {steps.mean():.1f} steps a run")
    print(f"{'':26}     us a run: best   median  processor    ratio: best   median  processor")
    for name, row in rows.items():
        print(f"{name:26}{row['best_us']:19.2f} {row['median_us']:8.2f} {row['processor_us']:10.2f}", end="")
        print(
            f" {row['best_ratio_to_one_thread']:14.3g} {row['ratio_to_one_thread']:8.3g} "
            f"{row['processor_ratio_to_one_thread']:10.3g}"
        )


def main() -> None:
    """Print the table, or with `--json` the data."""
    rows = measure()
    if "--json" in sys.argv[1:]:
        print(json.dumps({"machine": machine(), "members": MEMBERS, "turns": TURNS, "rows": rows}, indent=2))
    else:
        print(machine())
        show(rows)


if __name__ == "__main__":
    main()
