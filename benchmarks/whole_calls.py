"""Whole calls as a user writes them: `integrate(..., at=times)`, and the reduced flow in place of the full one.

    python benchmarks/whole_calls.py [--quick]

Everything is a ratio of least times that alternate in this run. A grid should cost little beside the run without one,
and the reduced model, at its own error, less than the full one: at most 0.8 on explicit branches, 1 on implicit ones.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable

import numpy as np
from problems import PROBLEMS

import gsp
from gsp.comparison.work_curves import work_precision
from gsp.comparison.work_runs import ModelKind
from gsp.models import load
from gsp.scenes.study import study

RTOLS = (1e-3, 1e-5, 1e-7)
ROUNDS, QUICK_ROUNDS = 40, 10
# What a grid of a hundred times may take, over the run without one.
GRID_GOAL = 1.5
SCENES = (
    "chaplygin_sleigh", "knife_edge", "michaelis_menten", "davis_skodje", "lindemann", "van_der_pol",
    "fitzhugh_nagumo", "koper",
)  # fmt: skip
QUICK_SCENES = ("michaelis_menten", "van_der_pol")
GOALS = {True: 0.8, False: 1.0}


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


def reductions(names: tuple[str, ...] = SCENES) -> list[dict]:
    """By scene: the reduced order 1 over the fastest full run at the error that is the reduced model's own."""
    rows = []
    for name in names:
        scene = load(name)
        is_explicit = study(scene).branch.is_explicit
        try:
            found = work_precision(
                scene, epsilon=scene.epsilon, orders=(1,), peers=(), rtols=tuple(10.0**-k for k in range(2, 10))
            )
        except gsp.GspError as failure:
            print(f"    {name}: {str(failure)[:90]}")
            continue
        model = found["reduced 1"]
        # Where the tolerance has stopped to matter, but for a twentieth.
        error = 1.05 * model.floor
        full = found.fastest(error, kind=ModelKind.FULL)
        if full is None:
            continue
        seconds = model.seconds_at(error), full.seconds_at(error)
        rows.append(
            {
                "scene": name, "explicit": is_explicit, "error": error, "full": full.label,
                "full_us": 1e6 * seconds[1], "reduced_us": 1e6 * seconds[0], "ratio": seconds[0] / seconds[1],
                "goal": GOALS[is_explicit],
            }
        )  # fmt: skip
    return rows


def measure(*, quick: bool) -> dict[str, list[dict]]:
    """Both tables."""
    return {
        "grids": grids(QUICK_ROUNDS if quick else ROUNDS),
        "reductions": reductions(QUICK_SCENES if quick else SCENES),
    }


def show(data: dict[str, list[dict]]) -> None:
    """Print them, each with its worst cell."""
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
    print("\nReduced order 1 over the fastest full run, whole calls at the reduced model's own error")
    for row in data["reductions"]:
        verdict = "ok   " if row["ratio"] <= row["goal"] else "SHORT"
        kind = "explicit" if row["explicit"] else "implicit"
        print(
            f"{verdict} {row['scene']:20} {kind}  error {row['error']:.1e}   full {row['full_us']:7.1f} us "
            f"({row['full']})   reduced {row['reduced_us']:7.1f} us   ratio {row['ratio']:.2f}, wanted {row['goal']:g}"
        )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few rounds, two scenes")
    warnings.filterwarnings("ignore")
    show(measure(quick=parser.parse_args().quick))


if __name__ == "__main__":
    main()
