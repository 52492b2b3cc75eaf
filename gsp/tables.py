"""Rows of numbers and text as a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from gsp.errors import OutputError


def write_rows(rows: Sequence[Mapping[str, object]], path: str | Path) -> Path:
    """Write `rows`, which share their keys, to `path` with a header; raises `OutputError` when that cannot be done."""
    target = Path(path)
    try:
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]) if rows else [])
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise OutputError(f"{target} cannot be written: {error.strerror}. Give another path.") from None
    return target
