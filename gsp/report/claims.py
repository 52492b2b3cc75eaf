"""The claims of a scene's other reductions, judged by the slopes of their errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import sympy as sp
from markupsafe import Markup

from gsp.report.wording import fitted

if TYPE_CHECKING:
    from gsp.report.sections import Page

# A slope this far below what a field promises is a failure of the field, not of the measurement.
SLOPE_TOLERANCE = 0.25
ORDINALS = ("leading", "first", "second", "third", "fourth", "fifth", "sixth")


def claims_of(page: Page) -> list[dict[str, Any]]:
    """What other reductions claim, each with the slope measured and the verdict."""
    comparison = page.analysis.comparison
    result = []
    for name, rates in page.analysis.scene.claims.items():
        promised = max((_degree(rate, page.epsilon) for rate in rates.values()), default=0) + 1
        slope = comparison.claim_slopes[name]
        result.append(
            {
                "name": name,
                "field": page.rates((s, page.by_power(r)) for s, r in rates.items()),
                "promised": promised,
                "slope": fitted(slope),
                "errors": comparison.claims[name],
                "right": slope >= promised - SLOPE_TOLERANCE,
                "verdict": _judged(page, slope, promised),
            }
        )
    return result


def _judged(page: Page, slope: float, promised: int) -> Markup:
    epsilon = page.inline(page.epsilon)
    if math.isnan(slope):
        return Markup("no error above rounding, or no run finished: nothing to fit")
    if slope >= promised - SLOPE_TOLERANCE:
        return Markup("error falls like {}<sup>{:.1f}</sup>: right through order {}").format(
            epsilon, slope, promised - 1
        )
    wrong = max(0, round(slope))
    ordinal = ORDINALS[wrong] if wrong < len(ORDINALS) else f"{wrong}th"
    return Markup("error falls like {}<sup>{:.1f}</sup>, not {}<sup>{}</sup>: wrong at {} order").format(
        epsilon, slope, epsilon, promised, ordinal
    )


def _degree(rate: sp.Expr, epsilon: sp.Symbol) -> int:
    """Through which power of epsilon a rate claims to be right: its degree, or 0 when it is no polynomial."""
    expanded = sp.expand(rate)
    return (
        int(sp.Poly(expanded, epsilon).degree())
        if expanded.has(epsilon) and expanded.is_polynomial(epsilon)
        else 0
    )
