"""Least time to reach an error: `gsp.integrate` against every installed peer, on nine problems and a larger one.

    python benchmarks/integrators.py [--quick] [--compiled] [--ours] [--only NAME] [--json FILE]

Each integrator runs over a ladder of tolerances; the time at a target error is interpolated on its ladder. Errors are
taken at the end of the span (task "end", no output before it) and over an output grid (task "grid", ours by
`integrate(..., at=times)`). Runs of all integrators alternate, and the least of several times counts: read the ratios,
not the seconds.
"""

from __future__ import annotations

import argparse
import gc
import json
import time
import warnings
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from problems import PROBLEMS, RING, Problem
from rivals import PEERS

import gsp
from gsp.comparison.peers import Peer
from gsp.comparison.work_precision import machine
from gsp.lowering.compiled_flow import parameter_vector

Solver = Callable[[float, np.ndarray], np.ndarray]

TARGETS = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
# Worst acceptable geometric means over the stiff problems, by target.
GOALS = {1e-3: 2.5, 1e-5: 2.5, 1e-7: 3.0, 1e-9: 4.0}
# Against the best peer on the ring, at every target.
RING_GOAL = 1.3
OURS = "gsp"
QUICK = ("van der Pol, mu = 1e6", "Robertson", "sleigh, epsilon = 1e-06")
# A peer's ladder ends where one solve takes longer (seconds); one beyond SLOW is timed once.
PATIENCE, SLOW = 0.1, 0.01
ENOUGH = 300e-6


def ours(problem: Problem, method: gsp.Method | None) -> Solver:
    """Our side: the public call, with `at=` for the grid."""

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        trajectory = gsp.integrate(
            problem.field,
            start=problem.start,
            span=problem.span,
            epsilon=problem.epsilon,
            rtol=rtol,
            atol=rtol * problem.floor,
            method=method,
            dense=False,
            at=times if len(times) > 1 else None,
        )
        if not trajectory.status.ok:
            raise ArithmeticError(trajectory.message)
        return trajectory.y[:, -1:] if len(times) == 1 else trajectory.y

    return solve


def theirs(problem: Problem, peer: Peer) -> Solver:
    """A peer's side, prepared for the end and for the grid; raises what its package raises."""
    p = parameter_vector(problem.field, problem.epsilon)
    solves = {
        len(times): peer.prepare(problem.field, p, problem.y0, problem.span[0], times)
        for times in (problem.times[-1:], problem.times)
    }

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        states = solves[len(times)](rtol, rtol * problem.floor).states
        if not np.isfinite(states).all():
            raise ArithmeticError("did not reach the end")
        return states

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
    rows: dict = {}
    for task, times in (("end", problem.times[-1:]), ("grid", problem.times)):
        rows[task], jobs = {}, []
        for name, (solve, rungs) in solvers.items():
            for rtol in rungs:
                begun = time.perf_counter()
                try:
                    # What a peer builds for a tolerance is not timed.
                    solve(rtol, times)
                    begun = time.perf_counter()
                    states = solve(rtol, times)
                    seconds = time.perf_counter() - begun
                except Exception as failure:
                    # A loose run of ours may end at a pole too, as a peer's may; the tightest may not.
                    if name == OURS and rtol == rungs[-1]:
                        raise
                    if name == OURS or rtol == rungs[0]:
                        print(f"    {name}: {type(failure).__name__} {str(failure)[:90]}")
                    if time.perf_counter() - begun > PATIENCE:
                        break
                    continue
                error = distance(problem, states, exact, at_end=task == "end")
                jobs.append([name, solve, rtol, error, seconds, max(1, min(50, int(ENOUGH / seconds)))])
                if seconds > PATIENCE and not name.startswith(OURS):
                    break
        gc.collect()
        gc.disable()
        for _ in range(repeats):
            for job in jobs:
                _, solve, rtol, _, best, count = job
                if best > SLOW:
                    continue
                begun = time.perf_counter()
                for _ in range(count):
                    solve(rtol, times)
                job[4] = min(best, (time.perf_counter() - begun) / count)
        gc.enable()
        for name, _, rtol, error, seconds, _ in jobs:
            rows[task].setdefault(name, []).append((rtol, error, seconds))
    return rows


