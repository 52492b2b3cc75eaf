"""Systems of 200 to 1000 states: `integrate` against SciPy's BDF, CVODE and diffsol, all with sparse Jacobians.

    python benchmarks/large.py [problem ...]    also within benchmarks/run.py

prints, for each problem, the milliseconds of a whole call that meets an error over the output grid, and what the best
of the others takes over ours. All run in one process, interleaved, and seconds are of the processor. The peers that
are installed take part: `scikit-sundae` for CVODE, with a band along lines and SuperLU_MT on the network, `pydiffsol`
with its own sparse LU. They are handed the field as machine code, SciPy the exact sparse Jacobian too; diffsol compiles
its own.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.util import find_spec

import numpy as np
import sympy as sp
from compiled_peers import DiffsolPeer
from scipy.integrate import solve_ivp
from scipy.sparse import csc_matrix

import gsp
from gsp.comparison.work_runs import WorkCurve, WorkKind, WorkPoint
from gsp.kernels.evaluate import evaluate
from gsp.lowering.compiled_flow import compile_flow

LADDER = tuple(float(10.0**-k) for k in range(2, 10))
TARGETS = (1e-3, 1e-5, 1e-7)
ROUNDS = 5
POINTS = 21
GOAL = 1.5
QUICK = ("Brusselator, 200 states",)

Problem = tuple[gsp.VectorField, dict[str, float], tuple[float, float]]
Solve = Callable[[float], np.ndarray]


def _interleaved(first: dict, second: dict) -> dict:
    return {state: rate for pair in zip(first.items(), second.items()) for state, rate in pair}


def brusselator(cells: int) -> Problem:
    """Hairer and Wanner II, section IV.10, with the ends held: one variable pair for each cell of a line."""
    u, v = sp.symbols(f"u0:{cells}"), sp.symbols(f"v0:{cells}")
    c = sp.Rational((cells + 1) ** 2, 50)

    def bend(w, end):
        line = (end, *w, end)
        return [c * (a - 2 * b + d) for a, b, d in zip(line, line[1:], line[2:])]

    us = {p: 1 + p**2 * q - 4 * p + s for p, q, s in zip(u, v, bend(u, 1))}
    vs = {q: 3 * p - p**2 * q + s for p, q, s in zip(u, v, bend(v, 3))}
    x = np.arange(1, cells + 1) / (cells + 1)
    start = {str(p): float(1 + np.sin(2 * np.pi * a)) for p, a in zip(u, x)} | {str(q): 3.0 for q in v}
    return gsp.VectorField(_interleaved(us, vs), epsilon=None), start, (0.0, 10.0)


def fitzhugh_nagumo(cells: int) -> Problem:
    """A pulse along a nerve: fast voltage that diffuses, slow recovery."""
    u, w = sp.symbols(f"u0:{cells}"), sp.symbols(f"w0:{cells}")
    c = sp.Rational(cells**2, 400)
    line = (u[0], *u, u[-1])
    bend = [c * (a - 2 * b + d) for a, b, d in zip(line, line[1:], line[2:])]
    us = {p: 100 * (p * (1 - p) * (p - sp.Rational(1, 10)) - q) + s for p, q, s in zip(u, w, bend)}
    ws = {q: p / 2 - q for p, q in zip(u, w)}
    start = {str(p): 1.0 if i < cells // 10 else 0.0 for i, p in enumerate(u)} | {str(q): 0.0 for q in w}
    return gsp.VectorField(_interleaved(us, ws), epsilon=None), start, (0.0, 5.0)


def network(species: int) -> Problem:
    """Mass action between species chosen at random, rate constants over six decades, each fed and washed out."""
    rng = np.random.default_rng(0)
    x = sp.symbols(f"x0:{species}")
    rates = {s: sp.Rational(1, 10) - s / 10 for s in x}
    for _ in range(2 * species):
        a, b, c, d = (x[i] for i in rng.choice(species, 4, replace=False))
        k = sp.Rational(int(1000 * 10 ** rng.uniform(0, 3)), 1000) * sp.Integer(10) ** int(rng.integers(-1, 4))
        if rng.random() < 0.5:
            for s, sign in ((a, -1), (b, -1), (c, 1), (d, 1)):
                rates[s] += sign * k * a * b
        else:
            rates[a] -= k * a
            rates[c] += k * a
    start = {str(s): float(rng.uniform(0, 1)) for s in x}
    return gsp.VectorField(rates, epsilon=None), start, (0.0, 10.0)


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "Brusselator, 200 states": lambda: brusselator(100),
    "Brusselator, 1000 states": lambda: brusselator(500),
    "FitzHugh-Nagumo, 400 states": lambda: fitzhugh_nagumo(200),
    "network, 200 states": lambda: network(200),
}


def solvers(problem: Problem, grid: np.ndarray) -> Iterator[tuple[str, Solve]]:
    """Each contender with its run at a tolerance: states (n, m) on the grid."""
    flow, start, span = problem
    yield (
        "gsp",
        lambda rtol: gsp.integrate(flow, start=start, span=span, rtol=rtol, atol=1e-2 * rtol, at=grid).y,
    )
    compiled = compile_flow(flow)
    p, y, n = np.array(compiled.parameters(None)), np.array(flow.initial(start)), compiled.size
    field, entries = compiled.field, compiled.entries
    rows, columns = map(np.array, zip(*compiled.expressions.jacobian))

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        out = np.empty(n)
        evaluate(field, t, z, p, out)
        return out

    def jacobian(t: float, z: np.ndarray) -> csc_matrix:
        return csc_matrix((entries(z, p), (rows, columns)), shape=(n, n))

    yield (
        "SciPy BDF",
        lambda rtol: (
            solve_ivp(rates, span, y, method="BDF", t_eval=grid, rtol=rtol, atol=1e-2 * rtol, jac=jacobian).y
        ),
    )
    if find_spec("sksundae"):
        yield "CVODE", _cvode(field, p, y, np.array([span[0], *grid]), rows, columns)
    if find_spec("pydiffsol"):
        yield "diffsol BDF", _diffsol(flow, p, y, grid)


def _cvode(field: int, p: np.ndarray, y: np.ndarray, times: np.ndarray, rows, columns) -> Solve:
    from sksundae.cvode import CVODE  # pyright: ignore[reportMissingImports]

    below, above = int((rows - columns).max()), int((columns - rows).max())
    n = len(y)
    options: dict = {"linsolver": "band", "lband": below, "uband": above}
    if below + above > n // 4:
        pattern = csc_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
        options = {"linsolver": "sparse", "sparsity": pattern}

    def right(t: float, z: np.ndarray, out: np.ndarray) -> None:
        evaluate(field, t, z, p, out)

    def solve(rtol: float) -> np.ndarray:
        solver = CVODE(right, rtol=rtol, atol=1e-2 * rtol, max_num_steps=100_000, **options)
        return np.asarray(solver.solve(times, y).y).T[:, 1:]

    return solve


def _diffsol(flow: gsp.VectorField, p: np.ndarray, y: np.ndarray, grid: np.ndarray) -> Solve:
    # With KLU the wheel of version 0.6.2 ends the process, on ten states too.
    solve = DiffsolPeer("BDF", "bdf", matrix="faer_sparse").prepare(flow, p, y, 0.0, grid)
    return lambda rtol: solve(rtol, 1e-2 * rtol).states


def curves(problem: Problem) -> list[WorkCurve]:
    """Error over the grid, relative to each state's largest value or 1e-3, against seconds, for every contender."""
    flow, start, (first, last) = problem
    grid = np.linspace(first, last, POINTS)[1:]
    exact = gsp.integrate(flow, start=start, span=(first, last), rtol=1e-12, atol=1e-14, at=grid).y
    scale = np.maximum(np.abs(exact).max(axis=1), 1e-3)[:, None]
    contenders = dict(solvers(problem, grid))
    errors: dict[str, dict[float, float]] = {name: {} for name in contenders}
    seconds: dict[str, dict[float, float]] = {name: {} for name in contenders}
    for rtol in LADDER:
        for _ in range(ROUNDS):
            for name, solve in contenders.items():
                begun = time.process_time()
                try:
                    found = solve(rtol)
                except Exception as error:  # whatever a peer raises
                    print(f"    {name} at {rtol:.0e}: {str(error)[:100]}", file=sys.stderr)
                    continue
                spent = time.process_time() - begun
                if found.shape == exact.shape:
                    errors[name][rtol] = float((np.abs(found - exact) / scale).max())
                    seconds[name][rtol] = min(spent, seconds[name].get(rtol, np.inf))
    return [
        WorkCurve(
            name,
            WorkKind.FULL if name == "gsp" else WorkKind.PEER,
            tuple(WorkPoint(r, e, e, seconds[name][r], None, None) for r, e in errors[name].items()),
        )
        for name in contenders
    ]


