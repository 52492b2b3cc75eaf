"""The series as it is run: polynomials, or straight-line programs where these are shorter."""

from __future__ import annotations

from collections.abc import Callable

from gsp.errors import BudgetError
from gsp.slow.expansion import Expansion
from gsp.slow.series import LONGEST, SeriesManifold, series_of


def run_series(
    expansion: Expansion, order: int, written: Callable[[int], SeriesManifold] | None = None
) -> SeriesManifold:
    """The series through `order` with the parameters' values in: as straight-line programs where its polynomials
    have more than `LONGEST` terms, and more than the programs have steps.

    Polynomials of the orders before are looked at first, so that none is formed only to be found too long. `written`
    gives them where somebody keeps them. Raises `BudgetError` where neither is within its budget.
    """
    numeric = expansion.numeric
    series = None
    for reached in range(order + 1):
        try:
            series = series_of(numeric, reached) if written is None else written(reached)
            if max(series.sizes) <= LONGEST:
                continue
            if max(series.sizes) <= max(series_of(numeric.programs, reached).sizes):
                continue
        except BudgetError:
            pass
        return series_of(numeric.programs, order)
    assert series is not None
    return series
