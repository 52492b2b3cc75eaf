"""Where expressions have their own origin: the numbers c with v - c for v they are the shortest polynomials."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

import flint
import numpy as np
import sympy as sp

from gsp.algebra.factorisation import quotient
from gsp.algebra.polynomials import FACTOR_TERMS, middles, rational

# Of bits that are fitted and added.
ROUNDING = 1e-6
# Bits that each factor loses about the origin for which it is worth while to have another.
FAR = 3.0
# A polynomial and the meanings of its generators.
Piece = tuple[flint.fmpq_mpoly, tuple[sp.Expr, ...]]


@lru_cache(maxsize=64)
def centres(expressions: tuple[sp.Expr, ...], symbols: tuple[sp.Symbol, ...]) -> dict[sp.Symbol, sp.Rational]:
    """The rational numbers c, those that are not 0, by symbol v: with v - c for v in all of `expressions` their
    polynomials have the fewest terms and factors.

    Tried are the zeros of sums a v + b that are written in them, and the centres of their polynomials. Arguments of
    functions count as expressions of their own, and so do the parts of one over the budget. The units of the symbols
    do not count: 1000 c are the centres of 1000 v.
    """
    places = _Places(expressions, symbols)
    here = places.pieces
    while places.improve():
        pass
    found = {symbol: c for symbol, c in places.found.items() if c != 0}
    if not found:
        return {}
    at_origin = _FittedUnits(here)
    there = _FittedUnits(places.pieces, at_origin)
    # In the units of the origin, too, what is saved is not only moved into the centres, as of 3 - x.
    saved = min(u.length(here) - u.length(places.pieces) - u.length_of(found) for u in (at_origin, there))
    # Nor is a centre there where something is shorter than about 0, as about 1 of (1 + x)/x, but no digits are lost.
    is_far = there.furthest(found, _FittedUnits(places.pieces)) > FAR
    return {s: rational(c) for s, c in found.items()} if saved > ROUNDING and is_far else {}


class _Places:
    """The polynomials in `symbols` less what was `found` for each."""

    def __init__(self, expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> None:
        pieces = list(_pieces(expressions))
        self.polynomials = [p for p, _ in pieces]
        self._atoms = [atoms for _, atoms in pieces]
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
        """Take the step that saves most, to a zero that is written if one saves; else two steps of symbols in one
        piece, as for x + t - c; else False.
        """
        singles = [(saved, s, step) for s in self.found for saved, step in self._steps(s)]
        if saving := [row for row in singles if row[0] > 0]:
            # Of two that save as much the one that is written more often.
            _, symbol, step = max(
                saving, key=lambda row: (self._times(*row[1:]) > 0, row[0], self._times(*row[1:]))
            )
            self._move(symbol, step)
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
    def pieces(self) -> list[Piece]:
        """The polynomials, each with the meanings of its generators."""
        return list(zip(self.polynomials, self._atoms))

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

    def _times(self, symbol: sp.Symbol, step: flint.fmpq) -> int:
        """How often it is written that the symbol vanishes there."""
        return self._written.get(symbol, {}).get(self.found[symbol] + step, 0)

    def _steps(self, symbol: sp.Symbol) -> list[tuple[int, flint.fmpq]]:
        """(terms and factors that it saves, step) for each step of `symbol` that is tried.

        No symbol goes on from a zero that is written to a centre that is not.
        """
        if symbol not in self._tried:
            own = [(self.polynomials[k], i) for k, i in self._where[symbol]]
            here, before = self.found[symbol], sum(_length(p) for p, _ in own)
            steps = {c - here for c in self._written.get(symbol, ())}
            for p, i in own if flint.fmpq(0) not in steps else ():
                steps |= {flint.fmpq(c.leading_coefficient()) for c in middles(p, i) if c.is_constant()}
            self._tried[symbol] = [
                (before - sum(_length(_moved(p, i, step)) for p, i in own), step)
                for step in sorted(steps - {flint.fmpq(0)}, key=abs)
            ]
        return self._tried[symbol]


def _length(polynomial: flint.fmpq_mpoly) -> int:
    """Terms and their factors."""
    return sum(1 + sum(map(int, exponents)) for exponents in polynomial.to_dict())


class _FittedUnits:
    """Units of the generators, and of each polynomial, in which the coefficients are as near to 1 as they can be.

    Their logarithms are fitted by least squares, from the units `within` on. The sizes of coefficients in them are
    the same in whatever units the generators were.
    """

    def __init__(self, pieces: Sequence[Piece], within: _FittedUnits | None = None) -> None:
        from scipy.sparse import csr_array
        from scipy.sparse.linalg import lsqr

        atoms = dict.fromkeys(atom for _, of in pieces for atom in of)
        self._column = {atom: k for k, atom in enumerate(atoms)}
        self._bits = within._bits if within else np.zeros(len(atoms))
        found = [self._sizes(*piece) for piece in pieces]
        # Values of functions, roots apart, have no unit: those of tanh are as large as 1.
        free = np.array([atom.is_Symbol or atom.is_Pow for atom in atoms])
        data = np.concatenate(
            [((powers - powers.mean(axis=0)) * free[own]).ravel() for own, powers, _ in found]
        )
        columns = np.concatenate([np.tile(own, len(powers)) for own, powers, _ in found])
        counts = [len(own) for own, powers, _ in found for _ in powers]
        rows = np.repeat(np.arange(len(counts)), counts)
        matrix = csr_array((data, (rows, columns)), shape=(len(counts), len(atoms)))
        # In its own unit the logarithms of a polynomial's coefficients have the mean 0.
        less = np.concatenate([sizes - sizes.mean() for _, _, sizes in found])
        self._bits = self._bits - lsqr(matrix, less, atol=1e-14, btol=1e-14, conlim=0.0, iter_lim=10**4)[0]
        self._means = [float(np.mean(self._sizes(*piece)[2])) for piece in pieces]

    def _sizes(
        self, polynomial: flint.fmpq_mpoly, atoms: Sequence[sp.Expr]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns (n,) of the generators, powers (m, n) of the terms, and bits (m,) of their coefficients."""
        own = np.array([self._column[atom] for atom in atoms], dtype=int)
        terms = polynomial.to_dict()
        powers = np.array([[int(e) for e in exponents] for exponents in terms], dtype=float)
        return own, powers, np.array([_bits(c) for c in terms.values()]) + powers @ self._bits[own]

    def _sizes_of(self, pieces: Sequence[Piece]) -> np.ndarray:
        """Bits of the coefficients of polynomials in the places of its own."""
        return np.concatenate([self._sizes(*piece)[2] - mean for piece, mean in zip(pieces, self._means)])

    def length(self, pieces: Sequence[Piece]) -> float:
        """Bits of the coefficients together, those below 1 as good as none."""
        return float(np.sum(np.logaddexp2(0.0, self._sizes_of(pieces))))

    def length_of(self, values: Mapping[sp.Symbol, flint.fmpq]) -> float:
        """Bits of values of generators together."""
        sizes = [_bits(c) - self._bits[self._column[symbol]] for symbol, c in values.items()]
        return float(np.sum(np.logaddexp2(0.0, sizes)))

    def furthest(self, values: Mapping[sp.Symbol, flint.fmpq], others: _FittedUnits) -> float:
        """Bits of the largest value, infinite where a unit is not determined and other fits have others."""
        columns = [self._column[symbol] for symbol in values]
        sizes = np.array([_bits(c) for c in values.values()]) - self._bits[columns]
        return float(np.max(np.where(np.abs(self._bits - others._bits)[columns] > ROUNDING, np.inf, sizes)))