def measured(asked: list[str] | None = None, *, quick: bool = False) -> dict:
    """Milliseconds to each error by problem and contender, and the best other's time over ours; all in one process."""
    load = os.getloadavg()[0]
    rows: list[dict] = []
    for title, make in PROBLEMS.items():
        if (asked and not any(word in title for word in asked)) or (quick and title not in QUICK):
            continue
        found = curves(make())
        spent = [[float(c.seconds_at(e)) for e in TARGETS] for c in found]
        ratios = [
            float(np.nanmin([other[i] for other in spent[1:]]) / spent[0][i]) for i in range(len(TARGETS))
        ]
        times = {c.label: [1e3 * s for s in each] for c, each in zip(found, spent)}
        rows.append({"problem": title, "milliseconds": times, "ratios": ratios})
        show(rows[-1:])
    every = [r for row in rows for r in row["ratios"] if np.isfinite(r)]
    return {
        "measured": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), "gsp": gsp.__version__, "load": load,
        "targets": list(TARGETS), "rows": rows, "goal": GOAL,
        "mean": float(np.exp(np.mean(np.log(every)))) if every else None, "least": min(every, default=None),
    }  # fmt: skip


def show(rows: list[dict]) -> None:
    """Print them."""
    for row in rows:
        print(
            f"{row['problem']}: milliseconds to an error over the grid of "
            + ", ".join(f"{e:.0e}" for e in TARGETS)
        )
        for name, times in (*row["milliseconds"].items(), ("best/ours", row["ratios"])):
            print(f"  {name:<12}" + "".join(f"{value:12.2f}" for value in times), flush=True)


def main(asked: list[str]) -> None:
    data = measured(asked)
    if data["mean"] is not None:
        print(f"geometric mean {data['mean']:.2f}, least {data['least']:.2f}")


if __name__ == "__main__":
    main(sys.argv[1:])
