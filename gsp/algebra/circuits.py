"""Exact algebra by straight-line programs: a ring whose elements are programs, which grow as fast as they are made.

Where polynomials are too long to be written out (a hundred coupled fast variables), sums, products, quotients and
functions are kept as the steps that make them. The ring stands where a `LocalisedRing` does, with the same derivations;
what is lost is the closed form, and that an element which vanishes identically is known to.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Any

import flint
import sympy as sp

from gsp.algebra.differences import Subtractable
from gsp.algebra.functions import CONSTANTS, RULES
from gsp.algebra.polynomials import rational
from gsp.algebra.sharing import plus, reciprocal, times
from gsp.errors import BudgetError, HyperbolicityError

# Steps that a ring makes at most: about a second for each hundred thousand, and what machine code takes.
GATES = 400_000


class Gate(Subtractable):
    """A step of a program: `kind` of `inputs`, which are gates, and `what`, a number, a symbol or a function's name."""

    __slots__ = ("index", "inputs", "kind", "ring", "what")
    exponents = ()

    def __init__(self, ring: CircuitRing, kind: str, inputs: tuple[Gate, ...], what: Any, index: int) -> None:
        self.ring, self.kind, self.inputs, self.what, self.index = ring, kind, inputs, what, index

    def __add__(self, other: Gate | int) -> Gate:
        return self.ring.sum(self, self.ring.lift(other))

    def __mul__(self, other: Gate | int | flint.fmpq | sp.Rational) -> Gate:
        return self.ring.product(self, self.ring.lift(other))

    __rmul__ = __mul__

    @property
    def is_zero(self) -> bool:
        """Whether this is the number 0."""
        return self.kind == "number" and self.what == 0

    @property
    def key(self) -> tuple:
        """A hashable identity."""
        return (self.index,)

    @property
    def length(self) -> int:
        """How many steps it takes."""
        return len(self.ring.below([self]))

    @property
    def numerator(self) -> flint.fmpq_mpoly:
        """There is none: raises `BudgetError`."""
        raise BudgetError(
            "so many coupled fast variables have a series by straight-line programs alone, whose numerators "
            "would be too long to be written out.",
            "Take fewer variables, or what needs no polynomials.",
        )

    def __reduce__(self) -> tuple:
        return _gate_of, (self.ring, self.index)

    def reduced(self) -> Gate:
        """Itself: nothing cancels."""
        return self

    def inverse(self) -> Gate:
        """1 / self."""
        return self.ring.inverse(self)

    def apply(self, name: str, exponent: Gate | None = None) -> Gate:
        """The elementary function `name` of this; "pow" takes an exponent."""
        return self.ring.function(name, self, exponent)


