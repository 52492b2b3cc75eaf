"""Elimination: the zero set of g(x, y, 0) taken apart into irreducible pieces, each solved for y if it can be.

Factors give the pieces; equations that are linear in a fast variable, quadratic in the last one, or that one
inverse function solves give formulas. What has no useful formula stays an equation, and what is a formula of
complex numbers only is set aside.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import prod

import sympy as sp

from gsp.algebra.centres import centres
from gsp.algebra.differentiation import derivative
from gsp.algebra.factorisation import (
    coefficients,
    degree,
    factor_list,
    factored,
    factors,
    lowest_terms,
    numerator,
    quotient,
)
from gsp.algebra.functions import NON_SMOOTH
from gsp.algebra.inversion import one_inverse
from gsp.algebra.laurent import laurent
from gsp.algebra.polynomials import FACTOR_TERMS
from gsp.algebra.substitution import substituted
from gsp.systems.system import SlowFastSystem

# A variable is eliminated only while what remains has this degree at most, or about so many operations.
DEGREE_LIMIT = 9
OPERATION_LIMIT = 200
# Bits of all numbers in what is substituted. 140 links with coefficients k/7 take 421,000; where every coefficient
# depends on x too 40 take 755,000, and 140 would take minutes.
BIT_LIMIT = 600_000

Graph = dict[sp.Symbol, sp.Expr]


@dataclass
class Pieces:
    """What an elimination found: (equations, graph or None) for each piece, and what is no real graph."""

    solved: list[tuple[tuple[sp.Expr, ...], Graph | None]] = field(default_factory=list)
    unsolved: list[sp.Basic] = field(default_factory=list)
    vanished: list[sp.Expr] = field(default_factory=list)

    def back_from(self, centres: Mapping[sp.Symbol, sp.Rational]) -> Pieces:
        """The same in the states of a system that was written about its `centres`."""
        less = {s: s - c for s, c in centres.items()}
        solved = [
            (
                tuple(e.xreplace(less) for e in equations),
                graph and {y: h.xreplace(less) + centres.get(y, 0) for y, h in graph.items()},
            )
            for equations, graph in self.solved
        ]
        rest = ([e.xreplace(less) for e in part] for part in (self.unsolved, self.vanished))
        return Pieces(solved, *rest)


def pieces(system: SlowFastSystem) -> Pieces:
    """The zero set of g(x, y, 0), piece by piece."""
    here = centres((*system.f, *system.g), system.states)
    return _pieces(system.about(here)).back_from(here) if here else _pieces(system)


def _pieces(system: SlowFastSystem) -> Pieces:
    g0 = [laurent(g, system.epsilon, order=0)[0] for g in system.g]
    found = Pieces()
    for choice in _components(g0, system, found):
        for equations, graph in _eliminate(choice, {}, system, found):
            known = any(graph == other if graph else equations == e for e, other in found.solved)
            if known:
                continue
            if (graph is None and any(_has_no_zero(e, system) for e in equations)) or (
                graph is not None and (_undefined(graph, system) or _never_real(graph, system))
            ):
                _note(found.vanished, sp.Add(*equations))
                continue
            found.solved.append((equations, graph))
    return found


def _note(known: list, expression: sp.Basic) -> None:
    if expression not in known:
        known.append(expression)


def _note_no_graph(equations: Sequence[sp.Expr], system: SlowFastSystem, found: Pieces) -> None:
    """Keep a piece of the wrong dimension or over a part of x only, or what has no real point at all."""
    equations = tuple(dict.fromkeys(e for e in equations if not _is_nothing(e)))
    if any(e.is_number or _has_no_zero(e, system) for e in equations):
        _note(found.vanished, sp.Add(*equations))
    elif len(equations) == 1:
        _note(found.unsolved, equations[0])
    else:
        _note(found.unsolved, sp.Tuple(*equations))


def _components(g0: Sequence[sp.Expr], system: SlowFastSystem, found: Pieces) -> Iterator[list[sp.Expr]]:
    """Every choice of one irreducible factor from each equation that makes a piece of the right dimension."""
    every = [factors(rate, system.states) for rate in g0]
    vertical = [[f for f in parts if not f.has(*system.y)] for parts in every]
    choices = [[f for f in parts if f.has(*system.y)] for parts in every]
    # A factor shared by two equations makes both zero by itself: that piece is too large to be a graph over x.
    shared = [f for i, c in enumerate(choices) for f in c if any(f in d or -f in d for d in choices[:i])]
    for factor in dict.fromkeys([*itertools.chain(*vertical), *shared]):
        others = [g for g, parts in zip(g0, every) if factor not in parts and -factor not in parts]
        _note_no_graph([factor, *others], system, found)
    choices = [[f for f in c if f not in shared and -f not in shared] for c in choices]
    # Products of factors, one from each equation, that are tried at most.
    if prod(map(len, choices)) > 256:
        yield list(g0)
        return
    yield from (list(choice) for choice in itertools.product(*choices))


def _eliminate(
    equations: list[sp.Expr], known: Graph, system: SlowFastSystem, found: Pieces
) -> Iterator[tuple[tuple[sp.Expr, ...], Graph | None]]:
    """Solve linear equations one by one, each with a coefficient free of fast variables, then what remains."""
    remaining = [y for y in system.y if y not in known]
    if not equations:
        if remaining:
            _note_no_graph([y - value for y, value in known.items()], system, found)
            return
        graph = _back_substituted(known, system)
        yield tuple(y - graph[y] for y in system.y), graph
        return
    step = _linear_step(equations, remaining, system)
    if step is not None and _stays_small(equations, *step, system):
        place, y, value = step
        rest = [_replaced(e, y, value) for i, e in enumerate(equations) if i != place]
        here = (*equations, *(symbol - known[symbol] for symbol in known))
        bits = sum(map(_bits, known.values())) + _bits(value)
        # About ten operations a term; exponentials of long arguments have more.
        if bits > BIT_LIMIT or _operations(rest) > max(10 * FACTOR_TERMS, _operations(equations)):
            yield here, None
            return
        below = list(_branching(rest, {**known, y: value}, system, found))
        # A substitution serves a formula or a factor. One that gave neither and made the equations longer is undone.
        if len(below) == 1 and below[0][1] is None and _operations(below[0][0]) > _operations(here):
            below = [(here, None)]
        yield from below
        return
    if len(equations) == 1 and len(remaining) == 1:
        solutions = _univariate(equations[0], remaining[0], system, found)
        if solutions is not None:
            for value in solutions:
                graph = _back_substituted({**known, remaining[0]: value}, system)
                yield tuple(y - graph[y] for y in system.y), graph
            return
    yield (*equations, *(y - value for y, value in known.items())), None


def _replaced(equation: sp.Expr, y: sp.Symbol, value: sp.Expr) -> sp.Expr:
    return numerator(substituted(equation, {y: value})) if y in equation.free_symbols else equation


def _operations(equations: Sequence[sp.Expr]) -> int:
    return sum(map(_count, equations))


@lru_cache(maxsize=4096)
def _count(equation: sp.Expr) -> int:
    return int(sp.count_ops(equation))


@lru_cache(maxsize=4096)
def _bits(value: sp.Expr) -> int:
    return sum(number.p.bit_length() + number.q.bit_length() for number in value.atoms(sp.Rational))


def _linear_step(equations: Sequence[sp.Expr], remaining: Sequence[sp.Symbol], system: SlowFastSystem):
    """(place, symbol, value) of an equation linear in a fast variable; constant coefficients before others.

    A coefficient that depends on x may vanish somewhere, and then the substitution has a pole that M0 has not.
    """
    best = None
    fast, slow = frozenset(system.y), frozenset(system.x)
    for place, equation in enumerate(equations):
        present = equation.free_symbols
        for y in remaining:
            if y not in present:
                continue
            slope = _slope(equation, y)
            used = slope.free_symbols
            if slope == 0 or not fast.isdisjoint(used) or _is_zero_at_values(slope, system):
                continue
            rank = 0 if not used else 1 if slow.isdisjoint(used) else 2
            if best is None or rank < best[0]:
                best = (rank, place, y, slope)
        if best is not None and best[0] == 0:
            break
    if best is None:
        return None
    _, place, y, slope = best
    return place, y, lowest_terms(-equations[place].subs(y, 0) / slope)


# A step of the elimination changes few equations; the others are asked again in the next one.
@lru_cache(maxsize=4096)
def _slope(equation: sp.Expr, y: sp.Symbol) -> sp.Expr:
    # Off its jumps sign(y) has the slope 0, and yet no equation with it is linear in y.
    return sp.diff(equation, y) if equation.has(*NON_SMOOTH) else derivative(equation, y)


def _stays_small(
    equations: Sequence[sp.Expr], place: int, y: sp.Symbol, value: sp.Expr, system: SlowFastSystem
) -> bool:
    """Whether the substitution keeps the degree in the fast variables low; a chain of cubics multiplies it."""
    top, bottom = sp.fraction(value)
    grown, below = degree(top, system.y), degree(bottom, system.y)
    others = [e for i, e in enumerate(equations) if i != place and e.has(y)]
    powers = [degree(e, [y]) for e in others]
    if grown is None or below is None or None in powers:
        return sp.count_ops(value) * len(equations) <= OPERATION_LIMIT
    return grown * max((power for power in powers if power is not None), default=1) <= DEGREE_LIMIT


def _branching(
    equations: Sequence[sp.Expr], known: Graph, system: SlowFastSystem, found: Pieces
) -> Iterator[tuple[tuple[sp.Expr, ...], Graph | None]]:
    """Factor what a substitution has left, and go on with every factor."""
    choices = []
    solved = [y - value for y, value in known.items()]
    for place, equation in enumerate(equations):
        if _is_nothing(equation):
            _note_no_graph([*equations, *solved], system, found)
            return
        if equation is sp.nan:
            return
        parts = _factors(equation, system.states)
        rest = [e for i, e in enumerate(equations) if i != place]
        for factor in parts:
            if not factor.has(*system.y):
                _note_no_graph([factor, *rest, *solved], system, found)
        parts = [f for f in parts if f.has(*system.y)]
        if not parts:
            return
        choices.append(parts)
    for choice in itertools.product(*choices):
        yield from _eliminate(list(choice), known, system, found)


_factors = lru_cache(maxsize=4096)(factors)


@lru_cache(maxsize=4096)
def _is_nothing(equation: sp.Expr) -> bool:
    return numerator(equation) == 0


def _univariate(equation: sp.Expr, y: sp.Symbol, system: SlowFastSystem, found: Pieces) -> list[sp.Expr] | None:
    """Explicit real solutions of one equation in one unknown, or None when there is no useful formula."""
    row = coefficients(equation, y)
    if row is None:
        value = one_inverse(equation, y)
        return None if value is None else [value]
    if len(row) != 3:
        return None
    discriminant = factored(row[1] ** 2 - 4 * row[0] * row[2])
    if _is_nowhere_positive(discriminant, system):
        _note(found.vanished, equation)
        return []
    return _quadratic(row, discriminant, system)


def _quadratic(row: Sequence[sp.Expr], discriminant: sp.Expr, system: SlowFastSystem) -> list[sp.Expr] | None:
    """Both roots of a y^2 + b y + c, in the form that stays finite and accurate where a vanishes; or None.

    Where a is not constant that form depends on the sign of b; when b has none, no one formula will do.
    """
    a, b, c = row
    root = _square_root(discriminant)
    if not a.has(*system.x) and not _is_zero_at_values(a, system):
        return [_shortest((-b + sign * root) / (2 * a)) for sign in (1, -1)]
    at_values = substituted(b, system.parameters)
    if not at_values.is_number or at_values == 0:
        return None
    # The root with -b and sqrt(D) of one sign is the one that goes to infinity; it has no place without a.
    sign = -1 if at_values > 0 else 1
    regular = _shortest(2 * c / (-b + sign * root))
    if _is_zero_at_values(a, system):
        return [regular]
    return [_shortest((-b + sign * root) / (2 * a)), regular]


def _square_root(discriminant: sp.Expr) -> sp.Expr:
    """A square root, with even powers outside so that it is smooth where they vanish."""
    constant, powers = factor_list(discriminant)
    outside = sp.Mul(*[f ** (k // 2) for f, k in powers])
    return outside * sp.sqrt(constant * sp.Mul(*[f for f, k in powers if k % 2]))


def _shortest(expression: sp.Expr) -> sp.Expr:
    if sp.count_ops(expression) > OPERATION_LIMIT:
        return expression
    forms = (expression, sp.factor_terms(expression), sp.expand_mul(expression))
    return min(forms, key=sp.count_ops)


def _is_zero_at_values(expression: sp.Expr, system: SlowFastSystem) -> bool:
    return substituted(expression, system.parameters) == 0


def _has_no_zero(equation: sp.Expr, system: SlowFastSystem) -> bool:
    """Whether there is visibly no real zero: of a sum of even powers of one sign, by Sturm, or as of cosh(x)."""
    polynomial = _polynomial(equation, system)
    if polynomial is None:
        real = {s: sp.Dummy(real=True) for s in system.states}
        return bool(substituted(equation, system.parameters).xreplace(real).is_nonzero)
    constant = polynomial.coeff_monomial(1)
    if constant != 0 and (_has_sign(polynomial, 1) or _has_sign(polynomial, -1)):
        return True
    return len(polynomial.free_symbols) == 1 and polynomial.count_roots() == 0


def _is_nowhere_positive(expression: sp.Expr, system: SlowFastSystem) -> bool:
    """Whether a polynomial is visibly <= 0, so that its root is real on a set without interior at most."""
    polynomial = _polynomial(expression, system)
    if polynomial is None:
        return False
    if _has_sign(polynomial, -1):
        return True
    one = len(polynomial.free_symbols) == 1
    return one and polynomial.coeff_monomial(1) < 0 and polynomial.count_roots() == 0


def _polynomial(expression: sp.Expr, system: SlowFastSystem) -> sp.Poly | None:
    """`expression` at the parameters' values as a polynomial in the states over the rationals, or None."""
    found = quotient(substituted(expression, system.parameters))
    if found is None or not found.denominator.is_constant() or not set(found.atoms) <= set(system.states):
        return None
    polynomial = found.expression(found.numerator)
    used = [symbol for symbol in system.states if symbol in polynomial.free_symbols]
    return sp.Poly(polynomial, *(used or system.states[:1]))


