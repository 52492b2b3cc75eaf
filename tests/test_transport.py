"""Every public noun goes through pickle, copy, deepcopy and a process of its own, and works where it arrives."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
import pytest

import gsp
from tests.cases import sampled
from tests.contracts import public


def simple(name: str) -> tuple[Callable[[], Any], Callable[[Any], Any]] | None:
    """The case of an enumeration and of an exception."""
    kind = getattr(gsp, name)
    if not inspect.isclass(kind):
        return None
    if issubclass(kind, Enum):
        return lambda: next(iter(kind)), str
    return (lambda: kind("a fact."), str) if issubclass(kind, Exception) else None


# What makes each noun, and what it is good for: text and numbers that have to be the same where it arrives.
CASES = {name: case for name in gsp.__all__ if (case := simple(name))} | public("NOUNS")


@cache
def noun(name: str) -> Any:
    return CASES[name][0]()


def good_for(name: str, value: Any) -> str:
    """What a noun gives, as text that has all the digits."""
    return written(CASES[name][1](value)) + repr(value)


def written(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.shape}{value.tobytes().hex()}" if value.dtype.kind in "fciub" else repr(value.tolist())
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {written(v)}" for k, v in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(written, value)) + "]"
    if is_dataclass(value) and not isinstance(value, type) and type(value).__module__.startswith("gsp"):
        return "(" + ", ".join(written(getattr(value, f.name)) for f in fields(value) if f.repr) + ")"
    return repr(value)


def work_elsewhere(connection: Any) -> None:
    """In a process of its own: nouns come in, what they are good for goes out."""
    while (message := connection.recv_bytes()) != b"":
        try:
            connection.send(good_for(*pickle.loads(message)))
        except Exception as error:
            connection.send(f"{type(error).__name__}: {error}")


@pytest.fixture(scope="module")
def elsewhere() -> Any:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=work_elsewhere, args=(theirs,), daemon=True)
    process.start()
    yield ours
    ours.send_bytes(b"")
    process.join(20)


# Nouns that take seconds to make.
DEAR = {"CanardOrbits", "Comparison", "FoldCurve", "MethodTable", "WorkPrecision"}


def test_every_public_noun_has_a_case() -> None:
    nouns = {name for name in gsp.__all__ if inspect.isclass(getattr(gsp, name))}
    assert set(CASES) == nouns


@pytest.mark.parametrize("name", sampled(CASES, always=set(list(CASES)[::2]) - DEAR))
def test_a_noun_works_where_it_arrives(name: str, elsewhere: Any) -> None:
    original = noun(name)
    assert type(original) is getattr(gsp, name)
    wanted = good_for(name, original)
    sent = pickle.dumps((name, original))
    for arrived in (pickle.loads(sent)[1], copy.copy(original), copy.deepcopy(original)):
        assert type(arrived) is type(original)
        assert good_for(name, arrived) == wanted
        if isinstance(original, Enum):
            assert arrived is original
    elsewhere.send_bytes(sent)
    assert elsewhere.poll(120)
    assert elsewhere.recv() == wanted
