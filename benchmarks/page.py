"""docs/benchmarks.md from what `run.py` measured: targets beside what was reached, then the tables.

    python benchmarks/page.py

writes the page again from docs/benchmarks.json.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"


@dataclass(frozen=True)
class Target:
    """One figure: what it is, what is wanted, what was reached, both in words."""

    what: str
    wanted: str
    reached: str
    is_met: bool


def power(value: float) -> str:
    """1e-7 for 1e-07."""
    mantissa, _, exponent = f"{value:.0e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def figure(value: float | None, digits: int = 3) -> str:
    """A number to `digits` digits, a dash for none."""
    if value is None:
        return "-"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.1e}"
    decimals = max(0, digits - 1 - (math.floor(math.log10(abs(value))) if value else 0))
    return f"{value:.{decimals}f}"


def at_least(what: str, value: float, bound: float, note: str = "") -> Target:
    """A ratio that should not be smaller."""
    return Target(what, f"{bound:g} or more", figure(value) + note, value >= bound)


def at_most(what: str, value: float, bound: float, unit: str, note: str = "") -> Target:
    """Something that should be less."""
    unit = f" {unit}" if unit else ""
    return Target(what, f"under {bound:g}{unit}", f"{figure(value)}{unit}{note}", value <= bound)


def targets(data: dict) -> list[Target]:
    """All that was to be reached and was measured in this run."""
    return [*_integrators(data["integrators"]), *_others(data), *_parts(data)]


def _integrators(found: dict) -> list[Target]:
    rows: list[Target] = []
    titles = {"end": "at the end point", "grid": "over the output grid"}
    counted = [i for i, goal in enumerate(found["goals"]) if goal is not None]
    for task, title in titles.items():
        for i in counted:
            if (mean := found["means"][task][i]) is not None:
                name = (
                    f"stiff problems, best peer's time over ours, mean at {power(found['targets'][i])} {title}"
                )
                rows.append(at_least(name, mean, found["goals"][i]))
    for task, title in titles.items():
        nine = [r for r in found["tasks"][task] if r["problem"] != found["ring"]]
        cells = [
            (c["ratio"], f" ({row['problem']} at {power(c['target'])}, against {c['peer']})")
            for row in nine
            for c in (row["cells"][i] for i in counted)
            if row["stiff"] and c["ratio"] is not None
        ]
        if cells:
            value, note = min(cells)
            rows.append(at_least(f"least of them all from 1e-3 to 1e-9 {title}", value, 1, note))
        for row in found["tasks"][task]:
            ratios = [row["cells"][i]["ratio"] for i in counted]
            ratios = [ratio for ratio in ratios if ratio is not None]
            if not ratios or (row["stiff"] and row["problem"] != found["ring"]):
                continue
            bound = found["ring_goal"] if row["problem"] == found["ring"] else 1
            rows.append(at_least(f"{row['problem']}, the least from 1e-3 to 1e-9 {title}", min(ratios), bound))
    name = "dense output: error over the tolerance asked for, worst of all"
    note = f", {found['dense']['within_three']:.0%} are within it"
    rows.append(at_most(name, found["dense"]["worst"], 3, "", note))
    name = "dense output: error over that of the steps' ends around, or over the tolerance"
    rows.append(at_most(name, found["dense"]["added"], 3, ""))
    return rows


def _others(data: dict) -> list[Target]:
    rows = []
    calls, together = data["calls"], data["ensembles"]["rows"]
    rows.append(at_most("the call around a solve", calls["overhead"]["call_us"], 15, "us"))
    cold = max(calls["cold"], key=lambda row: row["first_solve"])
    note = f" (rtol {power(cold['rtol'])})"
    rows.append(at_most("first solve of a process after the import", cold["first_solve"], 0.5, "s", note))
    if "2 threads" in together:
        two = together["2 threads"]
        rows.append(at_most("a run in an ensemble of 10^4 sleighs, two threads", two["best_us"], 10, "us"))
        ratio = 1 / two["best_ratio_to_one_thread"]
        rows.append(at_least("faster on two threads than on one", ratio, 1.8))
    for row in data["series"]:
        name = f"series of order {row['order']}, {row['model']}"
        rows.append(at_most(name, row["first"], row["bound"], "s"))
    for row in data["slow_manifold"]["points"]:
        if row["model"] in ("michaelis_menten", "davis_skodje", "van_der_pol"):
            spent = row["microseconds"]["order 10"]
            rows.append(at_most(f"slow manifold at a point, order 10, {row['model']}", spent, 3, "us"))
    for row in data["slow_manifold"]["many"]:
        name = f"slow manifold at 10^5 points, order 8, {row['model']}"
        rows.append(at_most(name, row["seconds"], 1, "s"))
    return rows


def _parts(data: dict) -> list[Target]:
    rows = []
    if loose := data.get("loose"):
        for i, error in enumerate(loose["errors"]):
            if loose["means"][i] is None:
                continue
            name = f"problems not tuned on, {loose['rival']}'s time over ours at {power(error)} over the output grid"
            rows.append(at_least(f"{name}, mean", loose["means"][i], loose["mean_goal"]))
            rows.append(at_least(f"{name}, least", loose["least"][i], loose["least_goal"]))
    large = data.get("large")
    if large and large["mean"] is not None:
        rows.append(at_least("large systems, best peer's time over ours, mean", large["mean"], large["goal"]))
        rows.append(at_least("large systems, best peer's time over ours, least", large["least"], large["goal"]))
    return rows


def render(data: dict) -> str:
    """The page as Markdown."""
    environment = Environment(
        loader=FileSystemLoader(HERE), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"figure": figure, "power": power}
    found = targets(data)
    return environment.get_template("page.md.jinja").render(
        **data, targets=found, short=[row for row in found if not row.is_met]
    )


if __name__ == "__main__":
    measured = json.loads((DOCS / "benchmarks.json").read_text(encoding="utf-8"))
    (DOCS / "benchmarks.md").write_text(render(measured), encoding="utf-8")
