"""The error of questions about passages that have no answer."""

from __future__ import annotations

from gsp.errors import GspError


class PassageError(GspError):
    """A passage asked for where there is none: no fold, a degenerate one, an orbit that meets no loss."""
