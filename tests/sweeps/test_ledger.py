"""What a ledger says of the chunks of a sweep, whatever their number, and where it keeps it."""

from __future__ import annotations

from pathlib import Path

import pytest

from gsp.sweeps.ledger import Entry, Ledger


@pytest.fixture
def ledger(tmp_path: Path) -> Ledger:
    made = Ledger(tmp_path)
    made.create()
    return made


def test_what_is_entered_is_found_and_what_is_struck_is_not(ledger: Ledger) -> None:
    chunks = {0: {}, 999: {7: "no root"}, 1000: {1: "no start", 3: "no end"}, 123_456: {}}
    for chunk, messages in chunks.items():
        ledger.enter(chunk, Entry(f"sum of {chunk}", messages))
    assert ledger.done() == {0: 0, 999: 1, 1000: 2, 123_456: 0}
    for chunk, messages in chunks.items():
        assert ledger.entry(chunk) == Entry(f"sum of {chunk}", messages)
    assert ledger.entry(1) is None
    ledger.strike(999)
    assert ledger.entry(999) is None
    assert sorted(ledger.done()) == [0, 1000, 123_456]


def test_no_folder_holds_more_than_a_thousand_chunks_and_few_folders_hold_many(
    tmp_path: Path, ledger: Ledger
) -> None:
    """A folder of a million files is slow to list on most systems, and so are as many folders."""
    for chunk in range(0, 3000, 250):
        ledger.enter(chunk, Entry("", {}))
    assert sorted(shelf.name for shelf in (tmp_path / "ledger").iterdir()) == ["000", "001", "002"]
