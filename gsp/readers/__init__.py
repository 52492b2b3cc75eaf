"""Model files: a path to a `Scene`, or an error and nothing; and a `Scene` to a file."""

from __future__ import annotations

from gsp.readers.loading import load
from gsp.readers.writing import save

__all__ = ["load", "save"]
