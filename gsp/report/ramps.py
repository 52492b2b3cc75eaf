"""The section of a page on ramps: how fast parameters may move, and on which side the state tips."""

from __future__ import annotations

from typing import Any

from gsp.analysis.ramp_answers import ramp_answers
from gsp.report.wording import number, words
from gsp.scenes.scene import Scene
from gsp.singular.ramps.critical_rate import CriticalRate


def ramps(scene: Scene) -> list[dict[str, Any]]:
    """A row for each ramp: its name, what it does, the verdict, and the critical rates with their errors."""
    rows = []
    for name, answer in ramp_answers(scene).items():
        told = isinstance(answer, CriticalRate)
        rows.append(
            {
                "name": name,
                "ramp": str(scene.ramps[name].ramp),
                "verdict": str(answer.verdict) if told else "not told",
                "rates": ", ".join(number(rate, 6) for rate in answer.rates) if told else "",
                "why": words(answer.message if told else str(answer)),
            }
        )
    return rows


def ramps_as_json(scene: Scene) -> dict[str, Any]:
    """The same in plain values, by name."""
    return {
        name: {
            "verdict": str(answer.verdict),
            "rates": list(answer.rates),
            "errors": list(answer.errors),
            "start": dict(answer.start),
            "edge": None if answer.edge is None else dict(answer.edge),
            "message": answer.message,
        }
        if isinstance(answer, CriticalRate)
        else {"reason": str(answer)}
        for name, answer in ramp_answers(scene).items()
    }
