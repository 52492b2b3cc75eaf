"""What reading a large file costs, in what is looked at: no piece of an expression twice."""

from __future__ import annotations

from collections import Counter

import pytest

from gsp.readers.toml import read_model
from gsp.systems import declaration


def test_pieces_that_equations_share_are_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: Counter = Counter()
    check = declaration._check_pieces

    def counted(expression: object, pieces: list) -> None:
        seen.update(pieces)
        check(expression, pieces)

    monkeypatch.setattr(declaration, "_check_pieces", counted)
    states = "".join(f'x{i} = "{"-x0/e" if i == 0 else "sin(x0)*k/(1 + x0^2) + x0"}"\n' for i in range(200))
    text = (
        f'epsilon = "e"\n[parameters]\nk = 2\n[states]\n{states}[region]\nx1 = [0, 1]\n[start]\n'
        + "".join(f"x{i} = 0.5\n" for i in range(200))
        + "[scene]\nspan = [0, 1]\nepsilon = 0.1\n"
    )
    assert len(read_model(text, name="shared").system.states) == 200
    assert set(seen.values()) == {1}
    assert len(seen) < 20