def accuracy(problem: Problem, exact: np.ndarray) -> list[tuple[float, float, float, float]]:
    """(rtol, error at the end, error of `.at` on the grid, the latter over that of the steps' ends on both sides).

    All errors are of the default method, in units of atol + rtol |z|max; in the last, one below 1 counts as 1. It says
    what the dense output adds to the error of the steps, which a jump magnifies however it is asked for.
    """
    size = np.abs(exact) if problem.pointwise else np.abs(exact).max(axis=1, keepdims=True)
    rows = []
    for rtol in [10.0**-e for e in range(4, 12)]:
        run = {"start": problem.start, "span": problem.span, "epsilon": problem.epsilon}
        found = gsp.integrate(problem.field, **run, rtol=rtol, atol=rtol * problem.floor)
        errors = (np.abs(found.at(problem.times) - exact) / (rtol * (problem.floor + size))).max(axis=0)
        ends = gsp.integrate(
            problem.field,
            **run,
            rtol=1e-13,
            atol=1e-13 * problem.floor,
            at=found.t,
            method=gsp.Method.RADAU13,
        ).y
        scale = np.abs(ends) if problem.pointwise else size
        around = (np.abs(found.y - ends) / (rtol * (problem.floor + scale))).max(axis=0)
        after = np.searchsorted(found.t, problem.times)
        worse = np.maximum(np.maximum(around[after - 1], around[after]), 1.0)
        rows.append((rtol, float(errors[-1]), float(errors.max()), float((errors / worse).max())))
    return rows


def time_at(points: list[tuple[float, float, float]], target: float) -> float | None:
    """Least seconds for `target`: at a rung that meets it, or between a rung that does and its neighbour, log-log."""
    good = [(error, seconds) for _, error, seconds in points if error == error]
    candidates = [seconds for error, seconds in good if error <= target]
    for (e0, s0), (e1, s1) in pairwise(good):
        if e1 <= target < e0:
            share = np.log(e0 / target) / np.log(e0 / max(e1, 1e-17))
            candidates.append(float(np.exp((1 - share) * np.log(s0) + share * np.log(s1))))
    return min(candidates) if candidates else None


def solvers_of(
    problem: Problem, peers: Sequence[Peer], *, quick: bool
) -> dict[str, tuple[Solver, list[float]]]:
    """By name: solve and its rungs."""
    fine, coarse = ladder(halves=not quick), ladder(halves=False)
    result = {OURS: (ours(problem, None), fine)}
    if not quick:
        methods = [gsp.Method.RADAU9, gsp.Method.RADAU13]
        methods += [] if problem.is_stiff else [gsp.Method.DOP853]
        result |= {f"{OURS} {method.name}": (ours(problem, method), fine) for method in methods}
    for peer in peers:
        if peer.is_explicit and problem.is_stiff:
            continue
        try:
            result[peer.name] = (theirs(problem, peer), fine if peer.is_compiled else coarse)
        except Exception as failure:
            print(f"    {peer.name}: {type(failure).__name__} {str(failure)[:90]}")
    return result


def cell(rows: dict[str, list], target: float) -> dict:
    """Microseconds of ours and of the best peer at a target, whose that is, and the ratio; None where not reached."""
    mine = time_at(rows[OURS], target)
    others = {name: time_at(points, target) for name, points in rows.items() if not name.startswith(OURS)}
    reached = {name: seconds for name, seconds in others.items() if seconds is not None}
    who = min(reached, key=lambda name: reached[name], default=None)
    return {
        "target": target,
        "ours_us": None if mine is None else 1e6 * mine,
        "peer_us": None if who is None else 1e6 * reached[who],
        "peer": who,
        "ratio": None if mine is None or who is None else reached[who] / mine,
    }


def mean(ratios: Sequence[float]) -> float | None:
    """Geometric mean, None of nothing."""
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else None


def summary(problems: Sequence[Problem], results: dict, accurate: dict) -> dict:
    """The tables: by task and problem the cells, their means over the nine's stiff ones, and each peer's own mean."""
    tasks = {
        task: [
            {
                "problem": problem.name,
                "stiff": problem.is_stiff,
                "cells": [cell(results[problem.name][task], target) for target in TARGETS],
            }
            for problem in problems
        ]
        for task in ("end", "grid")
    }
    counted = [problem.name for problem in problems if problem.is_stiff and problem is not RING]
    means = {
        task: [
            mean([c["ratio"] for row in rows if row["problem"] in counted and (c := row["cells"][i])["ratio"]])
            for i in range(len(TARGETS))
        ]
        for task, rows in tasks.items()
    }
    peers = []
    for peer in PEERS:
        ratios = []
        for target in TARGETS:
            pairs = [
                (
                    time_at(results[name]["end"].get(peer.name, []), target),
                    time_at(results[name]["end"][OURS], target),
                )
                for name in counted
            ]
            ratios.append([a / b for a, b in pairs if a and b])
        if any(ratios):
            peers.append(
                {"peer": peer.name, "means": [mean(r) for r in ratios], "problems": [len(r) for r in ratios]}
            )
    grid = np.array([error for name in accurate for _, _, error, _ in accurate[name]])
    added = max(error for name in accurate for *_, error in accurate[name])
    return {
        "targets": list(TARGETS),
        "goals": [GOALS.get(target) for target in TARGETS],
        "ring": RING.name,
        "ring_goal": RING_GOAL,
        "tasks": tasks,
        "means": means,
        "peers": peers,
        "dense": {
            "mean": mean(list(grid + 1e-9)),
            "within_three": float(np.mean(grid <= 3)),
            "worst": float(grid.max()),
            "added": added,
            "rows": {
                name: [{"rtol": rtol, "end": end, "grid": error} for rtol, end, error, _ in rows]
                for name, rows in accurate.items()
            },
        },
    }


