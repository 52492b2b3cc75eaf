"""Derivatives of order k at one point as k-linear forms: B(u, v) and C(u, v, w) of normal forms (Kuznetsov 2004, 5.4).

Of many variables each equation contains few: with 200 there are 10^9 derivatives of third order, of which a chain of
reactions has a thousand that are not zero. Only those are formed, compiled, and kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative


@dataclass(frozen=True, eq=False)
class MultilinearForm:
    """The derivatives of order k of n functions by N variables that are not zero, each in every order of its variables.

    `places` (k + 1, m) has the function and the variables of each of the `values` (m,). Called with k vectors (N,) it
    is the form (n,), and complex if one of them is.
    """

    places: np.ndarray
    values: np.ndarray
    size: int

    def __call__(self, *vectors: np.ndarray) -> np.ndarray:
        products = self.values
        for place, vector in zip(self.places[1:], vectors, strict=True):
            products = products * vector[place]
        result = np.zeros(self.size, products.dtype)
        np.add.at(result, self.places[0], products)
        return result

    def __abs__(self) -> MultilinearForm:
        return replace(self, values=np.abs(self.values))

    def in_units(self, units: np.ndarray) -> MultilinearForm:
        """The form where variables and functions, of which there are as many, are in `units` (N,)."""
        factors = units[self.places[1:]].prod(axis=0) / units[self.places[0]]
        return replace(self, values=self.values * factors)

    def dense(self, variables: int) -> np.ndarray:
        """All derivatives by N = `variables` variables: (n, N, ..., N)."""
        result = np.zeros((self.size, *[variables] * (len(self.places) - 1)))
        result[tuple(self.places)] = self.values
        return result


class Derivatives:
    """Every derivative of order `order` of `functions` by `variables` that is not zero, compiled once.

    `compiled` makes a function of points and parameters from expressions.
    """

    def __init__(
        self, functions: Sequence[sp.Expr], variables: Sequence[sp.Symbol], order: int, compiled: Callable
    ) -> None:
        number = {symbol: i for i, symbol in enumerate(variables)}
        different: list[sp.Expr] = []
        places: list[tuple[int, ...]] = []
        # Which of the different ones stands at each place.
        self._source: list[int] = []
        for i, function in enumerate(functions):
            for chosen, expression in _different(function, number, order, ()):
                ways = sorted(set(permutations(chosen)))
                self._source += [len(different)] * len(ways)
                places += [(i, *way) for way in ways]
                different.append(expression)
        self._places = np.array(places, dtype=int).reshape(-1, order + 1).T
        self._size = len(functions)
        self._entries = compiled(different)

    def at(self, u: np.ndarray, p: np.ndarray) -> MultilinearForm:
        """Their values at one point u with parameters p."""
        return MultilinearForm(self._places, self._entries(u, p)[self._source], self._size)


def _different(
    expression: sp.Expr, number: dict[sp.Symbol, int], order: int, chosen: tuple[int, ...]
) -> Iterator[tuple[tuple[int, ...], sp.Expr]]:
    """The derivatives that are not zero, with the numbers of their variables, which never fall."""
    if len(chosen) == order:
        yield chosen, expression
        return
    for symbol in sorted(expression.free_symbols & number.keys(), key=lambda symbol: number[symbol]):
        place = number[symbol]
        if not chosen or place >= chosen[-1]:
            slope = derivative(expression, symbol)
            if slope != 0:
                yield from _different(slope, number, order, (*chosen, place))
