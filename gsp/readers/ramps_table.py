"""Ramps of a model file: [ramps.NAME] each, by one of the usual profiles or by expressions in the phase."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import sympy as sp

from gsp.errors import ModelFileError, nearest
from gsp.readers import toml_values as values
from gsp.readers.expressions import Definitions
from gsp.scenes.ramp_question import RampQuestion
from gsp.systems.ramp import PHASE, Ramp

KINDS: Mapping[str, Callable[..., Ramp]] = {
    "tanh": Ramp.tanh,
    "logistic": Ramp.logistic,
    "linear": Ramp.linear,
    "linear with ends": Ramp.linear_with_ends,
    "there and back": Ramp.there_and_back,
}
_KEYS = ("profile", "parameters", "ends", "edge", "start")


def read_ramps(
    tables: Mapping[str, object], symbols: Mapping[str, sp.Symbol], definitions: Definitions
) -> dict[str, RampQuestion]:
    """The questions of [ramps]; raises `ModelFileError` that names the key."""
    found = {}
    for name, key, table in values.named_tables("ramps", tables, 16):
        values.check_keys(table, _KEYS, f"{key}.")
        profile = values.text(table.get("profile", ""), f"{key}.profile", 1000)
        moved = values.table(table, "parameters")
        for parameter in moved:
            if parameter not in symbols:
                raise ModelFileError(
                    f"{key}.parameters.{parameter[:64]} is unknown. A ramp moves parameters."
                    f"{nearest(parameter[:64], symbols)}"
                )
        points = {what: values.point(table, what, f"{key}.{what}") for what in ("edge", "start")}
        if profile in KINDS:
            if "ends" in table:
                raise ModelFileError(f"{key}.ends belongs to a profile that is an expression.", "Leave it out.")
            ramp = KINDS[profile](
                {symbols[p]: _values(value, f"{key}.parameters.{p}") for p, value in moved.items()}
            )
        else:
            ramp = _by_expressions(table, key, symbols, definitions)
        found[name] = RampQuestion(ramp, **points)
    return found


def _values(value: object, key: str) -> sp.Expr | tuple[sp.Expr, ...]:
    """(from, to), or the number at which a linear ramp begins."""
    return tuple(values.numbers(value, key)) if isinstance(value, list) else values.number(value, key)


def _by_expressions(table: dict, key: str, symbols: Mapping[str, sp.Symbol], definitions: Definitions) -> Ramp:
    if "profile" not in table:
        raise ModelFileError(
            f"{key}.profile is missing.",
            f"Write one of {', '.join(map(repr, KINDS))}, or an expression in {PHASE}, with ends.",
        )
    if PHASE.name in symbols:
        raise ModelFileError(
            f"{key}: {PHASE} is a name of the model, and the ramp's phase too.", "Rename it in the model."
        )
    ends = values.numbers(table["ends"], f"{key}.ends") if "ends" in table else []
    if len(ends) not in (1, 2):
        raise ModelFileError(
            f"{key}.ends are two phases, or one for a ramp without end, where the profile is an expression.",
            f"Write ends = [0, 1], or for the profile one of {', '.join(map(repr, KINDS))}.",
        )
    known = {**symbols, PHASE.name: PHASE}
    return Ramp(
        {
            symbols[p]: values.expression(value, f"{key}.parameters.{p}", known, definitions)
            for p, value in values.table(table, "parameters").items()
        },
        values.expression(table["profile"], f"{key}.profile", known, definitions),
        (ends[0], ends[1] if len(ends) == 2 else None),
    )
