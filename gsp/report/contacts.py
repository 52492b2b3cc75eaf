"""The section of a page on contacts with dry friction: whether no-slip holds along the run, and how far they creep."""

from __future__ import annotations

from math import isfinite
from typing import Any

from gsp.analysis.analysis import Analysis
from gsp.report.wording import number, words


def no_slip(analysis: Analysis) -> dict[str, Any]:
    """The answer in a sentence, and for each contact its largest share and how far it creeps at the scene's epsilon."""
    found = analysis.no_slip
    assert found is not None
    distances = found.distance(analysis.scene.epsilon)
    rows = [
        {
            "name": name,
            "share": number(float(shares.max()), 4),
            "creep": number(float(crept), 4) if isfinite(crept) else "∞",
        }
        for name, shares, crept in zip(found.names, found.shares, distances)
    ]
    return {"sentence": words(str(found)), "rows": rows, "until": number(float(found.t[-1]), 4)}


def no_slip_as_json(analysis: Analysis) -> dict[str, Any] | None:
    """The same in plain values; None for a scene without dry friction."""
    found = analysis.no_slip
    if found is None:
        return None
    return {
        "holds": found.holds,
        "message": str(found),
        "loss": None if found.loss is None else str(found.loss),
        "contact": None if found.contact is None else found.names[found.contact],
        "time": found.time,
        "place": None if found.place is None else dict(found.place),
        "contacts": list(found.names),
        "largest_shares": found.shares.max(axis=1).tolist(),
        "creep": found.distance(analysis.scene.epsilon).tolist(),
    }
