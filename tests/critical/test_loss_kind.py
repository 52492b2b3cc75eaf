"""The vocabulary of losses: what is named has its row on the page."""

from __future__ import annotations

from pathlib import Path

from gsp.critical.loss_kind import LossKind

PAGE = Path(__file__).parents[2] / "docs" / "losses.md"


def test_every_kind_has_a_row_of_the_page() -> None:
    rows = [
        line.split("|")[1] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")
    ]
    kinds = {kind.strip() for row in rows for kind in row.split(",")}
    assert {str(kind) for kind in LossKind} - kinds == set()
