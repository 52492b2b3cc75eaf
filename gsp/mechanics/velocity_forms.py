"""Velocity constraints read as one-forms: A(q) qdot + c(q), checked for independence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.mechanics.algebra import Algebra, entries, generic_points, numbers
from gsp.mechanics.lagrangian import SINGULAR, LagrangianSystem, balanced


@dataclass(frozen=True)
class VelocityForms:
    """`expressions` = `matrix` qdot + `offset`, k of them; `names` where the user gave some.

    `rows` (k + h, n) are `matrix` and, behind it, the forms of the system's holonomic constraints.
    """

    expressions: tuple[sp.Expr, ...]
    matrix: sp.ImmutableMatrix
    offset: tuple[sp.Expr, ...]
    names: tuple[sp.Symbol | None, ...]
    rows: sp.ImmutableMatrix

    @property
    def count(self) -> int:
        """k."""
        return len(self.expressions)


def linear_form(system: LagrangianSystem, expression: sp.Expr, what: str) -> tuple[list[Any], Any]:
    """(coefficients, offset) of an expression affine in the velocities; raises `DeclarationError` otherwise."""
    exact = sp.expand(system.checked(expression, what))
    coefficients = [sp.diff(exact, v) for v in system.velocities]
    for v, slope in zip(system.velocities, coefficients):
        if slope.has(*system.velocities):
            raise DeclarationError(
                f"{what}, {expression}, is not linear in the velocities: its derivative by {v} is {slope}.",
                "Only constraints A(q) qdot + c(q) are covered.",
            )
    for t in system.clock:
        if exact.has(t):
            raise DeclarationError(
                f"{what}, {expression}, depends on time {t}.",
                "Time-dependent constraints are not covered: use coordinates in which it does not contain "
                f"{t}.",
            )
    return coefficients, exact.xreplace(dict.fromkeys(system.velocities, sp.Integer(0)))


def read_constraints(
    system: LagrangianSystem,
    constraints: Sequence[sp.Expr] | Mapping[sp.Symbol, sp.Expr],
    *,
    may_stop: bool = False,
) -> VelocityForms:
    """The constraints as forms; raises `DeclarationError` when one is none or depends on others, and unless they
    `may_stop` all motion when they leave none.
    """
    if isinstance(constraints, Mapping):
        names, given = tuple(constraints), tuple(constraints.values())
        for name in names:
            if not isinstance(name, sp.Symbol):
                raise DeclarationError(
                    "constraints are named by SymPy symbols.", got=f"the key {name!r}", value=name
                )
    else:
        if isinstance(constraints, sp.Basic):
            raise DeclarationError(
                "constraints is a sequence of expressions.",
                "Write [...].",
                got=f"{constraints!r}",
                value=constraints,
            )
        given = tuple(constraints)
        names = (None,) * len(given)
    if not given and not system.holonomic:
        raise DeclarationError(
            "there is no constraint.", "Use LagrangianSystem.euler_lagrange() without any.", got="[]"
        )
    rows, offset = [], []
    for i, expression in enumerate(given):
        coefficients, rest = linear_form(system, expression, f"constraint {i + 1}")
        if all(a == 0 for a in coefficients):
            raise DeclarationError(
                f"constraint {i + 1}, {expression}, contains no velocity.",
                "A constraint on positions is holonomic (Remark 2.4): differentiate it by time, or choose "
                "coordinates that satisfy it.",
            )
        rows.append(coefficients)
        offset.append(rest)
    n = len(system.velocities)
    matrix = sp.ImmutableMatrix(len(rows), n, [a for row in rows for a in row])
    held = system.holonomic_forms
    forms = VelocityForms(tuple(given), matrix, tuple(offset), names, sp.ImmutableMatrix(matrix.col_join(held)))
    _refuse_dependent(system, forms)
    if not may_stop and len(given) + held.rows >= n:
        raise DeclarationError(
            f"{len(given) + held.rows} constraints on {n} velocities leave no motion: "
            f"{', '.join(map(str, (*given, *system.holonomic)))}.",
            "Give fewer constraints than coordinates.",
        )
    return forms


def _refuse_dependent(system: LagrangianSystem, forms: VelocityForms) -> None:
    n = len(system.coordinates)
    points = generic_points(3, n)
    matrices = numbers(entries(forms.rows), system.coordinates, points, system.values).reshape(3, -1, n)
    kept: list[int] = []
    for i in range(forms.count):
        wider = [*kept, i]
        if max(rank(matrix[wider]) for matrix in matrices) == len(wider):
            kept.append(i)
            continue
        raise DeclarationError(_dependence(system, forms, kept, i, matrices[0]))
    if max(rank(matrix) for matrix in matrices) < forms.rows.rows:
        listed = ", ".join(f"{F} = 0" for F in system.holonomic)
        raise DeclarationError(
            f"the constraints {', '.join(map(str, forms.expressions))} depend on the holonomic ones {listed}.",
            "Leave out what these say already.",
        )


def _dependence(
    system: LagrangianSystem, forms: VelocityForms, kept: list[int], i: int, values: np.ndarray
) -> str:
    """Which combination of earlier constraints the i-th one is, and whether its offset agrees."""
    fact = f"constraint {i + 1}, {forms.expressions[i]}, depends on the others"
    if not kept:
        return f"{fact}: it vanishes at the parameters' values. Leave it out."
    algebra = Algebra(system.coordinates, tuple(system.values), [*entries(forms.matrix), *forms.offset])
    columns: list[int] = []
    for j in range(values.shape[1]):
        if len(columns) < len(kept) and rank(values[np.ix_(kept, [*columns, j])]) == len(columns) + 1:
            columns.append(j)
    A = algebra.matrix(forms.matrix)
    block = algebra.inverse([[A[r][j] for j in columns] for r in kept])
    shares = algebra.apply([list(c) for c in zip(*block)], [A[i][j] for j in columns])
    left = [row - _combination(algebra, shares, [A[r][j] for r in kept]) for j, row in enumerate(A[i])]
    if any(not e.reduced().is_zero for e in left):
        return f"{fact} at the parameters' values. Leave it out, or change the values."
    terms = [(algebra.write(share), r) for share, r in zip(shares, kept)]
    listed = " + ".join(f"({share})*(constraint {r + 1})" for share, r in terms if share != 0)
    offsets = [algebra.read(c) for c in forms.offset]
    gap = algebra.write(offsets[i] - _combination(algebra, shares, [offsets[r] for r in kept]))
    if gap != 0:
        return (
            f"constraint {i + 1}, {forms.expressions[i]}, is inconsistent with the others: it is {listed} "
            f"+ {gap}, and both cannot vanish. Correct it or leave it out."
        )
    dependent = ", ".join(f"constraint {r + 1} is {forms.expressions[r]}" for share, r in terms if share != 0)
    return f"{fact}: it is {listed}, where {dependent}. Leave it out."


def _combination(algebra: Algebra, shares, elements):
    return algebra.apply([list(shares)], list(elements))[0]


def rank(matrix: np.ndarray) -> int:
    """Rank of a matrix of numbers, to rounding, in whatever units of its rows and columns."""
    largest = np.abs(matrix).max(axis=1, keepdims=True)
    # Beside the others what is left of a row that vanishes is rounding.
    matrix = np.where(largest > np.finfo(float).eps * largest.max(), matrix, 0.0)
    sizes = np.linalg.svd(balanced(matrix), compute_uv=False)
    return int((sizes > SINGULAR**0.75 * sizes[0]).sum())
