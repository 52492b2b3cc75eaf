"""What a page says of a model without a small parameter: its time scales, the candidates, and which one is taken."""

from __future__ import annotations

import math
from typing import Any

from gsp.choice.verdict import seconds_shown
from gsp.reductions.reductions import Reductions
from gsp.reductions.special_parts import SpecialPart
from gsp.report.wording import number, words
from gsp.scenes.small_parameter import BOOKKEEPING


def reductions_found(found: Reductions) -> dict[str, Any]:
    """Values for the template: two sentences, a row for each candidate that is shown, and one for a special value."""
    rows = [
        {
            "name": words(each.name),
            "order": each.order,
            "error": number(each.error, 2) if math.isfinite(each.error) else "",
            "seconds": seconds_shown(each.seconds),
            "share": number(each.cost, 2),
            "why_not": words(each.why_not),
            "taken": each is found.taken,
        }
        for each in found.shown()
    ]
    special = [{"name": words(SpecialPart(each).name), "error": number(error, 2)} for each, error in found.near]
    return {
        "scales": words(found.scales.message),
        "reason": words(found.reason),
        "rows": rows,
        "special": special,
        "is_counted": found.taken is not None and found.taken.scene.epsilon == BOOKKEEPING,
    }