def show(data: dict) -> None:
    """Print the tables of `summary`."""
    targets = data["targets"]
    for task, title in (("end", "at the end point"), ("grid", "over the output grid")):
        print(f"\nBest peer's time over ours, error {title}   (us ours; peer)")
        print(f"{'':32}" + "".join(f"{target:>28.0e}" for target in targets))
        for row in data["tasks"][task]:
            line = f"{row['problem']:32}"
            for c in row["cells"]:
                if c["ours_us"] is None:
                    line += f"{'not reached':>28}"
                elif c["ratio"] is None:
                    line += f"{'alone':>10} ({c['ours_us']:6.0f}; {'-':9})"
                else:
                    line += f"{c['ratio']:10.2f} ({c['ours_us']:6.0f}; {c['peer'][:9]:9})"
            print(line)
        for name, values in (("geometric mean, stiff of nine", data["means"][task]), ("goal", data["goals"])):
            print(f"{name:32}" + "".join(f"{v:10.2f}{'':18}" if v else f"{'-':>10}{'':18}" for v in values))
    print("\nEach peer's time over ours, geometric mean over the stiff problems it solves, at the end point")
    for row in data["peers"]:
        cells = zip(row["means"], row["problems"])
        print(f"{row['peer']:24}" + "".join(f"{m:10.2f} ({n})" if m else f"{'-':>14}" for m, n in cells))
    dense = data["dense"]
    print("\nError of the default method over the tolerance asked for: end; dense output on the grid")
    print(f"{'':32}" + "".join(f"{r['rtol']:>16.0e}" for r in next(iter(dense["rows"].values()))))
    for name, rows in dense["rows"].items():
        print(f"{name:32}" + "".join(f"{r['end']:8.2g}; {r['grid']:6.2g}" for r in rows))
    print(
        f"geometric mean {dense['mean']:.2g}, {dense['within_three']:.0%} within 3, worst {dense['worst']:.3g}; "
        f"over the error of the steps' ends around {dense['added']:.3g} at most"
    )


def run(problems: Sequence[Problem], peers: Sequence[Peer], *, quick: bool) -> tuple[dict, dict]:
    """The summary of all that was measured, and the ladders with the references' errors."""
    results, doubts, accurate, begun = {}, {}, {}, time.perf_counter()
    for problem in problems:
        exact, doubts[problem.name] = reference(problem)
        solvers = solvers_of(problem, peers, quick=quick)
        results[problem.name] = measure(problem, exact, solvers, 2 if quick else 4)
        accurate[problem.name] = accuracy(problem, exact)
        spent = time.perf_counter() - begun
        print(f"  {problem.name}: reference within {doubts[problem.name]:.1e}, {spent:.0f} s", flush=True)
    data = summary(problems, results, accurate)
    data["reference"] = doubts
    return data, results


def installed(*, compiled: bool) -> list[Peer]:
    """The peers that are there; without those that have Python between their steps if others are, and `compiled`."""
    present = [peer for peer in PEERS if peer.version is not None]
    fast = [peer for peer in present if peer.is_compiled and peer.package != "diffrax"]
    return fast if compiled and fast else present


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
    print(machine())
    print("missing:", ", ".join(sorted({p.package for p in PEERS if p.version is None})) or "none")
    chosen = [p for p in (*PROBLEMS, RING) if not options.only or options.only in p.name]
    if options.quick:
        chosen = [p for p in chosen if p.name in QUICK]
    peers = [] if options.ours else installed(compiled=options.quick or options.compiled)
    data, ladders = run(chosen, peers, quick=options.quick)
    show(data)
    if options.json:
        data = {"machine": machine(), "summary": data, "ladders": ladders}
        options.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
