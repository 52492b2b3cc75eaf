"""Conditions as numbers: what is one where a condition holds and nothing where it does not, in words of model files.

`positive(u)` is 1 for u > 0 and 0 elsewhere, exactly, at 0 too. Both sides of a choice are worked out wherever one is,
so a side that is no number where the other one holds makes the choice no number there.
"""

from __future__ import annotations

POSITIVE = "sign(u)*(1 + sign(u))/2"


def compared(operator: str, left: str, right: str, *, positive: str) -> str:
    """One where `left` stands to `right` as `operator` says; `positive` is the name of the step.

    >>> compared(">=", "x", "1", positive="positive")
    '(1 - positive((1) - (x)))'
    """
    above, below = f"{positive}(({left}) - ({right}))", f"{positive}(({right}) - ({left}))"
    return {
        ">": above,
        "<": below,
        ">=": f"(1 - {below})",
        "<=": f"(1 - {above})",
        "==": f"(1 - abs(sign(({left}) - ({right}))))",
        "!=": f"abs(sign(({left}) - ({right})))",
    }[operator]


def both(first: str, second: str) -> str:
    return f"({first})*({second})"


def either(first: str, second: str) -> str:
    return f"(1 - (1 - ({first}))*(1 - ({second})))"


def one_of(first: str, second: str) -> str:
    """Exactly one of the two."""
    return f"abs(({first}) - ({second}))"


def negated(condition: str) -> str:
    return f"(1 - ({condition}))"


def truth(number: str) -> str:
    """The condition that `number` is not zero."""
    return f"abs(sign({number}))"


def chosen(condition: str, then: str, otherwise: str) -> str:
    """`then` where `condition` holds, else `otherwise`.

    >>> chosen("positive(x)", "x", "0")
    '((positive(x))*(x) + (1 - (positive(x)))*(0))'
    """
    return f"(({condition})*({then}) + (1 - ({condition}))*({otherwise}))"
