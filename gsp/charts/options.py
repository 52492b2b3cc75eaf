"""What the options of a chart take, as their annotations say, checked before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from gsp.errors import DeclarationError
from gsp.systems.arguments import shown


def check_options(given: Mapping[str, Any], hints: Mapping[str, Any], *, verb: str) -> None:
    """Raises `DeclarationError` for the first option that is not what its hint says."""
    for name, value in given.items():
        if name in hints and not _fits(value, hints[name]):
            wanted = " or ".join(_words(kind) for kind in _kinds(hints[name]) if kind is not NoneType)
            out = ", or leave it out" if NoneType in _kinds(hints[name]) else ""
            raise DeclarationError(
                f"{name} of {verb} is {wanted}.", f"Give one{out}.", got=shown(value), value=value
            )


def _kinds(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _fits(value: Any, hint: Any) -> bool:
    if len(kinds := _kinds(hint)) > 1:
        return any(_fits(value, kind) for kind in kinds)
    inner = get_args(hint)
    if get_origin(hint) is tuple:
        return isinstance(value, (tuple, list)) and len(value) == len(inner) and all(map(_fits, value, inner))
    if inner:
        return isinstance(value, Sequence) and all(_fits(one, inner[0]) for one in value)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    return isinstance(value, hint)


def _words(kind: Any) -> str:
    inner = get_args(kind)
    if get_origin(kind) is tuple:
        return "a pair of names"
    if inner:
        return f"a list of {inner[0].__name__}"
    plain = {str: "a name", int: "a whole number", bool: "True or False"}
    return plain.get(kind, f"a {kind.__name__}")
