"""Sums, products and powers that share their parts and are left as they are: never expanded, reordered or searched.

A straight-line program of a thousand steps is an expression whose parts are shared; written out it would fill no disk.
Each node here is known by a digest of how it was made, so that to compare two takes no walk, and shows itself by the
number of its operations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from hashlib import blake2b
from typing import Any

import sympy as sp

Expr = Any
# Brackets of a text stand at most so deep in each other: compilers count them.
DEEP = 12


@lru_cache(maxsize=65536)
def _digest(part: Any) -> bytes:
    if isinstance(part, _Shared):
        return part.digest
    if not part.args:
        return blake2b(f"{sp.srepr(part)}{getattr(part, 'dummy_index', '')}".encode(), digest_size=16).digest()
    return _combined(type(part).__name__, part.args)


def _combined(name: str, parts: Sequence[Any]) -> bytes:
    digest = blake2b(name.encode(), digest_size=16)
    for part in parts:
        digest.update(_digest(part))
    return digest.digest()


class _Shared:
    """What nodes that share their parts have in common."""

    __slots__ = ()
    args: tuple[Expr, ...]

    # SymPy makes some of these itself, so that what is known of a node is found when it is first asked for.

    @property
    def digest(self) -> bytes:
        """How it was made, in 16 bytes."""
        if not hasattr(self, "_digest"):
            self._digest = _combined(type(self).__name__, self.args)
        return self._digest

    def _hashable_content(self) -> tuple:
        return (self.digest,)

    @property
    def free_symbols(self) -> frozenset[sp.Symbol]:
        if not hasattr(self, "_symbols"):
            self._symbols = frozenset().union(*(part.free_symbols for part in self.args))
        return self._symbols

    def has(self, *patterns: Expr) -> bool:
        if all(isinstance(pattern, sp.Symbol) for pattern in patterns):
            return not self.free_symbols.isdisjoint(patterns)
        return any(part.has(*patterns) for part in parts_of(self) if not isinstance(part, _Shared))

    def xreplace(self, rule: Mapping[Expr, Expr]) -> Expr:
        return replaced(self, rule)

    def _sympystr(self, _printer: object) -> str:
        return f"({len(parts_of(self))} shared operations)"

    def _latex(self, _printer: object) -> str:
        return rf"\text{{({len(parts_of(self))} shared operations)}}"

    def __reduce_ex__(self, _protocol: object) -> tuple:
        return _made, (type(self).__name__, self.args)


class SharedSum(_Shared, sp.Add):
    """A sum as it stands."""

    __slots__ = ("_digest", "_symbols")


class SharedProduct(_Shared, sp.Mul):
    """A product as it stands."""

    __slots__ = ("_digest", "_symbols")

    def as_base_exp(self) -> tuple[Expr, Expr]:
        # SymPy looks for a common exponent of all factors, and for one of their factors.
        return self, sp.S.One


class SharedPower(_Shared, sp.Pow):
    """A power as it stands."""

    __slots__ = ("_digest", "_symbols")


class SharedMaximum(_Shared, sp.Max):
    """The largest as it stands."""

    __slots__ = ("_digest", "_symbols")

    def __new__(cls, *args: Expr, evaluate: bool = False) -> SharedMaximum:
        # SymPy puts the operands in order by their sizes, and walks what is shared as often as it is used.
        return sp.Expr.__new__(cls, *args)


_KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (SharedSum, SharedProduct, SharedPower, SharedMaximum)
}


def _made(name: str, args: Sequence[Expr]) -> Expr:
    kind = _KINDS[name]
    node = kind(*args, evaluate=False)
    # Asked from below upwards, so that no question goes deep.
    hash(node)
    _ = node.free_symbols
    return node


def parts_of(*expressions: Expr) -> list[Expr]:
    """Every different part of `expressions` that has parts itself, each once, after its own parts."""
    found: list[Expr] = []
    stack = [(expression, False) for expression in reversed(expressions)]
    entered: set[Expr] = set()
    while stack:
        part, is_done = stack.pop()
        if is_done:
            found.append(part)
        elif part.args and part not in entered:
            entered.add(part)
            stack.append((part, True))
            stack.extend((inner, False) for inner in part.args)
    return found


def operations(expressions: Iterable[Expr]) -> int:
    """How many operations `expressions` have when they are written out, what is shared as often as it is used."""
    outputs = tuple(expressions)
    known: dict[Expr, int] = {}
    for part in parts_of(*outputs):
        known[part] = max(len(part.args) - 1, 1) + sum(known.get(inner, 0) for inner in part.args)
    return sum(known.get(output, 0) for output in outputs)


def holding(expressions: Iterable[Expr], atoms: Collection[Expr]) -> list[bool]:
    """Whether each of `expressions` has one of `atoms` among its parts, each part looked at once over all of them."""
    known: dict[int, bool] = {}
    # Numbers may be made anew when they are asked for, and an address may not be used twice meanwhile.
    kept: list[tuple[Expr, ...]] = []
    result = []
    for expression in expressions:
        kept.append((expression,))
        stack: list[tuple[Expr, tuple[Expr, ...] | None]] = [(expression, None)]
        while stack:
            part, parts = stack.pop()
            if parts is not None:
                known[id(part)] = any(known[id(inner)] for inner in parts)
            elif id(part) not in known:
                parts = tuple(part.args)
                if parts:
                    kept.append(parts)
                    stack.append((part, parts))
                    stack.extend((inner, None) for inner in parts)
                else:
                    known[id(part)] = part in atoms
        result.append(known[id(expression)])
    return result


def plus(terms: Sequence[Expr]) -> Expr:
    """Their sum; zeros are left out, and numbers alone are added."""
    left = [term for term in terms if term is not sp.S.Zero]
    if all(term.is_Number for term in left):
        return sp.Add(*left)
    return left[0] if len(left) == 1 else _made("SharedSum", left)


def times(*factors: Expr) -> Expr:
    """Their product; ones are left out, and numbers alone are multiplied."""
    if sp.S.Zero in factors:
        return sp.S.Zero
    left = [factor for factor in factors if factor is not sp.S.One]
    if all(factor.is_Number for factor in left):
        return sp.Mul(*left)
    # A sign in front would be taken out again when code is written.
    left.sort(key=lambda factor: bool(factor.is_Number))
    return left[0] if len(left) == 1 else _made("SharedProduct", left)


def reciprocal(factor: Expr) -> Expr:
    """One over it."""
    return 1 / factor if factor.is_Number else _made("SharedPower", [factor, sp.S.NegativeOne])


def largest(*operands: Expr) -> Expr:
    """The largest of them."""
    return _made("SharedMaximum", operands)


def is_shared(expression: Expr) -> bool:
    """Whether it is left as it is; a sum that SymPy made of shared parts is not."""
    return isinstance(expression, _Shared)


def unshared(expression: Expr) -> Expr:
    """`expression` as SymPy makes it, with nothing shared: for one that is short when it is written out."""
    plain: dict[Expr, Expr] = {}
    for part in parts_of(expression):
        kind = next((kind.__mro__[2] for kind in _KINDS.values() if isinstance(part, kind)), part.func)
        args = tuple(plain.get(inner, inner) for inner in part.args)
        plain[part] = part if kind is part.func and args == part.args else kind(*args)
    return plain.get(expression, expression)


def named_parts(
    outputs: Sequence[Expr], names: Iterator[sp.Symbol], rule: Mapping[Expr, Expr]
) -> tuple[list[tuple[sp.Symbol, Expr]], list[Expr]]:
    """(parts by name, outputs), as `sympy.cse` gives them: what is used more than once, or is too deep, has a name.

    The expressions share nothing any more, and are left as they are. `rule` puts other symbols for theirs.
    """
    order = parts_of(*outputs)
    uses = Counter({*outputs})
    for part in order:
        uses.update(part.args)
    plain: dict[Expr, Expr] = {}
    depth: dict[Expr, int] = {}
    definitions: list[tuple[sp.Symbol, Expr]] = []
    for part in order:
        kind = next((kind.__mro__[2] for kind in _KINDS.values() if isinstance(part, kind)), part.func)
        written = kind(*(plain.get(inner, rule.get(inner, inner)) for inner in part.args), evaluate=False)
        deep = 1 + max(depth.get(inner, 0) for inner in part.args)
        if uses[part] > 1 or deep >= DEEP:
            symbol = next(names)
            definitions.append((symbol, written))
            plain[part] = symbol
        else:
            plain[part], depth[part] = written, deep
    return definitions, [plain.get(output, rule.get(output, output)) for output in outputs]


def size(expression: Expr) -> Expr:
    """Its absolute value."""
    # Evaluated, SymPy takes Abs apart into real and imaginary parts of symbols.
    return sp.Abs(expression, evaluate=False)


def replaced(expression: Expr, rule: Mapping[Expr, Expr]) -> Expr:
    """`expression` with what `rule` says in the place of its keys, each shared part once, however deep."""
    keys = frozenset(rule)
    held = frozenset().union(*(key.free_symbols for key in keys))
    done: dict[Expr, Expr] = {}
    stack = [expression]
    while stack:
        top: Any = stack[-1]
        if top in done:
            stack.pop()
            continue
        if top in keys:
            done[top] = rule[top]
        elif not top.args or held.isdisjoint(top.free_symbols):
            done[top] = top
        else:
            pending = [part for part in top.args if part not in done]
            if pending:
                stack.extend(pending)
                continue
            parts = [done[part] for part in top.args]
            kind = next((name for name, kind in _KINDS.items() if isinstance(top, kind.__mro__[2])), None)
            shares = any(isinstance(part, _Shared) for part in (top, *parts))
            done[top] = _made(kind, parts) if shares and kind is not None else top.func(*parts)
        stack.pop()
    return done[expression]
