"""Whole calls as a user writes them: `integrate(..., at=times)`.

    python benchmarks/whole_calls.py [--quick]

Everything is a ratio of least times that alternate in this run. A grid should cost little beside the run without one.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable

import numpy as np
from problems import PROBLEMS

import gsp

RTOLS = (1e-3, 1e-5, 1e-7)
ROUNDS, QUICK_ROUNDS = 40, 10
# What a grid of a hundred times may take, over the run without one.
GRID_GOAL = 1.5


def least(solves: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """The least seconds of each, in turns."""
    found = dict.fromkeys(solves, float("inf"))
    for _ in range(rounds):
        for name, solve in solves.items():
            begun = time.perf_counter()
            solve()
            found[name] = min(found[name], time.perf_counter() - begun)
    return found


def grids(rounds: int = ROUNDS) -> list[dict]:
    """By problem and tolerance: the call with `at=` over the same without, and over one that is read by `.at`."""
    rows = []
    for problem in PROBLEMS:
        times = problem.times
        for rtol in RTOLS:

            def solve(at: np.ndarray | None = None, problem=problem, rtol=rtol) -> gsp.Trajectory:
                return gsp.integrate(
                    problem.field, start=problem.start, span=problem.span, epsilon=problem.epsilon,
                    rtol=rtol, atol=rtol * problem.floor, at=at,
                )  # fmt: skip

            def grid(solve=solve, times=times) -> object:
                return solve(times)

            def read(solve=solve, times=times) -> object:
                return solve().at(times)

            found = least({"plain": solve, "grid": grid, "read": read}, rounds)
            rows.append(
                {
                    "problem": problem.name,
                    "rtol": rtol,
                    "grid_us": 1e6 * found["grid"],
                    "over_plain": found["grid"] / found["plain"],
                    "over_read": found["grid"] / found["read"],
                    # Every step that a grid adds would show here.
                    "steps_added": solve(times).stats.steps - solve().stats.steps,
                }
            )
    return rows


def measure(*, quick: bool) -> dict[str, list[dict]]:
    """By problem and tolerance."""
    return {"grids": grids(QUICK_ROUNDS if quick else ROUNDS)}


def show(data: dict[str, list[dict]]) -> None:
    """Print them with the worst cells."""
    rows = data["grids"]
    print(
        "\nA call with at= (a hundred times): us; over the call without; over integrate().at(times); steps added"
    )
    for name in dict.fromkeys(row["problem"] for row in rows):
        cells = [
            f"{row['rtol']:.0e}: {row['grid_us']:6.1f} {row['over_plain']:5.2f} {row['over_read']:5.2f} "
            f"{row['steps_added']:+d}"
            for row in rows
            if row["problem"] == name
        ]
        print(f"  {name:24}" + "   ".join(cells))
    for key, what in (("over_plain", "without a grid"), ("over_read", ".at(times)")):
        ratios = [row[key] for row in rows]
        mean = float(np.exp(np.mean(np.log(ratios))))
        worst = max(rows, key=lambda row: row[key])
        verdict = "ok   " if mean <= GRID_GOAL else "SHORT"
        print(
            f"{verdict} over the call {what}: geometric mean {mean:.2f}, most {worst[key]:.2f} "
            f"({worst['problem']} at {worst['rtol']:.0e})"
        )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few rounds")
    warnings.filterwarnings("ignore")
    show(measure(quick=parser.parse_args().quick))


if __name__ == "__main__":
    main()
