"""Elementary functions by their differential equations: v = F(u) solves dv/du = rate(v, u).

One table serves the exact ring, where v is a generator with a derivation, and power series in epsilon, where
k v_k = sum_j j u_j rate_(k-j). The operands support + - *, `inverse()` and `apply(name, ...)`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from operator import add
from typing import Any, NamedTuple

import sympy as sp

from gsp.errors import UnsupportedFunctionError, met_at

Operand = Any
"""An `Element` of the ring or a `Node` of a series program; the rates are written once for both."""


class Rule(NamedTuple):
    """How one function is adjoined: its derivative, and its value at 0 where that is rational."""

    rate: Callable[[Operand, Operand], Operand] | None
    at_zero: int | None = None


def _reciprocal_root(square: Operand) -> Operand:
    return square.apply("sqrt").inverse()


RULES: dict[str, Rule] = {
    "exp": Rule(lambda v, u: v, at_zero=1),
    "log": Rule(lambda v, u: u.inverse()),
    "sqrt": Rule(lambda v, u: (v * 2).inverse()),
    "sin": Rule(lambda v, u: u.apply("cos"), at_zero=0),
    "cos": Rule(lambda v, u: -u.apply("sin"), at_zero=1),
    "tan": Rule(lambda v, u: v * v + 1, at_zero=0),
    "sinh": Rule(lambda v, u: u.apply("cosh"), at_zero=0),
    "cosh": Rule(lambda v, u: u.apply("sinh"), at_zero=1),
    "tanh": Rule(lambda v, u: -(v * v) + 1, at_zero=0),
    "asin": Rule(lambda v, u: _reciprocal_root(-(u * u) + 1), at_zero=0),
    "acos": Rule(lambda v, u: -_reciprocal_root(-(u * u) + 1)),
    "atan": Rule(lambda v, u: (u * u + 1).inverse(), at_zero=0),
    "asinh": Rule(lambda v, u: _reciprocal_root(u * u + 1), at_zero=0),
    "acosh": Rule(lambda v, u: _reciprocal_root(u * u + (-1))),
    "atanh": Rule(lambda v, u: (-(u * u) + 1).inverse(), at_zero=0),
    "erf": Rule(lambda v, u: (-(u * u)).apply("exp") * u.apply("pi").apply("sqrt").inverse() * 2, at_zero=0),
    "sign": Rule(None),
}
# Written with `sign`: by `composed`, once for every kind of operand.
COMPOSED = ("Abs", "Heaviside", "Max", "Min", "Piecewise")
# What may jump, and what has a kink or a jump.
JUMPS = (sp.sign, sp.Heaviside, sp.Piecewise, sp.floor, sp.ceiling)
NON_SMOOTH = (sp.Abs, sp.Max, sp.Min, *JUMPS)
CONSTANTS = {"pi": sp.pi, "E": sp.E}


def parts(expression: sp.Expr) -> tuple[str, tuple[sp.Expr, ...]]:
    """Name and operands of a node that is neither number, symbol, sum, product nor integer power.

    The name is a key of `RULES` or `CONSTANTS`, one of `COMPOSED`, or "pow" (base, exponent).
    Raises `UnsupportedFunctionError` for anything else.
    """
    if isinstance(expression, sp.exp):
        return "exp", expression.args
    if expression.is_Pow:
        if expression.exp == sp.Rational(1, 2):
            return "sqrt", (expression.base,)
        return "pow", (expression.base, expression.exp)
    if expression == sp.pi or expression == sp.E:
        return ("pi" if expression == sp.pi else "E"), ()
    name = type(expression).__name__
    if name not in RULES and name not in COMPOSED:
        known = ", ".join(sorted([*RULES, *COMPOSED], key=str.lower))
        remedy = "Replace it by one of them, or declare it as a state with its own equation."
        raise UnsupportedFunctionError(
            f"{expression} has no power series rule.", f"The functions that have one are {known}. {remedy}"
        )
    if isinstance(expression, sp.Piecewise):
        return name, _pieces(expression)
    # The second argument of Heaviside is its value on the switching set, where there is no series.
    return name, expression.args[:1] if name == "Heaviside" else expression.args


def composed(name: str, operands: Sequence[Operand]) -> Operand:
    """One of `COMPOSED` of real operands off its switching set.

    |u| = sign(u) u, Heaviside(u) = (1 + sign(u))/2, Max(a, b) = (a + b + |a - b|)/2, Min with a minus. The operands of
    Piecewise are its values, each with its share, 1 where it is taken and 0 elsewhere.
    """
    half = sp.Rational(1, 2)
    first = operands[0]
    if name == "Abs":
        return first.apply("sign") * first
    if name == "Heaviside":
        return (first.apply("sign") + 1) * half
    if name == "Piecewise":
        return reduce(add, [value * share for value, share in zip(operands[::2], operands[1::2])])
    for other in operands[1:]:
        difference = first + (-other)
        distance = difference.apply("sign") * difference
        first = (first + other + (distance if name == "Max" else -distance)) * half
    return first


def _pieces(expression: sp.Piecewise) -> tuple[sp.Expr, ...]:
    """Each value and its share, in turn; raises `UnsupportedFunctionError` where some place has no value."""
    left: sp.Expr = sp.S.One
    operands: list[sp.Expr] = []
    for value, condition in expression.args:
        share = _share(condition, expression)
        operands += [value, left * share]
        left *= 1 - share
    if left != 0:
        raise UnsupportedFunctionError(
            f"{expression} has no value where none of its conditions holds.",
            "End it with a value for all else.",
        )
    return tuple(operands)


def _share(condition: Any, whole: sp.Expr) -> sp.Expr:
    """1 where `condition` holds and 0 elsewhere, in signs, off the surfaces where it changes."""
    if condition in (sp.true, sp.false):
        return sp.Integer(bool(condition))
    if isinstance(condition, (sp.Eq, sp.Ne)):
        return sp.Integer(isinstance(condition, sp.Ne))
    if isinstance(condition, (sp.Gt, sp.Ge, sp.Lt, sp.Le)):
        return (1 + sp.sign(condition.gts - condition.lts)) / 2
    shares = [_share(part, whole) for part in condition.args]
    if isinstance(condition, sp.Not):
        return 1 - shares[0]
    if isinstance(condition, sp.And):
        return sp.Mul(*shares)
    if isinstance(condition, sp.Or):
        return 1 - sp.Mul(*[1 - share for share in shares])
    raise UnsupportedFunctionError(
        f"{whole} has the condition {condition}.", "Write it with inequalities, And, Or and Not."
    )


def require_rules(equations: Mapping[str, sp.Expr]) -> None:
    """Raise `UnsupportedFunctionError` for the first of `equations`, by the left side, that has no power series."""
    for left, expression in equations.items():
        with met_at(f"in the equation for {left}"):
            are_rational([expression])


def are_rational(expressions: Iterable[sp.Expr]) -> bool:
    """Whether reading `expressions` adjoins no function; raises `UnsupportedFunctionError` for one without a rule."""
    rational = True
    seen: set[sp.Expr] = set()
    for expression in expressions:
        # In the order in which they are met, so that an error names the same function every time.
        walk = sp.preorder_traversal(expression)
        for piece in walk:
            if piece not in seen and not is_rational_node(piece):
                seen.add(piece)
                _, operands = parts(piece)
                rational = False
                if isinstance(piece, sp.Piecewise):
                    # Conditions are no expressions: what stands for them is looked at.
                    are_rational(operands)
            if isinstance(piece, sp.Piecewise):
                walk.skip()
    return rational


def is_rational_node(piece: sp.Expr) -> bool:
    """Whether the head of `piece` is a number, symbol, sum, product or integer power."""
    if piece.is_Symbol or piece.is_Add or piece.is_Mul or piece.is_Rational:
        return True
    return bool(piece.is_Pow and piece.exp.is_Integer)
