"""How much of anything a model file may hold."""

from __future__ import annotations

from gsp.errors import ModelFileError


def at_most(limit: int, count: int, holder: str, things: str, remedy: str = "") -> None:
    """Raise `ModelFileError` where `count` passes the `limit`: "`holder` 9 `things`; 8 are allowed. `remedy`".

    >>> at_most(8, 3, "claims holds", "fields")
    """
    if count > limit:
        raise ModelFileError(
            f"{holder} {count} {things}; {limit} are allowed.", remedy, limit=limit, value=count
        )
