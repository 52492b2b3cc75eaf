"""Least time to reach an error: `gsp.integrate` against every installed peer, on nine problems, in one run.

    python benchmarks/integrators.py [--quick] [--compiled] [--ours] [--only NAME] [--json FILE]

Each integrator runs over a ladder of tolerances; the time at a target error is interpolated on its ladder. Errors are
taken at the end of the span (task "end", no output before it) and over an output grid (task "grid", ours by dense
output). Runs of all integrators alternate, and the least of several times counts: read the ratios, not the seconds.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import platform
import time
import warnings
from collections import defaultdict
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

import numpy as np
from peers import PEERS, Problem
from problems import PROBLEMS

import gsp

TARGETS = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
# Worst acceptable geometric means over the stiff problems, by target.
GOALS = {1e-3: 2.5, 1e-5: 2.5, 1e-7: 3.0, 1e-9: 4.0}
OURS = "gsp"
# A peer's ladder ends where one solve takes longer.
PATIENCE = 0.2
ENOUGH = 300e-6


def ours(problem: Problem, method: gsp.Method | None):
    """Our side: the public call, and `.at` for the grid."""

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        trajectory = gsp.integrate(
            problem.field,
            start=problem.start,
            span=problem.span,
            epsilon=problem.epsilon,
            rtol=rtol,
            atol=rtol * problem.floor,
            method=method,
            dense=len(times) > 1,
        )
        if not trajectory.status.ok:
            raise ArithmeticError(trajectory.message)
        return trajectory.y[:, -1:] if len(times) == 1 else trajectory.at(times)

    return solve


def reference(problem: Problem) -> tuple[np.ndarray, float]:
    """States on the grid at the tightest tolerance, every time hit by a step, and their distance from a second
    route."""
    routes = [gsp.Method.RADAU13, gsp.Method.RADAU9]
    if not problem.is_stiff:
        routes[1] = gsp.Method.DOP853
    states = [
        gsp.integrate(
            problem.field,
            start=problem.start,
            span=problem.span,
            epsilon=problem.epsilon,
            rtol=1e-13,
            atol=1e-13 * problem.floor,
            at=problem.times,
            method=method,
        ).y
        for method in routes
    ]
    return states[0], distance(problem, states[1], states[0])


def distance(problem: Problem, states: np.ndarray, exact: np.ndarray, *, at_end: bool = False) -> float:
    """Largest error over components and times, relative as the problem says."""
    scale = np.abs(exact) if problem.pointwise else np.abs(exact).max(axis=1, keepdims=True)
    errors = np.abs(states - exact) / scale if states.shape == exact.shape else None
    if at_end:
        end = scale[:, -1:] if problem.pointwise else scale
        errors = np.abs(states[:, -1:] - exact[:, -1:]) / end
    return float("nan") if errors is None or not np.isfinite(errors).all() else float(errors.max())


def ladder(*, halves: bool) -> list[float]:
    """Tolerances from 1e-2 to 1e-13."""
    exponents = np.arange(-2.0, -13.1, -0.5 if halves else -1.0)
    return [float(10.0**e) for e in exponents]


def measure(problem: Problem, exact: np.ndarray, solvers: dict, repeats: int) -> dict:
    """`rows[task][name]` = [(rtol, error, seconds), ...]; all rungs of all solvers alternate."""
    rows: dict = {"end": defaultdict(list), "grid": defaultdict(list)}
    for task, times in (("end", problem.times[-1:]), ("grid", problem.times)):
        jobs = []
        for name, (solve, rungs) in solvers.items():
            for rtol in rungs:
                try:
                    solve(rtol, times)
                    begun = time.perf_counter()
                    states = solve(rtol, times)
                    seconds = time.perf_counter() - begun
                except Exception as failure:
                    if name == OURS:
                        raise
                    last = failure
                    if rtol == rungs[0]:
                        print(f"    {name}: {type(last).__name__} {str(last)[:90]}")
                    continue
                error = distance(problem, states, exact, at_end=task == "end")
                count = max(1, min(50, int(ENOUGH / seconds)))
                jobs.append([name, solve, rtol, error, seconds, count])
                if seconds > PATIENCE and not name.startswith(OURS):
                    break
        gc.collect()
        gc.disable()
        for _ in range(repeats):
            for job in jobs:
                _, solve, rtol, _, best, count = job
                if best > 0.05 and _ > 0:
                    continue
                begun = time.perf_counter()
                for _ in range(count):
                    solve(rtol, times)
                job[4] = min(best, (time.perf_counter() - begun) / count)
        gc.enable()
        for name, _, rtol, error, seconds, _ in jobs:
            rows[task][name].append((rtol, error, seconds))
    return rows


def accuracy(problem: Problem, exact: np.ndarray) -> list[tuple[float, float, float]]:
    """(rtol, error at the end, error of `.at` on the grid) of the default method, in units of atol + rtol |z|max."""
    size = np.abs(exact) if problem.pointwise else np.abs(exact).max(axis=1, keepdims=True)
    rows = []
    for rtol in [10.0**-e for e in range(4, 12)]:
        errors = np.abs(ours(problem, None)(rtol, problem.times) - exact) / (rtol * (problem.floor + size))
        rows.append((rtol, float(errors[:, -1].max()), float(errors.max())))
    return rows


def show_accuracy(table: dict) -> None:
    """Print what `accuracy` found."""
    print("\nError of the default method over the tolerance asked for: end; dense output on the grid")
    print(f"{'':24}" + "".join(f"{rtol:>16.0e}" for rtol, *_ in next(iter(table.values()))))
    for name, rows in table.items():
        print(f"{name:24}" + "".join(f"{end:8.2g}; {grid:6.2g}" for _, end, grid in rows))
    grid = np.array([grid for rows in table.values() for *_, grid in rows])
    mean = np.exp(np.mean(np.log(grid + 1e-9)))
    print(f"dense output: geometric mean {mean:.2g}, {np.mean(grid <= 3):.0%} within 3, worst {grid.max():.3g}")


def time_at(points: list[tuple[float, float, float]], target: float) -> float | None:
    """Least seconds for `target`: at a rung that meets it, or between a rung that does and its neighbour, log-log."""
    good = [(error, seconds) for _, error, seconds in points if error == error]
    candidates = [seconds for error, seconds in good if error <= target]
    for (e0, s0), (e1, s1) in pairwise(good):
        if e1 <= target < e0:
            share = np.log(e0 / target) / np.log(e0 / max(e1, 1e-17))
            candidates.append(float(np.exp((1 - share) * np.log(s0) + share * np.log(s1))))
    return min(candidates) if candidates else None


def solvers_of(problem: Problem, *, quick: bool, compiled: bool, alone: bool) -> dict:
    """By name: solve and its rungs."""
    fine, coarse = ladder(halves=not quick), ladder(halves=False)
    methods = [gsp.Method.RODAS5P, gsp.Method.RADAU9, gsp.Method.RADAU13]
    if not problem.is_stiff:
        methods.append(gsp.Method.DOP853)
    result = {OURS: (ours(problem, None), fine)}
    if not quick:
        result |= {f"gsp {method.name}": (ours(problem, method), fine) for method in methods}
    for peer in () if alone else PEERS:
        if peer.version is None or (peer.explicit and problem.is_stiff) or (compiled and not peer.quick):
            continue
        try:
            result[peer.name] = (peer.build(problem), fine if peer.quick else coarse)
        except Exception as failure:
            print(f"    {peer.name}: {type(failure).__name__} {str(failure)[:90]}")
    return result


def summary(results: dict) -> dict:
    """`cells[task][problem][target]` = (our seconds, best peer's seconds, its name, our method's best seconds)."""
    cells: dict = {}
    for task in ("end", "grid"):
        for name, rows in results.items():
            for target in TARGETS:
                mine = time_at(rows[task][OURS], target)
                best, who = None, None
                for other, points in rows[task].items():
                    if other.startswith(OURS):
                        continue
                    seconds = time_at(points, target)
                    if seconds is not None and (best is None or seconds < best):
                        best, who = seconds, other
                cells.setdefault(task, {}).setdefault(name, {})[target] = (mine, best, who)
    return cells


def show(cells: dict, results: dict, stiff: set[str]) -> dict:
    """Print both tables and the means; return the means."""
    means: dict = {}
    for task, title in (("end", "at the end point"), ("grid", "over the output grid")):
        print(f"\nBest peer's time over ours, error {title}   (us ours; peer)")
        print(f"{'':24}" + "".join(f"{target:>26.0e}" for target in TARGETS))
        logs = defaultdict(list)
        for name, row in cells[task].items():
            line = f"{name:24}"
            for target in TARGETS:
                mine, best, who = row[target]
                if mine is None:
                    line += f"{'not reached':>26}"
                elif best is None:
                    line += f"{'alone':>12} ({mine * 1e6:8.0f};    -)"
                else:
                    line += f"{best / mine:10.2f} ({mine * 1e6:5.0f}; {who.split()[0][:4]}{who[-3:]})"
                    if name in stiff:
                        logs[target].append(np.log(best / mine))
            print(line)
        means[task] = {target: float(np.exp(np.mean(values))) for target, values in logs.items() if values}
        line = f"{'geometric mean, stiff':24}"
        for target in TARGETS:
            line += f"{means[task].get(target, float('nan')):10.2f}" + " " * 16
        print(line)
        print(f"{'goal':24}" + "".join(f"{GOALS.get(t, float('nan')):10.2f}" + " " * 16 for t in TARGETS))
    print("\nEach peer's time over ours, geometric mean over the stiff problems it solves, at the end point")
    names = sorted({other for rows in results.values() for other in rows["end"] if other != OURS})
    for other in names:
        line = f"{other:24}"
        for target in TARGETS:
            values = []
            for name in cells["end"]:
                theirs = time_at(results[name]["end"].get(other, []), target)
                mine = time_at(results[name]["end"][OURS], target)
                if name in stiff and theirs and mine:
                    values.append(np.log(theirs / mine))
            line += f"{np.exp(np.mean(values)):10.2f} ({len(values)})" if values else f"{'-':>14}"
        print(line)
    return means


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three problems, whole decades, compiled peers")
    parser.add_argument("--json", type=Path, help="write everything measured")
    parser.add_argument("--only", help="problems whose names contain this")
    parser.add_argument("--compiled", action="store_true", help="only peers without Python in their loop")
    parser.add_argument("--ours", action="store_true", help="no peers")
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    machine = {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "gsp": gsp.__version__,
        "packages": {name: version(name) for name in ("numpy", "scipy", "numba", "llvmlite", "sympy")},
        "peers": {peer.package: peer.version for peer in PEERS},
    }
    print(machine)
    print("missing:", ", ".join(sorted({p.package for p in PEERS if p.version is None})) or "none")
    chosen = [p for p in PROBLEMS if not options.only or options.only in p.name]
    if options.quick:
        chosen = [p for p in chosen if p.name.startswith(("van der Pol, mu = 1e6", "Robertson", "sleigh"))]
    results, references, accurate, begun = {}, {}, {}, time.perf_counter()
    for problem in chosen:
        exact, doubt = reference(problem)
        solvers = solvers_of(
            problem,
            quick=options.quick,
            compiled=options.quick or options.compiled,
            alone=options.ours,
        )
        results[problem.name] = measure(problem, exact, solvers, 2 if options.quick else 4)
        references[problem.name] = doubt
        accurate[problem.name] = accuracy(problem, exact)
        print(f"  {problem.name}: reference within {doubt:.1e}, {time.perf_counter() - begun:.0f} s")
    cells = summary(results)
    means = show(cells, results, {p.name for p in chosen if p.is_stiff})
    show_accuracy(accurate)
    if options.json:
        data = {
            "machine": machine,
            "reference": references,
            "ladders": results,
            "least": cells,
            "means": means,
            "accuracy": accurate,
        }
        options.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
