"""A reduced flow in place of the full system: what a whole call costs, at the error that is the reduced model's own.

    python benchmarks/reductions.py [--quick]

Scenes of the house, systems that nothing was tuned on, and chains of 20 and 100 fast variables; each by a single call
as a user writes it, without output times and with a hundred, and in an ensemble on one thread. Everything is a ratio
of least times that alternate in this run, of the processor's in ensembles. At most 0.8 is wanted on explicit branches,
1 on implicit ones, a third in ensembles, a tenth on chains. A floor is the ratio with a reduced run over next to none
of the span in place of the reduced run: what would be left if the reduced flow itself cost nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import warnings
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import gsp
from gsp.comparison.work_precision import _reference, _start
from gsp.comparison.work_runs import largest_errors
from gsp.models import load
from gsp.scenes.study import Study, study
from gsp.systems.tolerances import SHARE

EXPLICIT = (
    "chaplygin_sleigh", "sleigh_from_lagrangian", "knife_edge", "nonholonomic_particle", "michaelis_menten",
    "davis_skodje", "lindemann", "linear",
)  # fmt: skip
IMPLICIT = ("van_der_pol", "fitzhugh_nagumo", "koper")
QUICK = ("michaelis_menten", "van_der_pol", "chain_of_20")
CHAINS = (20, 100)
RTOLS = tuple(10.0**-k for k in range(2, 10))
METHODS = (None, gsp.Method.RADAU9)
TIMES, ROUNDS, CALLS = 100, 40, 5
MEMBERS, ENSEMBLE_ROUNDS, SPREAD = 1000, 12, 0.02
GOALS = {"explicit": 0.8, "implicit": 1.0, "chain": 0.1}
ENSEMBLE_GOAL = 1 / 3
# The reduced run over so little of the span that it takes a step or two, among the candidates (model, tolerance).
SHORT = 1e-4
FLOOR = (0, 0.0)


def _named(system: gsp.SlowFastSystem, start: dict[str, float], **question: Any) -> gsp.Scene:
    """A scene named after its system, asked at epsilon = 0.02 within 1e-3 unless the question says otherwise."""
    usual: dict[str, Any] = {"epsilon": 0.02, "epsilons": (0.02, 0.01), "tolerance": 1e-3}
    return gsp.Scene(system, name=system.name, start=start, **usual | question)


def chain(links: int) -> gsp.Scene:
    """A slow oscillator, heard through a chain of fast variables and driven by its end."""
    u, v, eps = sp.symbols("u v epsilon")
    y = sp.symbols(f"y1:{links + 1}")
    system = gsp.SlowFastSystem(
        slow={u: v, v: -u - v / 10 + (y[-1] - u**3) / 5},
        fast={b: a - b for a, b in zip((u, *y), y)},
        epsilon=eps,
        name=f"chain_of_{links}",
    )
    start = {"u": 1.0, "v": 0.0, **{s.name: 1.0 for s in y}}
    return _named(
        system,
        start,
        span=(0.0, 40.0),
        epsilon=1e-3,
        epsilons=(1e-3, 5e-4),
        tolerance=1e-2,
        region={"u": (-1.5, 1.5), "v": (-1.5, 1.5)},
    )


def inhibition() -> gsp.Scene:
    """An enzyme with a substrate and a competitive inhibitor: two slow variables, two fast complexes."""
    s, i, c, d, eps = sp.symbols("s i c d epsilon")
    free = 1 - c - d
    system = gsp.SlowFastSystem(
        slow={s: -s * free + c / 2, i: -i * free / 2 + d / 2 + (1 - i) / 10},
        fast={c: s * free - c, d: i * free / 2 - d / 2},
        epsilon=eps,
        name="competitive_inhibition",
    )
    start = {"s": 1.5, "i": 0.5, "c": 0.0, "d": 0.0}
    return _named(system, start, span=(0.0, 10.0), region={"s": (0.01, 2.0), "i": (0.1, 1.5)})


def hardening() -> gsp.Scene:
    """A slow oscillator that pulls on a hardening spring without mass, whose length is given implicitly."""
    p, q, x, eps = sp.symbols("p q x epsilon")
    system = gsp.SlowFastSystem(
        slow={p: q, q: -p - x / 2},
        fast={x: p + q / 2 - x - x**3 - x**5 / 5},
        epsilon=eps,
        name="hardening_spring",
    )
    start = {"p": 1.0, "q": 0.0, "x": 0.6}
    return _named(system, start, span=(0.0, 15.0), region={"p": (-2.0, 2.0), "q": (-2.0, 2.0)})


def cases(*, quick: bool) -> Iterator[tuple[str, str, gsp.Scene]]:
    """(kind, what it is, scene)."""
    for name in (*EXPLICIT, *IMPLICIT):
        yield ("explicit" if name in EXPLICIT else "implicit"), "scene", load(name)
    yield "explicit", "not tuned on", inhibition()
    yield "implicit", "not tuned on", hardening()
    for links in CHAINS[: 1 if quick else None]:
        yield "chain", "chain", chain(links)


class Rivals:
    """The full system by several methods and the reduced flow of order 1, with the error of each at each tolerance."""

    def __init__(self, found: Study) -> None:
        scene = found.scene
        series = found.series(2, symbolic=False)
        self.flow = gsp.restrict(series, order=1)
        self.system, self.epsilon = found.system, scene.epsilon
        self.full_start, self.start, first, _ = _start(found, series, scene.epsilon, 1)
        self.span = scene.span
        self.grid = np.linspace(first, scene.span[1], TIMES + 1)[1:]
        self.slow = [s.name for s in found.system.x]
        reference, _ = _reference(found, self.full_start, scene.epsilon, self.grid)
        self.models = [("reduced", self.flow, self.start, None)] + [
            ("default" if m is None else m.value, self.system, self.full_start, m) for m in METHODS
        ]
        self.options = {
            rtol: {"span": self.span, "epsilon": self.epsilon, "rtol": rtol, "atol": SHARE * rtol}
            for rtol in RTOLS
        }
        begun, ended = self.span
        self.options[FLOOR[1]] = self.options[RTOLS[0]] | {"span": (begun, begun + SHORT * (ended - begun))}
        self.errors: dict[tuple[int, float], float] = {}
        for i in range(len(self.models)):
            for rtol in RTOLS:
                values = self.read(i, rtol)
                good = values.shape == reference.shape and bool(np.isfinite(values).all())
                self.errors[i, rtol] = largest_errors(values, reference)[0] if good else float("inf")
        # Where the tolerance has stopped to matter, but for a twentieth.
        self.error = 1.05 * min(self.errors[0, rtol] for rtol in RTOLS)

    def call(self, i: int, rtol: float) -> gsp.Trajectory:
        """A call without output times."""
        _, flow, start, method = self.models[i]
        return gsp.integrate(flow, start=start, method=method, **self.options[rtol])

    def read(self, i: int, rtol: float) -> np.ndarray:
        """The slow variables at the times of the grid."""
        _, flow, start, method = self.models[i]
        run = gsp.integrate(flow, start=start, method=method, at=self.grid, **self.options[rtol])
        return np.array([run[name] for name in self.slow])

    def candidates(self) -> list[tuple[int, float]]:
        """(model, tolerance) that meet the error: for each model the three slackest, since slack is not always fast.

        The floor comes last of the reduced flow's.
        """
        good = [
            (i, rtol)
            for i in range(len(self.models))
            for rtol in [r for r in RTOLS if self.errors[i, r] <= self.error][:3]
        ]
        return sorted([*good, FLOOR], key=lambda candidate: candidate[0])


def least(solves: dict, rounds: int, calls: int, clock) -> dict:
    """The least seconds of each, in turns."""
    found = dict.fromkeys(solves, float("inf"))
    for _ in range(rounds):
        for key, solve in solves.items():
            begun = clock()
            for _ in range(calls):
                solve()
            found[key] = min(found[key], (clock() - begun) / calls)
    return found


def fastest(found: dict[tuple[int, float], float]) -> tuple[float, float, int]:
    """Seconds of the reduced flow and of the fastest full run, and which that is."""
    reduced = min(seconds for (i, rtol), seconds in found.items() if i == 0 and (i, rtol) != FLOOR)
    seconds, i = min((seconds, i) for (i, _), seconds in found.items() if i > 0)
    return reduced, seconds, i


def measured(kind: str, what: str, scene: gsp.Scene) -> dict:
    """One row."""
    rivals = Rivals(study(scene))
    wanted = rivals.candidates()
    called = least({c: (lambda c=c: rivals.call(*c)) for c in wanted}, ROUNDS, CALLS, time.perf_counter)
    plain = fastest(called)
    reads = {c: (lambda c=c: rivals.read(*c)) for c in wanted if c != FLOOR}
    read = fastest(least(reads, ROUNDS, CALLS, time.perf_counter))
    rng = np.random.default_rng(0)
    share = 1.0 + SPREAD * rng.uniform(-1.0, 1.0, MEMBERS)

    def many(i: int, rtol: float) -> gsp.Ensemble:
        _, flow, start, method = rivals.models[i]
        starts = {name: value * share for name, value in start.items()}
        return gsp.integrate_many(flow, starts, method=method, threads=1, **rivals.options[rtol])

    ran = least({c: (lambda c=c: many(*c)) for c in wanted}, ENSEMBLE_ROUNDS, 1, time.process_time)
    together = fastest(ran)
    return {
        "name": scene.name, "kind": kind, "what": what, "error": rivals.error, "full": rivals.models[plain[2]][0],
        "full_us": 1e6 * plain[1], "reduced_us": 1e6 * plain[0], "ratio": plain[0] / plain[1],
        "floor": called[FLOOR] / plain[1], "beyond": called[FLOOR] / plain[1] > GOALS[kind],
        "grid_ratio": read[0] / read[1], "goal": GOALS[kind],
        "member_us": 1e6 * together[0] / MEMBERS, "full_member_us": 1e6 * together[1] / MEMBERS,
        "ensemble_ratio": together[0] / together[1], "ensemble_goal": ENSEMBLE_GOAL,
        "ensemble_floor": ran[FLOOR] / together[1],
        "ensemble_beyond": ran[FLOOR] / together[1] > ENSEMBLE_GOAL,
    }  # fmt: skip


def measure(*, quick: bool) -> dict:
    """All rows, and when they were measured beside how many processes."""
    rows: list[dict] = []
    load = os.getloadavg()[0]
    for kind, what, scene in cases(quick=quick):
        if quick and scene.name not in QUICK:
            continue
        try:
            rows.append(measured(kind, what, scene))
        except gsp.GspError as failure:
            print(f"    {scene.name}: {str(failure)[:100]}")
            continue
        show(rows[-1:])
    return {
        "measured": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "gsp": gsp.__version__,
        "load": load,
        "rows": rows,
    }


def show(rows: list[dict]) -> None:
    """Print them."""
    for row in rows:
        verdict = "ok   " if row["ratio"] <= row["goal"] else "SHORT"
        print(
            f"{verdict} {row['name']:24} {row['kind']:8} error {row['error']:.1e}  full {row['full_us']:6.1f} us "
            f"({row['full']})  reduced {row['reduced_us']:5.1f} us  ratio {row['ratio']:.2f} "
            f"(floor {row['floor']:.2f}), wanted {row['goal']:g}; "
            f"with at= {row['grid_ratio']:.2f}; in an ensemble {row['ensemble_ratio']:.2f} "
            f"(floor {row['ensemble_floor']:.2f}, {row['member_us']:.2f} us)",
            flush=True,
        )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three rows")
    parser.add_argument("--json", type=Path, help="write what was measured")
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    data = measure(quick=options.quick)
    if options.json:
        options.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
