"""Plan files: a sweep written down in TOML.

    task = "compare"                  # a verb
    model = "chaplygin_sleigh"        # a built-in name, or a model file beside this one

    [options]                         # optional, of the verb
    orders = [0, 1]

    [over]                            # the axes; the last runs fastest
    a = [0.1, "1/3"]
    epsilon = { from = 1e-3, to = 0.1, count = 20, spacing = "log" }

A file is untrusted: it names verbs, never functions.
"""

from __future__ import annotations

import os
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from gsp.errors import DeclarationError, ModelFileError
from gsp.readers import toml_values
from gsp.readers.toml import read_document
from gsp.results.point_verbs import point_verbs
from gsp.systems.arguments import check_whole, shown

KEYS = ("task", "model", "options", "over", "points_per_chunk")
RANGE = ("from", "to", "count", "spacing")


def read_plan_file(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The arguments of `sweep` that a plan file gives; raises `ModelFileError`, prefixed with the file's name."""
    file = Path(path)
    try:
        return _arguments(read_document(file), file.parent)
    except (DeclarationError, ModelFileError) as error:
        raise ModelFileError.of(error, file.name) from None


def _arguments(document: dict, folder: Path) -> dict[str, Any]:
    for key in document:
        if key not in KEYS:
            raise ModelFileError.none_of(KEYS, key, f"{key} is no key of a plan.", "The keys are")
    task = document.get("task")
    known = tuple(point_verbs())
    if task not in known:
        raise ModelFileError(f"task is a verb: {', '.join(known)}.", got=shown(task), value=task, known=known)
    model = document.get("model")
    if not isinstance(model, str) or not model:
        raise ModelFileError("model is a built-in name or a model file.", got=shown(model), value=model)
    over = document.get("over")
    if not isinstance(over, dict) or not over:
        raise ModelFileError("[over] gives each axis its values.", got=shown(over), value=over)
    options = toml_values.table(document, "options")
    found: dict[str, Any] = {
        "task": task,
        "model": folder / model if (folder / model).is_file() else model,
        "options": {key: _plain(value) for key, value in options.items()},
        "over": {name: _values(values, f"over.{name}") for name, values in over.items()},
    }
    if "points_per_chunk" in document:
        found["points_per_chunk"] = check_whole(document["points_per_chunk"], what="points_per_chunk", least=1)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, Decimal):
        return float(value)
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _values(values: Any, key: str) -> list[float]:
    if isinstance(values, list):
        return [float(toml_values.number(value, key)) for value in values]
    if not isinstance(values, dict):
        raise ModelFileError(
            f"{key} is a list of numbers, or a range such as {{ from = 0, to = 1, count = 11 }}.",
            got=shown(values),
            value=values,
        )
    toml_values.check_keys(values, RANGE, f"{key}.")
    missing = [name for name in RANGE[:3] if name not in values]
    if missing:
        raise ModelFileError(f"{key} lacks {', '.join(missing)}.", "Write { from = 0, to = 1, count = 11 }.")
    low, high = (float(toml_values.number(values[name], f"{key}.{name}")) for name in RANGE[:2])
    # Values along an axis that a range may ask for.
    count = check_whole(values["count"], what=f"{key}.count", least=1, most=10_000_000)
    spacing = values.get("spacing", "linear")
    if spacing not in ("linear", "log"):
        raise ModelFileError(f'{key}.spacing is "linear" or "log".', got=shown(spacing), value=spacing)
    if spacing == "log" and not (low > 0.0 and high > 0.0):
        raise ModelFileError(
            f"{key} is spaced evenly in its logarithm, from {low:g} to {high:g}.", "Give positive ends."
        )
    return (np.geomspace if spacing == "log" else np.linspace)(low, high, count).tolist()
