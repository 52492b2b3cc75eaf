"""Whether the rate of a phase keeps its sign over a region: in ball arithmetic, by halving boxes."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp
from flint import arb

from gsp.errors import SplittingError
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.systems.flow import Values, in_words
from gsp.systems.region import Interval, shown_region

# Boxes that are looked at, a few milliseconds: a rate that comes near 0 averages badly anyway.
MOST_BOXES = 1024


def require_turning(
    omega: sp.Expr, phase: sp.Symbol, *, region: Mapping[str, Interval], parameters: Values
) -> None:
    """Raise `SplittingError` unless `omega` is proved to be nowhere 0 over `region`."""
    value = omega.xreplace(dict(parameters))
    symbols = sorted(value.free_symbols, key=str)
    unbounded = [s.name for s in symbols if s.name not in region]
    if unbounded:
        raise SplittingError(
            f"the phase {phase} turns at omega = {omega}, and no region bounds {', '.join(unbounded)}: it may stop.",
            "Give a region over which omega is nowhere 0.",
        )
    function = BallFunction(symbols, [value])
    box = tuple(region[s.name] for s in symbols)
    boxes, signs, count = [box], set(), 0
    while boxes:
        box, count = boxes.pop(), count + 1
        middle = [0.5 * (low + high) for low, high in box]
        signs.add(_sign(*function([balls.exact(m) for m in middle])))
        if len(signs) > 1 or None in signs or count > MOST_BOXES:
            if not symbols:
                raise SplittingError(
                    f"the phase {phase} turns at omega = {omega}, which is 0 at the parameters' values.",
                    "Give other values: what does not turn is no phase.",
                )
            met = "is 0 or changes its sign" if count <= MOST_BOXES else "comes near 0, or may do so,"
            where = in_words(zip(symbols, middle))
            raise SplittingError(
                f"the phase {phase} turns at omega = {omega}, which {met} over the region {shown_region(region)}"
                f"{f', near {where}' if where else ''}: there it is no fast phase.",
                "Shrink the region to where it turns; across the rest nothing can be averaged (a resonance).",
            )
        if _sign(*function([balls.hull(*side) for side in box])) is None:
            k = max(range(len(box)), key=lambda i: _width(box[i], region[symbols[i].name]))
            for half in ((box[k][0], middle[k]), (middle[k], box[k][1])):
                boxes.append((*box[:k], half, *box[k + 1 :]))


def _width(side: Interval, whole: Interval) -> float:
    return (side[1] - side[0]) / (whole[1] - whole[0])


def _sign(ball: arb) -> int | None:
    """1 or -1 where it is proved, else None."""
    return 1 if ball > 0 else -1 if ball < 0 else None
