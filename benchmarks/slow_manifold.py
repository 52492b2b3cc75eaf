"""The slow manifold: microseconds a point of the zero-derivative principle, seconds and errors of solve_manifold.

The figures to reach: 0.6 to 3 us a point at order 10 on models with one slow and one fast variable, 10^5 points at
order 8 in under 1 s, reference values to 1e-12. Whatever is compared is measured in the same run, and shown as a
ratio.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

import numpy as np
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.models import load
from gsp.scenes.study import study_of
from gsp.slow.series import expand
from gsp.slow.slow_points import zero_derivative
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.system import SlowFastSystem

ORDERS = (2, 4, 6, 8, 10, 12)
POINTS = 10_000
MANY = 100_000
EPSILON = 0.01
MODELS = ("michaelis_menten", "davis_skodje", "lindemann", "van_der_pol", "chaplygin_sleigh", "koper")

s, c, x, y, t, epsilon = sp.symbols("s c x y t epsilon")
SADDLE = SlowFastSystem(slow={s: -s}, fast={x: x + s**2, y: -y + x * s}, epsilon=epsilon)
OSCILLATING = SlowFastSystem(slow={t: 1}, fast={x: x - sp.sin(t), y: -y + sp.cos(t)}, epsilon=epsilon)
ENZYME = SlowFastSystem(slow={s: -s + (s + sp.Rational(1, 2)) * c}, fast={c: s - (s + 1) * c}, epsilon=epsilon)
SEGEL_SLEMROD = SlowFastSystem(
    slow={s: (-11 * s + (s - 90) * c) / 100}, fast={c: s - c * (10 + s) / 11}, epsilon=epsilon
)


def best(function, *, repeat: int = 3) -> float:
    """Seconds of the fastest of some calls, after one that compiles."""
    function()
    times = []
    for _ in range(repeat):
        begun = time.perf_counter()
        function()
        times.append(time.perf_counter() - begun)
    return min(times)


def sheet(name: str, points: int) -> tuple:
    """Branch of a model, points of its region, and starts on M0."""
    placed = study_of(load(name))
    box = np.array([placed.region[symbol.name] for symbol in placed.system.x])
    unit = np.random.default_rng(0).random((points, len(box)))
    # The middle of the region: its edges may touch a fold.
    grid = box[:, 0] + (0.2 + 0.6 * unit) * (box[:, 1] - box[:, 0])
    return placed.branch, grid, placed.branch.points(grid)


def pointwise(models: Sequence[str] = MODELS, orders: Sequence[int] = ORDERS) -> list[dict]:
    """By model: microseconds a point at each order and to 1e-13, the start on M0 included; the largest error."""
    rows = []
    for name in models:
        branch, grid, near = sheet(name, POINTS)
        spent = {}
        for order in (*orders, None):
            seconds = best(partial(zero_derivative, branch, grid, epsilon=EPSILON, order=order, near=near))
            spent["to 1e-13" if order is None else f"order {order}"] = 1e6 * seconds / POINTS
        error = zero_derivative(branch, grid, epsilon=EPSILON, near=near).error.max()
        rows.append({"model": name, "microseconds": spent, "error": float(error)})
    return rows


def many(models: Sequence[str] = ("michaelis_menten", "chaplygin_sleigh", "koper")) -> list[dict]:
    """By model: seconds for 10^5 points at order 8, and the ratio to the compiled series of that order (not Koper's:
    its series takes long to compile)."""
    rows = []
    for name in models:
        branch, grid, near = sheet(name, MANY)
        seconds = best(partial(zero_derivative, branch, grid, epsilon=EPSILON, order=8, near=near))
        row = {"model": name, "seconds": seconds}
        if name != "koper":
            series = expand(branch, order=8)
            row["to_series"] = seconds / best(partial(series.evaluate, grid, EPSILON, near=near))
        rows.append(row)
    return rows


def show_points(rows: list[dict]) -> None:
    """Print what `pointwise` found."""
    print(f"zero_derivative, epsilon = {EPSILON:g}, {POINTS} points: microseconds a point")
    print(f"{'model':18} " + " ".join(f"{name:>9}" for name in rows[0]["microseconds"]) + "  largest error")
    for row in rows:
        values = " ".join(f"{value:9.2f}" for value in row["microseconds"].values())
        print(f"{row['model']:18} {values}        {row['error']:.1e}")


def show_many(rows: list[dict]) -> None:
    """Print what `many` found."""
    print(f"\n{MANY} points at order 8")
    for row in rows:
        line = f"{row['model']:18} {row['seconds']:7.3f} s {'ok' if row['seconds'] < 1.0 else 'SLOW'}"
        if "to_series" in row:
            line += f"   {row['to_series']:.1f} times the series of order 8 once that is expanded and compiled"
        print(line)


def solved() -> None:
    """solve_manifold: seconds, nodes and the true error against the estimated one."""
    print("\nsolve_manifold, tolerance 1e-13")
    print(f"{'case':34} epsilon  seconds  nodes  estimated      true  true/estimated")
    for title, system, region, value, points, exact in cases():
        branch = solve_critical(system).branches[0]
        seconds = best(partial(solve_manifold, branch, region=region, epsilon=value, tolerance=1e-13), repeat=2)
        manifold = solve_manifold(branch, region=region, epsilon=value, tolerance=1e-13)
        error = np.abs(manifold.evaluate(points) - exact).max()
        print(
            f"{title:34} {value:7g} {seconds:8.3f} {len(manifold.nodes):6} {manifold.error_estimate:10.1e} "
            f"{error:9.1e} {error / manifold.error_estimate:9.2g}  {manifold.status.name}"
        )


def cases():
    """Title, system, region, epsilon, points and the exact values there."""
    values = [
        0.09425575388359942063535,
        0.3380962858730661398517,
        0.5030315116239185527709,
        0.8335251284935477027363,
    ]
    yield "Michaelis-Menten", ENZYME, {"s": (0.1, 5)}, 0.1, [0.1, 0.5, 1, 5], np.array(values)[:, None]
    grid = np.linspace(-1, 2, 200)
    for value in (0.1, 0.01):
        exact = np.stack(
            [-(grid**2) / (1 + 2 * value), -(grid**3) / ((1 + 2 * value) * (1 - 3 * value))], axis=1
        )
        yield "saddle, two fast variables", SADDLE, {"s": (-1, 2)}, value, grid, exact
    times = np.linspace(0, 7, 200)
    for value in (0.5, 0.1):
        rows = [np.sin(times) + value * np.cos(times), np.cos(times) + value * np.sin(times)]
        exact = np.stack(rows, axis=1) / (1 + value**2)
        yield "saddle, driven", OSCILLATING, {"t": (0, 7)}, value, times, exact
    inner = np.linspace(1e-6, 1, 200)
    for value in (1e-4, 1e-3, 1e-2):
        exact = zero_derivative(
            solve_critical(SEGEL_SLEMROD).branches[0], inner, epsilon=value, tolerance=1e-15
        ).y
        yield "Segel-Slemrod, kappa 10, sigma 100", SEGEL_SLEMROD, {"s": (1e-6, 1)}, value, inner, exact


def main() -> None:
    """Print the tables."""
    show_points(pointwise())
    show_many(many())
    solved()


if __name__ == "__main__":
    main()
