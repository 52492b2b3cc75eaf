"""What turns fast in a model file: [phase], by a name, a pair of names, or both."""

from __future__ import annotations

from collections.abc import Mapping

from gsp.readers import toml_values as values
from gsp.scenes.fast_phase import FastPhase


def read_phase(table: Mapping[str, object]) -> FastPhase | None:
    """The phase of [phase], None where there is none; raises `ModelFileError` that names the key."""
    values.check_keys(table, ("name", "pair"), "phase.")
    if not table:
        return None
    return FastPhase(
        values.text(table.get("name", ""), "phase.name", 64), values.path(table.get("pair"), "phase.pair")
    )
