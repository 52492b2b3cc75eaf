"""Exact numbers as doubles."""

from __future__ import annotations

from typing import Any

from gsp.errors import BudgetError


def printed_double(number: Any) -> str:
    """The double nearest to a rational number, as text that reads back as it; raises `BudgetError` beyond 1e308."""
    try:
        return repr(int(number.p) / int(number.q))
    except OverflowError:
        raise BudgetError(
            f"a number of {len(str(abs(int(number.p))))} digits is beyond double precision.",
            "Give one below 1e308.",
        ) from None
