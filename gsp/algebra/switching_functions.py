"""Functions of which the zeros are where expressions are not smooth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from gsp.algebra.functions import NON_SMOOTH
from gsp.algebra.sharing import is_shared, parts_of, replaced


@dataclass(frozen=True)
class SwitchingFunction:
    """A non-smooth function `source` of the field, not smooth where `surface` = 0."""

    surface: sp.Expr
    source: str


def switches(expressions: Sequence[sp.Expr], variables: Sequence[sp.Symbol]) -> tuple[SwitchingFunction, ...]:
    """The switching functions of `expressions` that depend on `variables`, each once up to its sign."""
    found: dict[sp.Expr, SwitchingFunction] = {}
    for expression in expressions:
        for atom in nodes([expression], (*NON_SMOOTH, sp.Pow)):
            for surface in _surfaces(atom):
                if surface.has(*variables) and surface not in found and -surface not in found:
                    found[surface] = SwitchingFunction(surface, str(atom))
    return tuple(found.values())


def on_side(expression: sp.Expr, surface: sp.Expr, side: int) -> sp.Expr:
    """What the expression is where `surface`, one of its switching functions, has the sign `side`; kinks stay."""
    known: dict[sp.Expr, Any] = {}
    for atom in nodes([expression], (sp.sign, sp.Heaviside)):
        for turned in (1, -1):
            if atom.args[0] == turned * surface:
                above = sp.Integer(side * turned)
                known[atom] = above if isinstance(atom, sp.sign) else (1 + above) / 2
    relations = set().union(*(_relations(atom) for atom in nodes([expression], (sp.Piecewise,))))
    for relation in relations:
        for turned in (1, -1):
            if relation.lhs - relation.rhs == turned * surface:
                known[relation] = relation.func(side * turned, 0)
    return replaced(expression, known) if known else expression


def nodes(expressions: Sequence[sp.Expr], kinds: tuple[type, ...]) -> list[sp.Expr]:
    """The different parts of the expressions that are of these kinds, each looked at once however often it is used."""
    found = [part for part in parts_of(*expressions) if isinstance(part, kinds)]
    # SymPy's order walks what is shared as often as it is used.
    return found if any(map(is_shared, parts_of(*found))) else sorted(found, key=sp.default_sort_key)


def _surfaces(atom: sp.Expr) -> list[sp.Expr]:
    if isinstance(atom, sp.Pow):
        # An exponential is never 0.
        rough = atom.exp.is_number and not atom.exp.is_integer and not isinstance(atom.base, sp.exp)
        return [atom.base] if rough else []
    if isinstance(atom, (sp.Max, sp.Min)):
        arguments = atom.args
        return [a - b for i, a in enumerate(arguments) for b in arguments[:i]]
    if isinstance(atom, sp.Piecewise):
        return [r.lhs - r.rhs for r in sorted(_relations(atom), key=sp.default_sort_key)]
    if isinstance(atom, (sp.floor, sp.ceiling)):
        return [sp.sin(sp.pi * atom.args[0])]
    return [atom.args[0]]


def _relations(atom: sp.Piecewise) -> set[sp.Expr]:
    return set().union(*(condition.atoms(sp.core.relational.Relational) for _, condition in atom.args))
