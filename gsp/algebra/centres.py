"""Where expressions have their own origin: the numbers c with v - c for v they are the shortest polynomials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

import flint
import sympy as sp

from gsp.algebra.factorisation import quotient
from gsp.algebra.polynomials import FACTOR_TERMS, length, middles, rational

# A polynomial and the meanings of its generators.
Piece = tuple[flint.fmpq_mpoly, tuple[sp.Expr, ...]]


@lru_cache(maxsize=64)
def centres(expressions: tuple[sp.Expr, ...], symbols: tuple[sp.Symbol, ...]) -> dict[sp.Symbol, sp.Rational]:
    """The rational numbers c, those that are not 0, by symbol v: with v - c for v in all of `expressions` their
    polynomials are the shortest.

    Tried are the zeros of sums a v + b that are written in them, and the centres of their polynomials. Arguments of
    functions count as expressions of their own; polynomials over the budget do not.
    """
    places = _Places(expressions, symbols)
    longest, largest = places.length, places.largest
    while places.improve():
        pass
    found = {symbol: c for symbol, c in places.found.items() if c != 0}
    # Digits are lost by large coefficients alone. And what is saved is not only moved into the centres, as of 3 - x.
    bits = sum(int(c.p).bit_length() + int(c.q).bit_length() for c in found.values())
    if places.largest >= largest or longest - places.length <= bits:
        return {}
    return {s: rational(c) for s, c in found.items()}


class _Places:
    """The polynomials in `symbols` less what was `found` for each."""

    def __init__(self, expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> None:
        pieces = list(_pieces(expressions))
        self.polynomials = [p for p, _ in pieces]
        self.found = dict.fromkeys(symbols, flint.fmpq(0))
        self._written = _zeros(expressions)
        # Where each symbol is: (piece, generator).
        self._where: dict[sp.Symbol, list[tuple[int, int]]] = {s: [] for s in symbols}
        for k, (p, atoms) in enumerate(pieces):
            for i, (atom, degree) in enumerate(zip(atoms, p.degrees())):
                if degree > 0 and atom in self._where:
                    self._where[atom].append((k, i))
        self._beside: dict[sp.Symbol, dict[sp.Symbol, None]] = {}
        for s, places in self._where.items():
            there = (atom for k, _ in places for atom in pieces[k][1] if atom in self._where and atom != s)
            self._beside[s] = dict.fromkeys(there)
        self._tried: dict[sp.Symbol, list[tuple[int, flint.fmpq]]] = {}

    def improve(self) -> bool:
        """Take the step that saves most; else two steps of symbols in one piece, as for x + t - c; else False."""
        singles = [(saved, s, step) for s in self.found for saved, step in self._steps(s)]
        best = max(singles, key=lambda row: row[0], default=None)
        if best is None:
            return False
        if best[0] > 0:
            self._move(*best[1:])
            return True
        terms = self.terms
        for saved, symbol, step in singles:
            self._move(symbol, step)
            for other in self._beside[symbol]:
                for more, second in self._steps(other):
                    if saved + more >= 0:
                        self._move(other, second)
                        if saved + more > 0 or self.terms < terms:
                            return True
                        self._move(other, -second)
            self._move(symbol, -step)
        return False

    @property
    def length(self) -> int:
        """That of all polynomials together."""
        return sum(map(length, self.polynomials))

    @property
    def largest(self) -> int:
        """The largest coefficient of all polynomials, without its sign."""
        return max((abs(int(c)) for p in self.polynomials for c in p.coeffs()), default=0)

    @property
    def terms(self) -> int:
        """Terms of all polynomials."""
        return sum(map(len, self.polynomials))

    def _move(self, symbol: sp.Symbol, step: flint.fmpq) -> None:
        for k, i in self._where[symbol]:
            self.polynomials[k] = _moved(self.polynomials[k], i, step)
        self.found[symbol] += step
        for other in (symbol, *self._beside[symbol]):
            self._tried.pop(other, None)

    def _steps(self, symbol: sp.Symbol) -> list[tuple[int, flint.fmpq]]:
        """(bits that it saves, step) for each step of `symbol` that is tried."""
        if symbol not in self._tried:
            own = [(self.polynomials[k], i) for k, i in self._where[symbol]]
            here = self.found[symbol]
            steps = {c - here for c in self._written.get(symbol, ())}
            for p, i in own:
                steps |= {flint.fmpq(c.leading_coefficient()) for c in middles(p, i) if c.is_constant()}
            before = sum(length(p) for p, _ in own)
            self._tried[symbol] = [
                (before - sum(length(_moved(p, i, step)) for p, i in own), step)
                for step in sorted(steps - {flint.fmpq(0)})
            ]
        return self._tried[symbol]


def _moved(polynomial: flint.fmpq_mpoly, i: int, step: flint.fmpq) -> flint.fmpq_mpoly:
    """P(v + step) in generator i."""
    generators = polynomial.context().gens()
    return polynomial.compose(*[v + step if k == i else v for k, v in enumerate(generators)])


def _pieces(expressions: Sequence[sp.Expr]) -> Iterator[Piece]:
    """Numerators and denominators of the expressions, and of the arguments of the functions in them."""
    waiting, seen = list(expressions), set()
    while waiting:
        expression = waiting.pop()
        found = None if expression in seen else quotient(expression)
        seen.add(expression)
        if found is None:
            continue
        for polynomial in (found.numerator, found.denominator):
            if not polynomial.is_constant() and len(polynomial) <= FACTOR_TERMS:
                yield polynomial, found.atoms
        waiting += [e for atom in found.atoms if not atom.is_Symbol for e in atom.args]


def _zeros(expressions: Sequence[sp.Expr]) -> Mapping[sp.Symbol, set[flint.fmpq]]:
    """-b/a of the sums a v + b in the expressions, by symbol v."""
    found: dict[sp.Symbol, set[flint.fmpq]] = {}
    for total in set().union(*(e.atoms(sp.Add) for e in expressions)):
        b, term = total.as_coeff_Add()
        a, v = term.as_coeff_Mul()
        if v.is_Symbol and a.is_Rational and b.is_Rational:
            zero = -b / a
            found.setdefault(v, set()).add(flint.fmpq(int(zero.p), int(zero.q)))
    return found