def _has_sign(polynomial: sp.Poly, sign: int) -> bool:
    terms = polynomial.terms()
    return all(sign * c > 0 and all(k % 2 == 0 for k in powers) for powers, c in terms)


def _never_real(graph: Mapping[sp.Symbol, sp.Expr], system: SlowFastSystem) -> bool:
    """Whether a formula contains i, or a root or logarithm of what is never positive."""
    for value in graph.values():
        if value.has(sp.I, sp.zoo, sp.nan):
            return True
        arguments = [piece.args[0] for piece in value.atoms(sp.log)]
        arguments += [piece.base for piece in value.atoms(sp.Pow) if piece.exp == sp.Rational(1, 2)]
        if any(_is_nowhere_positive(argument, system) for argument in arguments):
            return True
    return False


def _undefined(graph: Mapping[sp.Symbol, sp.Expr], system: SlowFastSystem) -> bool:
    """Whether f or g is not defined on the graph, as x log(x) is not on x = 0."""
    values = [substituted(rate, graph) for rate in (*system.f, *system.g)]
    return any(value.has(sp.nan, sp.zoo, sp.oo, -sp.oo) for value in values)


def _back_substituted(known: Graph, system: SlowFastSystem) -> Graph:
    graph: Graph = {}
    # What was eliminated first is given by those that were eliminated after it.
    for y, value in reversed(known.items()):
        whole = substituted(value, graph)
        graph[y] = lowest_terms(whole) if whole.is_rational_function(*system.x) else _shortest(whole)
    return graph
