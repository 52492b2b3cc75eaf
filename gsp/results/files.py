"""Rows of numbers and text as a CSV file, and files that are written whole or not at all."""

from __future__ import annotations

import csv
import io
import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from gsp.errors import OutputError
from gsp.results.interrupts import undisturbed


def write_rows(rows: Sequence[Mapping[str, object]], path: str | Path) -> Path:
    """Write `rows`, which share their keys, to `path` with a header; raises `OutputError` when that cannot be done."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]) if rows else [])
    writer.writeheader()
    writer.writerows(rows)
    return write_file(text.getvalue().encode(), path)


def write_file(content: bytes, path: str | Path) -> Path:
    """Write `content` to `path`, whole or not at all; raises `OutputError` when that cannot be done."""
    target = Path(path)
    try:
        if target.exists() and not target.is_file():
            # A device or a pipe keeps nothing that could be replaced.
            target.write_bytes(content)
            return target
        with (
            undisturbed(),
            tempfile.TemporaryDirectory(prefix=".gsp-", dir=target.absolute().parent) as scratch,
        ):
            built = Path(scratch, "built")
            built.write_bytes(content)
            if target.exists():
                with suppress(OSError):
                    built.chmod(target.stat().st_mode)
            os.replace(built, target)
    except OSError as error:
        raise OutputError(f"{target} cannot be written: {error.strerror}.", "Give another path.") from None
    return target