class CircuitRing:
    """Programs in `coordinates` and `constants`, with as many `derivations`, which are 0 on the constants."""

    denominators: tuple = ()

    def __init__(
        self, coordinates: Sequence[sp.Symbol], *, constants: Sequence[sp.Symbol] = (), derivations: int = 0
    ) -> None:
        self.derivations = derivations
        self.spent = 0
        self._gates: list[Gate] = []
        self._known: dict[tuple, Gate] = {}
        self._written: dict[int, Any] = {}
        self._slopes: list[dict[int, Gate]] = [{} for _ in range(derivations)]
        self._images: list[dict[int, Gate]] = [{} for _ in range(derivations)]
        self._generators = {s: self._gate("symbol", (), s) for s in (*coordinates, *constants)}
        self.zero, self.one = self.constant(0), self.constant(1)

    # -- steps -------------------------------------------------------------------------------------

    @property
    def spending(self) -> int:
        """What was spent so far; what an attempt took that came to nothing is given back by setting it."""
        return self.spent

    @spending.setter
    def spending(self, before: int) -> None:
        self.spent = before
        del self._gates[before:]
        self._known = {key: gate for key, gate in self._known.items() if gate.index < before}
        self._written = {i: written for i, written in self._written.items() if i < before}
        for tables in (self._slopes, self._images):
            for table in tables:
                kept = {i: gate for i, gate in table.items() if max(i, gate.index) < before}
                table.clear()
                table.update(kept)

    def _gate(self, kind: str, inputs: tuple[Gate, ...], what: Any = None) -> Gate:
        key = (kind, *(gate.index for gate in inputs), what)
        found = self._known.get(key)
        if found is None:
            if len(self._gates) >= GATES:
                raise BudgetError(
                    f"the straight-line program has {GATES:,} steps; no more are made.",
                    limit=GATES,
                    value=len(self._gates) + 1,
                )
            found = self._known[key] = Gate(self, kind, inputs, what, len(self._gates))
            self._gates.append(found)
            self.spent += 1
        return found

    def _number(self, value: flint.fmpq) -> Gate:
        return self._gate("number", (), value)

    def constant(self, value: sp.Rational | int) -> Gate:
        """A rational number."""
        number = sp.Rational(value)
        return self._number(flint.fmpq(int(number.p), int(number.q)))

    def lift(self, value: Gate | int | flint.fmpq | sp.Rational) -> Gate:
        """`value` as an element."""
        if isinstance(value, Gate):
            return value
        return self._number(value) if isinstance(value, flint.fmpq) else self.constant(value)

    def sum(self, a: Gate, b: Gate) -> Gate:
        """a + b."""
        if a.is_zero or b.is_zero:
            return b if a.is_zero else a
        if a.kind == b.kind == "number":
            return self._number(a.what + b.what)
        return self._gate("sum", (a, b) if a.index <= b.index else (b, a))

    def product(self, a: Gate, b: Gate) -> Gate:
        """a b."""
        if b.kind == "number":
            a, b = b, a
        if a.kind == "number":
            if b.kind == "number":
                return self._number(a.what * b.what)
            if a.what == 0 or a.what == 1:
                return a if a.what == 0 else b
            # A number times a number times something.
            if b.kind == "product" and b.inputs[0].kind == "number":
                return self.product(self._number(a.what * b.inputs[0].what), b.inputs[1])
            return self._gate("product", (a, b))
        return self._gate("product", (a, b) if a.index <= b.index else (b, a))

    def inverse(self, a: Gate) -> Gate:
        """1/a; raises `HyperbolicityError` for the number 0."""
        if a.is_zero:
            raise HyperbolicityError("division by an expression that vanishes identically on the branch.")
        if a.kind == "number":
            return self._number(1 / a.what)
        return a.inputs[0] if a.kind == "inverse" else self._gate("inverse", (a,))

    def function(self, name: str, u: Gate, exponent: Gate | None = None) -> Gate:
        """An elementary function of u, or u to a power."""
        if name in CONSTANTS:
            return self._gate("named", (), name)
        if exponent is not None:
            if not self.is_constant(exponent):
                return (exponent * u.apply("log")).apply("exp")
            return self._gate("pow", (u, exponent))
        if u.is_zero and name in RULES and RULES[name].at_zero is not None:
            return self.constant(RULES[name].at_zero)  # pyright: ignore[reportArgumentType]
        return self._gate("function", (u,), name)

    # -- generators and derivations ----------------------------------------------------------------

    def generator(self, symbol: sp.Symbol) -> Gate:
        """The element of a declared symbol."""
        return self._generators[symbol]

    def set_derivative(self, symbol: sp.Symbol, j: int, image: Gate) -> None:
        """Let derivation j map the generator of `symbol` to `image`; the default is 0."""
        self._images[j][self._generators[symbol].index] = image

    def is_constant(self, a: Gate) -> bool:
        """Whether every derivation vanishes on `a` because it contains constants only."""
        moved = {index for image in self._images for index in image}
        return all(gate.index not in moved for gate in self.below([a]))

    def derive(self, a: Gate, j: int) -> Gate:
        """Derivation j of an element, step by step."""
        return derived(self, [a], self._images[j], self._slopes[j])[0]

    def below(self, gates: Iterable[Gate], known: Container[int] = ()) -> list[Gate]:
        """Every gate that `gates` are made of, and they, in the order in which they were made.

        Those with numbers in `known` are left out, and what only they are made of.
        """
        found: set[int] = set()
        stack = list(gates)
        while stack:
            gate = stack.pop()
            if gate.index not in found and gate.index not in known:
                found.add(gate.index)
                stack.extend(gate.inputs)
        return [self._gates[index] for index in sorted(found)]

    def __reduce__(self) -> tuple:
        # By number: gates that hold one another are nested deeper than Python's stack.
        steps = [
            (g.kind, [part.index for part in g.inputs], rational(g.what) if g.kind == "number" else g.what)
            for g in self._gates
        ]
        images = [{i: gate.index for i, gate in image.items()} for image in self._images]
        return _ring_of, (self.derivations, steps, images)

    # -- back to SymPy -----------------------------------------------------------------------------

    def to_sympy(self, a: Gate, *, factored: bool = True) -> sp.Expr:
        """The element as an expression that shares its parts; see `gsp.algebra.sharing`."""
        del factored
        return self.written([a], self._written)[0]

    def written(self, gates: Sequence[Gate], known: dict[int, Any]) -> list[sp.Expr]:
        """The expressions of `gates`; `known` has those of some by number, as other names of symbols, and keeps all."""
        for gate in self.below(gates, known):
            known[gate.index] = self._expression(gate, known)
        return [known[gate.index] for gate in gates]

    horner = to_sympy

    def _expression(self, gate: Gate, known: Mapping[int, Any]) -> Any:
        inputs = [known[part.index] for part in gate.inputs]
        kind, what = gate.kind, gate.what
        if kind == "number":
            return rational(what)
        if kind == "symbol":
            return what
        if kind == "named":
            return CONSTANTS[what]
        if kind == "sum":
            return plus(inputs)
        if kind == "product":
            return times(*inputs)
        if kind == "inverse":
            return reciprocal(inputs[0])
        if kind == "pow":
            return sp.Pow(*inputs, evaluate=False)
        return getattr(sp, what)(inputs[0], evaluate=False)


