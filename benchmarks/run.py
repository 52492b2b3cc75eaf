"""Everything that is measured, in one run: tables on the screen, one JSON, and docs/benchmarks.md made from it.

    python benchmarks/run.py [--quick] [--only PART ...] [--json FILE] [--write]

Whatever is compared is measured in turns in this run: read ratios. `--quick` takes three problems, compiled peers and
few turns; `--json` writes all ladders too; `--write` writes docs/benchmarks.json and docs/benchmarks.md. `--only` takes
the parts that say themselves when and with which version they were measured, and keeps the rest of the JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
import warnings
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import calls
import ensembles
import integrators
import large
import loose
import reductions
import series
import slow_manifold
import whole_calls
from page import render, targets
from problems import PROBLEMS, RING
from rivals import PEERS

import gsp
from gsp.comparison.work_precision import machine

DOCS = Path(__file__).parent.parent / "docs"
# Digits kept of a figure: clocks are not better.
DIGITS = 4
TURNS, QUICK_TURNS = 15, 3
# Parts that carry date, version and load of their own.
PARTS: dict[str, Callable[..., dict]] = {
    "loose": loose.measured,
    "large": large.measured,
    "reductions": reductions.measure,
}


def rounded(value: Any) -> Any:
    """`value` with each float in it to a few digits; nan and infinity, which JSON lacks, become None."""
    if isinstance(value, dict):
        return {str(key): rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def timed(spent: dict[str, float], name: str, function: Callable[[], Any]) -> Any:
    """What the function returns; its seconds go into `spent`."""
    print(f"\n== {name}", flush=True)
    begun = time.perf_counter()
    result = function()
    spent[name] = time.perf_counter() - begun
    print(f"({spent[name]:.0f} s)", flush=True)
    return result


def measure(*, quick: bool) -> tuple[dict, dict]:
    """The summary that the page is made from, and the ladders."""
    spent: dict[str, float] = {}
    ladders: dict = {}

    def compared() -> dict:
        problems = [p for p in PROBLEMS if not quick or p.name in integrators.QUICK] + ([] if quick else [RING])
        data, rows = integrators.run(problems, integrators.installed(compiled=quick), quick=quick)
        ladders.update(rows)
        integrators.show(data)
        return data

    def together() -> dict:
        rows = ensembles.measure(QUICK_TURNS if quick else TURNS)
        ensembles.show(rows)
        return {"members": ensembles.MEMBERS, "epsilon": ensembles.EPSILON, "rows": rows}

    def exact() -> list[dict]:
        rows = [series.measure(*case) for case in series.CASES]
        series.show(rows)
        return rows

    def pointwise() -> dict:
        models = ("michaelis_menten", "chaplygin_sleigh") if quick else slow_manifold.MODELS
        points = slow_manifold.pointwise(models, (10,) if quick else slow_manifold.ORDERS)
        slow_manifold.show_points(points)
        many = slow_manifold.many(("michaelis_menten",)) if quick else slow_manifold.many()
        slow_manifold.show_many(many)
        return {"epsilon": slow_manifold.EPSILON, "points": points, "number": slow_manifold.MANY, "many": many}

    def around() -> dict:
        cold = calls.cold_start(1 if quick else 3)
        overhead = calls.call_overhead()
        calls.show(cold, overhead)
        return {"cold": cold, "overhead": overhead}

    def whole() -> dict:
        data = whole_calls.measure(quick=quick)
        whole_calls.show(data)
        return data

    data = {
        "generated": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "quick": quick,
        "gsp": gsp.__version__,
        "machine": machine(),
        # Of the minute before: what others were computing.
        "load": os.getloadavg()[0],
        "peers": {peer.name: f"{peer.package} {peer.version}" for peer in PEERS if peer.version is not None},
        "missing": sorted({peer.package for peer in PEERS if peer.version is None}),
        "integrators": timed(spent, "integrators", compared),
        "ensembles": timed(spent, "ensembles", together),
        "series": timed(spent, "series", exact),
        "slow_manifold": timed(spent, "slow manifold", pointwise),
        "calls": timed(spent, "calls", around),
        "whole_calls": timed(spent, "whole calls", whole),
    } | parts(PARTS, spent, quick=quick)
    return rounded(data | {"seconds": spent}), rounded(ladders)


def parts(names: Iterable[str], spent: dict[str, float], *, quick: bool) -> dict[str, dict]:
    """Those of `PARTS`, measured."""
    return {name: timed(spent, name, partial(PARTS[name], quick=quick)) for name in names}


def show_targets(data: dict) -> None:
    """Print what was to be reached beside what was."""
    print("\n== targets")
    for row in targets(data):
        print(f"{'ok   ' if row.is_met else 'SHORT'} {row.what:76} {row.wanted:>12}  {row.reached}")


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three problems, compiled peers, few turns")
    parser.add_argument("--only", nargs="+", choices=tuple(PARTS), help="measure these parts, keep the others")
    parser.add_argument("--json", type=Path, help="write everything measured, ladders included")
    parser.add_argument(
        "--write", action="store_true", help="write docs/benchmarks.json and docs/benchmarks.md"
    )
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    begun = time.perf_counter()
    print(f"gsp {gsp.__version__}, {machine()}")
    if options.only:
        data = json.loads((DOCS / "benchmarks.json").read_text(encoding="utf-8"))
        data, ladders = data | rounded(parts(options.only, {}, quick=options.quick)), {}
    else:
        data, ladders = measure(quick=options.quick)
    show_targets(data)
    print(f"\n{time.perf_counter() - begun:.0f} s in all")
    if options.json:
        text = json.dumps(data | {"ladders": ladders}, indent=1) + "\n"
        options.json.write_text(text, encoding="utf-8")
    if options.write:
        (DOCS / "benchmarks.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        (DOCS / "benchmarks.md").write_text(render(data), encoding="utf-8")


if __name__ == "__main__":
    main()
