"""What reading a large file costs, in what is looked at: no piece of an expression twice."""

from __future__ import annotations

from collections import Counter

import pytest
import sympy as sp

from gsp.readers import nodes
from gsp.readers.parts import Parts
from gsp.readers.toml import read_model
from gsp.systems import declaration


def model(states: str, count: int) -> str:
    """A model file with the lines `states` for x0, x1, ... of which there are `count`."""
    return (
        f'epsilon = "e"\n[parameters]\nk = 2\n[states]\n{states}[region]\nx1 = [0, 1]\n[start]\n'
        + "".join(f"x{i} = 0.5\n" for i in range(count))
        + "[scene]\nspan = [0, 1]\nepsilon = 0.1\n"
    )


def test_pieces_that_equations_share_are_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: Counter = Counter()
    check = declaration._check_pieces

    def counted(expression: object, pieces: list) -> None:
        seen.update(pieces)
        check(expression, pieces)

    monkeypatch.setattr(declaration, "_check_pieces", counted)
    states = "".join(f'x{i} = "{"-x0/e" if i == 0 else "sin(x0)*k/(1 + x0^2) + x0"}"\n' for i in range(200))
    assert len(read_model(model(states, 200), name="shared").system.states) == 200
    assert set(seen.values()) == {1}
    assert len(seen) < 20


@pytest.mark.exhaustive
def test_what_expressions_share_is_built_and_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    built: Counter = Counter()
    looked_at: Counter = Counter()

    def counting(name: str) -> None:
        build = getattr(nodes, name)

        def counted(*arguments: object) -> object:
            built[name, repr(arguments)] += 1
            return build(*arguments)

        monkeypatch.setattr(nodes, name, counted)

    for name in ("sum_of", "product_of", "function_of"):
        counting(name)
    is_real = Parts.is_real

    def looking(self: Parts, expression: sp.Basic) -> bool:
        before = set(self._real)
        found = is_real(self, expression)
        looked_at.update(self._real - before)
        return found

    monkeypatch.setattr(Parts, "is_real", looking)
    rate = " + ".join(f"tanh(k - x{i % 5})*exp(-x{i % 3}/4)*x{i % 7}/(x{i % 2} + 3)" for i in range(25))
    states = "".join(f'x{i} = "{rate} - x{i}/e"\n' for i in range(60))
    assert len(read_model(model(states, 60), name="shared").system.states) == 60
    assert set(built.values()) == {1}
    assert set(looked_at.values()) == {1}
    # The 25 products of a state are those of every other; its own are a quotient and a sum.
    assert len(built) < 60 * 2 + 60
