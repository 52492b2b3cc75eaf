"""Switches of epsilon: functions such as tanh(s/epsilon), regular in epsilon once v = s/epsilon is a variable.

A piece is a function, a root or a power in which epsilon stands. Each argument of it that is rational in epsilon is
written with epsilon = s/v, where s is the coefficient of its pole; under a root epsilon^m is taken out first, so that
sqrt(s^2 + epsilon^2) = epsilon sqrt(v^2 + 1).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import sympy as sp

from gsp.algebra.factorisation import coefficients, degree, factor_list, lowest_terms
from gsp.algebra.laurent import laurent, misplaced_epsilon, pole_order


def misplaced_pieces(expressions: Iterable[sp.Expr], epsilon: sp.Symbol) -> Iterator[sp.Expr]:
    """The largest parts in which `epsilon` stands inside a function, an exponent or a root, in order."""
    for expression in expressions:
        if not expression.has(epsilon) or expression == epsilon:
            continue
        if expression.is_Add or expression.is_Mul:
            yield from misplaced_pieces(expression.args, epsilon)
        elif expression.is_Pow and expression.exp.is_Integer:
            yield from misplaced_pieces((expression.base,), epsilon)
        else:
            yield expression


def surface_of(piece: sp.Expr, epsilon: sp.Symbol, states: Collection[sp.Symbol]) -> sp.Expr | None:
    """s, where `piece` is a function of s/epsilon and s of `states`; None where there is no such s."""
    for argument, highest in _arguments(piece, epsilon):
        order = pole_order(argument, epsilon)
        power = order or highest
        lowest = laurent(argument, epsilon, order=-order).get(-order, sp.S.Zero)
        surface = _root(lowest, power, states) if power else None
        if surface is not None and in_fast(piece, epsilon, surface, sp.Dummy("v")) is not None:
            return surface
        together = [z for z in states if lowest.has(z)]
        if power and surface is None and _scales(piece, epsilon, together):
            # As in sqrt(x^2 + y^2 + epsilon^2): one state after the other.
            return together[0]
    return None


def _scales(piece: sp.Expr, epsilon: sp.Symbol, states: Collection[sp.Symbol]) -> bool:
    """Whether multiples of epsilon for all of several `states` make `piece` rational in it."""
    if len(states) < 2:
        return False
    moved = piece.xreplace({z: epsilon * sp.Dummy(z.name) for z in states})
    for argument, _ in _arguments(moved, epsilon):
        powers = coefficients(lowest_terms(argument), epsilon)
        if powers is None or sum(power != 0 for power in powers) != 1:
            return False
    return True


def in_fast(piece: sp.Expr, epsilon: sp.Symbol, surface: sp.Expr, fast: sp.Symbol) -> sp.Expr | None:
    """`piece` with `fast` for surface/epsilon; None where that does not make it rational in epsilon."""
    if not piece.has(epsilon):
        return piece
    if misplaced_epsilon(piece, epsilon) is None:
        return _regular(lowest_terms(piece.xreplace({epsilon: surface / fast})), surface, fast)
    scale, parts = sp.S.One, list(piece.args)
    for argument, highest in _arguments(piece, epsilon):
        if highest and not pole_order(argument, epsilon) and argument == piece.args[0]:
            # Under a root of a sum such as s^2 + epsilon^2; epsilon is positive.
            scale = epsilon ** (highest * piece.args[1])
            parts[0] = sp.expand(argument / epsilon**highest)
    inner = [in_fast(part, epsilon, surface, fast) for part in parts]
    if any(part is None for part in inner):
        return None
    found = scale * piece.func(*inner)
    return found if misplaced_epsilon(found, epsilon) is None else None


def _arguments(piece: sp.Expr, epsilon: sp.Symbol) -> Iterator[tuple[sp.Expr, int]]:
    """The outermost parts of a piece that are rational in epsilon, and the degree in it of what stands under a root."""
    for part in piece.args:
        if not part.has(epsilon):
            continue
        if misplaced_epsilon(part, epsilon) is not None:
            yield from _arguments(part, epsilon)
            continue
        under_root = piece.is_Pow and part == piece.args[0]
        highest = (degree(part, [epsilon]) or 0) if under_root else 0
        yield part, highest if highest and (highest * piece.args[1]).is_Integer else 0


def _root(coefficient: sp.Expr, power: int, states: Collection[sp.Symbol]) -> sp.Expr | None:
    """The root of this power, without factors that no state is in; None where there is none or no state."""
    content, primitive = coefficient.primitive()
    # Whole numbers only: 1/5 - u is not (1 - 5 u)/5.
    parts = [part.as_base_exp() for part in sp.Mul.make_args(primitive if content.is_Integer else coefficient)]
    factors = [(base, int(k)) if k.is_Integer else (base**k, 1) for base, k in parts]
    if any(k % power for base, k in factors if not base.free_symbols.isdisjoint(states)):
        factors = factor_list(coefficient)[1]
    moving = [(factor, k) for factor, k in factors if not factor.free_symbols.isdisjoint(states)]
    if not any(k > 0 for _, k in moving) or any(k % power for _, k in moving):
        return None
    return sp.Mul(*(factor ** (k // power) for factor, k in moving))


def _regular(expression: sp.Expr, surface: sp.Expr, fast: sp.Symbol) -> sp.Expr | None:
    """`expression`, unless it has a pole where the surface or the fast variable is 0."""
    bottom = sp.fraction(expression)[1]
    if not bottom.has(fast) and bottom.is_number:
        return expression
    on_surface = sp.fraction(lowest_terms(bottom / surface))[1]
    return None if bottom.xreplace({fast: sp.S.Zero}) == 0 or on_surface.is_number else expression