def _bits(number: flint.fmpq) -> float:
    return math.log2(abs(int(number.p))) - math.log2(int(number.q))


def _moved(polynomial: flint.fmpq_mpoly, i: int, step: flint.fmpq) -> flint.fmpq_mpoly:
    """P(v + step) in generator i."""
    generators = polynomial.context().gens()
    return polynomial.compose(*[v + step if k == i else v for k, v in enumerate(generators)])


def _pieces(expressions: Sequence[sp.Expr]) -> Iterator[Piece]:
    """Numerators and denominators of the expressions, and of the arguments of the functions in them."""
    waiting, seen = list(expressions), set()
    while waiting:
        expression = waiting.pop()
        if expression in seen:
            continue
        found = quotient(expression)
        seen.add(expression)
        if found is None or max(len(found.numerator), len(found.denominator)) > FACTOR_TERMS:
            waiting += expression.args
            continue
        for polynomial in (found.numerator, found.denominator):
            if not polynomial.is_constant():
                yield polynomial, found.atoms
        waiting += [e for atom in found.atoms if not atom.is_Symbol for e in atom.args]


def _zeros(expressions: Sequence[sp.Expr]) -> Mapping[sp.Symbol, dict[flint.fmpq, int]]:
    """-b/a of the sums a v + b in the expressions, by symbol v, and how often each is written."""
    found: dict[sp.Symbol, dict[flint.fmpq, int]] = {}
    sums = Counter(part for e in expressions for part in sp.preorder_traversal(e) if part.is_Add)
    for total, count in sums.items():
        b, term = total.as_coeff_Add()
        a, v = term.as_coeff_Mul()
        if v.is_Symbol and a.is_Rational and b.is_Rational:
            zero, times = -b / a, found.setdefault(v, {})
            at = flint.fmpq(int(zero.p), int(zero.q))
            times[at] = times.get(at, 0) + count
    return found