def _gate_of(ring: CircuitRing, index: int) -> Gate:
    return ring._gates[index]


def _ring_of(derivations: int, steps: Sequence[tuple], images: Sequence[Mapping[int, int]]) -> CircuitRing:
    symbols = [what for kind, _, what in steps if kind == "symbol"]
    ring = CircuitRing(symbols, derivations=derivations)
    made: list[Gate] = []
    for kind, inputs, what in steps:
        lifted = ring.constant(what).what if kind == "number" else what
        made.append(ring._gate(kind, tuple(made[i] for i in inputs), lifted))
    for image, given in zip(ring._images, images):
        image |= {made[i].index: made[j] for i, j in given.items()}
    return ring


class Factors:
    """The LU factors of a matrix of `entries`, (row, column) each, with the pivots on the diagonal in this `order`.

    `rows` and `columns` are what is left of column and row `order[k]` when it is eliminated. The order is fixed: where
    a pivot happens to vanish there is no value. With `sources` row k is that of the right-hand side's `sources[k]`.
    Raises `HyperbolicityError` when a pivot is 0 throughout.
    """

    def __init__(
        self,
        ring: CircuitRing,
        entries: Mapping[tuple[int, int], Gate],
        order: Sequence[int],
        rows: Sequence[Sequence[int]],
        columns: Sequence[Sequence[int]],
        sources: Sequence[int] | None = None,
    ) -> None:
        self._sources = range(len(order)) if sources is None else sources
        self._steps = list(zip(order, rows, columns))
        held = dict(entries)
        self.pivots: list[Gate] = []
        self._inverses: dict[int, Gate] = {}
        for k, below, beside in self._steps:
            pivot = held.get((k, k), ring.zero)
            inverse = self._inverses[k] = pivot.inverse()
            self.pivots.append(pivot)
            for i in below:
                factor = held[i, k] = held.get((i, k), ring.zero) * inverse
                for j in beside:
                    held[i, j] = held.get((i, j), ring.zero) - factor * held.get((k, j), ring.zero)
        self._held, self._zero = held, ring.zero

    def solve(self, b: Sequence[Gate]) -> list[Gate]:
        """The solution x of A x = b."""
        x = [b[source] for source in self._sources]
        for k, below, _ in self._steps:
            for i in below:
                x[i] = x[i] - self._held[i, k] * x[k]
        for k, _, beside in reversed(self._steps):
            for j in beside:
                x[k] = x[k] - self._held.get((k, j), self._zero) * x[j]
            x[k] = x[k] * self._inverses[k]
        return x


def derived(
    ring: CircuitRing, gates: Sequence[Gate], images: Mapping[int, Gate], known: dict[int, Gate] | None = None
) -> list[Gate]:
    """The derivatives of `gates` along `images`, which map the indices of generators to their rates.

    `known` keeps what was found before for the same images.
    """
    slopes: dict[int, Gate] = {} if known is None else known
    for gate in ring.below(gates, slopes):
        slopes[gate.index] = _slope(ring, gate, images, slopes)
    return [slopes[gate.index] for gate in gates]


def _slope(ring: CircuitRing, gate: Gate, images: Mapping[int, Gate], slopes: Mapping[int, Gate]) -> Gate:
    inner = [slopes[part.index] for part in gate.inputs]
    if gate.kind == "symbol":
        return images.get(gate.index, ring.zero)
    if all(slope.is_zero for slope in inner):
        return ring.zero
    if gate.kind == "sum":
        return inner[0] + inner[1]
    if gate.kind == "product":
        a, b = gate.inputs
        return inner[0] * b + a * inner[1]
    if gate.kind == "inverse":
        return -(gate * gate * inner[0])
    if gate.kind == "pow":
        u, exponent = gate.inputs
        return exponent * gate * u.inverse() * inner[0]
    rate: Callable[[Any, Any], Any] | None = RULES[gate.what].rate
    return ring.zero if rate is None else rate(gate, gate.inputs[0]) * inner[0]
