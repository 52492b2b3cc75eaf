"""Power series in epsilon over the exact ring, one order at a time.

A `SeriesProgram` holds expressions as a straight-line program. Its inputs are series whose coefficients become
known one after another; `extend` computes the coefficient of the next order in every node.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice

import sympy as sp

from gsp.algebra.functions import COMPOSED, CONSTANTS, RULES, composed, is_rational_node, parts
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.ring_elements import RingElement
from gsp.errors import UnsupportedFunctionError


class SeriesEnds(UnsupportedFunctionError):
    """A root or a kink of what is 0 at epsilon = 0: from the order asked for on it has no power series."""


class SeriesNode:
    """One intermediate series of a `SeriesProgram`; supports + - * like the elements of the ring."""

    __slots__ = ("coefficients", "index", "kind", "operands", "power", "program")

    def __init__(self, program: SeriesProgram, index: int, kind: str, operands: tuple) -> None:
        self.program = program
        self.index = index
        self.kind = kind
        self.operands = operands
        self.coefficients: list[RingElement] = []
        # The exponent of a power, where it is a number.
        self.power: sp.Expr = sp.Rational(1, 2) if operands[:1] == ("sqrt",) else sp.Integer(0)

    def __add__(self, other: SeriesNode | int) -> SeriesNode:
        return self.program.add(self, self.program.lift(other))

    def __mul__(self, other: SeriesNode | int | sp.Rational) -> SeriesNode:
        return self.program.multiply(self, self.program.lift(other))

    def __neg__(self) -> SeriesNode:
        return self.program.multiply(self, self.program.lift(-1))

    def inverse(self) -> SeriesNode:
        """The series of 1/u."""
        return self.program.node("inverse", self)

    def apply(self, name: str, exponent: SeriesNode | None = None) -> SeriesNode:
        """The series of an elementary function of u."""
        return self.program.function(name, self, exponent)


class SeriesProgram:
    """Expressions in series inputs, the ring's own symbols, and epsilon.

    `inputs` maps symbols to lists of ring elements (coefficient of epsilon^k at place k) that the caller owns
    and extends; every other symbol is a constant of the ring or found in `constants`.
    """

    def __init__(
        self,
        ring: LocalisedRing,
        *,
        epsilon: sp.Symbol,
        inputs: Mapping[sp.Symbol, list[RingElement]],
        constants: Mapping[sp.Symbol, RingElement],
    ) -> None:
        self.ring = ring
        self.epsilon = epsilon
        self.inputs = inputs
        self.constants = dict(constants)
        self._nodes: list[SeriesNode] = []
        self._known: dict[tuple, SeriesNode] = {}
        self._read: dict[sp.Expr, SeriesNode] = {}

    def compile(self, expression: sp.Expr) -> SeriesNode:
        """The node of a SymPy expression."""
        if expression in self._read:
            return self._read[expression]
        if not expression.has(self.epsilon, *self.inputs):
            node = self._constant(read(expression, self.ring, self.constants))
        elif expression == self.epsilon:
            node = self.node("epsilon")
        elif expression in self.inputs:
            node = self.node("input", expression)
        elif expression.is_Add:
            parts_ = [self.compile(part) for part in expression.args]
            node = parts_[0]
            for part in parts_[1:]:
                node = self.add(node, part)
        elif expression.is_Mul:
            free, bound = expression.as_independent(self.epsilon, *self.inputs, as_Add=False)
            node = None if free == 1 else self.compile(free)
            for factor in sp.Mul.make_args(bound):
                other = self.compile(factor)
                node = other if node is None else self.multiply(node, other)
            assert node is not None
        elif is_rational_node(expression):
            node = self._integer_power(self.compile(expression.base), int(expression.exp))
        else:
            name, operands = parts(expression)
            inner = [self.compile(operand) for operand in operands]
            if name in COMPOSED:
                node = composed(name, inner)
            else:
                node = self.function(name, inner[0], inner[1] if len(inner) > 1 else None)
                if name == "pow" and operands[1].is_number:
                    node.power = operands[1]
        self._read[expression] = node
        return node

    # -- building ----------------------------------------------------------------------------------

    def node(self, kind: str, *operands) -> SeriesNode:
        """A node of the given kind, made once per kind and operands."""
        key = (kind, *(("n", o.index) if isinstance(o, SeriesNode) else o for o in operands))
        if key not in self._known:
            self._known[key] = self._append(kind, operands)
        return self._known[key]

    def lift(self, value: SeriesNode | int | sp.Rational) -> SeriesNode:
        """`value` as a node; rational numbers become constants."""
        return value if isinstance(value, SeriesNode) else self._constant(self.ring.constant(value))

    def add(self, a: SeriesNode, b: SeriesNode) -> SeriesNode:
        """The sum of two series."""
        return self.node("add", *sorted((a, b), key=lambda n: n.index))

    def multiply(self, a: SeriesNode, b: SeriesNode) -> SeriesNode:
        """The product of two series; a constant factor is kept apart, it costs one product per order."""
        if b.kind == "constant":
            a, b = b, a
        if a.kind == "constant":
            return self.node("scale", a, b)
        return self.node("multiply", *sorted((a, b), key=lambda n: n.index))

    def function(self, name: str, u: SeriesNode, exponent: SeriesNode | None = None) -> SeriesNode:
        """v = F(u) by its differential equation, F one of the elementary functions."""
        if name in CONSTANTS:
            return self._constant(self.ring.zero.apply(name))
        if exponent is not None and exponent.kind != "constant":
            return self.function("exp", self.multiply(exponent, self.function("log", u)))
        key = (name, u.index, exponent.index if exponent else None)
        if key in self._known:
            return self._known[key]
        node = self._append("function", (name, u, exponent))
        self._known[key] = node
        return node

    def _rate(self, node: SeriesNode, k: int) -> SeriesNode:
        """The derivative of a function's node by u, known before order k.

        It is built when it is first asked for: the value of a root at 0 is there where its derivative is not.
        """
        name, u, exponent, *rates = node.operands
        if rates:
            return rates[0]
        built = len(self._nodes)
        if exponent is not None:
            rate = self.multiply(exponent, self.multiply(node, u.inverse()))
        elif RULES[name].rate is None:
            rate = self.lift(0)
        else:
            rate = RULES[name].rate(node, u)  # pyright: ignore[reportOptionalCall]
        node.operands = (name, u, exponent, rate)
        for j in range(k):
            # A node's own rate, where it is a function too, is built behind it.
            for new in islice(self._nodes, built, None):
                if len(new.coefficients) == j:
                    new.coefficients.append(self._coefficient(new, j))
        return rate

    def _append(self, kind: str, operands: tuple) -> SeriesNode:
        node = SeriesNode(self, len(self._nodes), kind, operands)
        self._nodes.append(node)
        return node

    def _constant(self, element: RingElement) -> SeriesNode:
        node = self.node("constant", *element.key)
        node.operands = (element,)
        return node

    def _integer_power(self, base: SeriesNode, exponent: int) -> SeriesNode:
        if exponent < 0:
            base, exponent = base.inverse(), -exponent
        # By squaring, so that a high power costs few products per order.
        result: SeriesNode | None = None
        while exponent:
            if exponent & 1:
                result = base if result is None else self.multiply(result, base)
            exponent >>= 1
            if exponent:
                base = self.multiply(base, base)
        assert result is not None
        return result

    # -- running -----------------------------------------------------------------------------------

    def extend(self, k: int) -> None:
        """Compute, or compute again, the coefficient of epsilon^k in every node."""
        for node in self._nodes:
            value = self._coefficient(node, k)
            if len(node.coefficients) > k:
                node.coefficients[k] = value
            else:
                node.coefficients.append(value)

    def _coefficient(self, node: SeriesNode, k: int) -> RingElement:
        ring = self.ring
        kind, operands = node.kind, node.operands
        if kind == "constant":
            return operands[0] if k == 0 else ring.zero
        if kind == "epsilon":
            return ring.one if k == 1 else ring.zero
        if kind == "input":
            return self.inputs[operands[0]][k]
        if kind == "add":
            return operands[0].coefficients[k] + operands[1].coefficients[k]
        if kind == "scale":
            return operands[0].coefficients[0] * operands[1].coefficients[k]
        if kind == "multiply":
            return convolve(operands[0].coefficients, operands[1].coefficients, k, ring)
        if kind == "inverse":
            u = operands[0].coefficients
            if k == 0:
                return u[0].inverse()
            v = node.coefficients
            if v[0].is_zero:
                # Only of what overflowed, as exp(u) far out: all terms of 1/(1 + exp(u)) are below rounding there.
                return ring.zero
            return -(v[0] * _sum([u[j] * v[k - j] for j in range(1, k + 1)], ring)).reduced()
        name, u, exponent = operands[:3]
        if k == 0:
            arguments = () if exponent is None else (exponent.coefficients[0],)
            return u.coefficients[0].apply(name, *arguments)
        if node.power > 0 and u.coefficients[0].is_zero:
            return self._power_of_small(u, node.power, k)
        if name == "sign" and u.coefficients[0].is_zero and not u.coefficients[k].is_zero:
            raise SeriesEnds(
                "the switching function of Abs, sign, Max, Min or Heaviside is zero at epsilon = 0 and not beyond: "
                "there is no power series across that kink.",
                "Declare the smooth field of one side, or take solve_manifold.",
            )
        # k v_k = sum_(j=1..k) j u_j rate_(k-j): v' = rate u'; the rate is needed through order k - 1 only.
        rate = self._rate(node, k)
        terms = [u.coefficients[j] * rate.coefficients[k - j] * j for j in range(1, k + 1)]
        return (_sum(terms, ring) * (ring.constant(sp.Rational(1, k)))).reduced()

    def _power_of_small(self, u: SeriesNode, power: sp.Expr, k: int) -> RingElement:
        """The coefficient of epsilon^k of u^power with u_0 = 0: u = O(epsilon^m) makes it O(epsilon^(m power))."""
        m = next((j for j, term in enumerate(u.coefficients[: k + 1]) if not term.is_zero), k + 1)
        if k < m * power:
            return self.ring.zero
        raise SeriesEnds(
            f"the power {power} of what is 0 at epsilon = 0 has no power series in epsilon from order {k} on.",
            "Ask for a lower order, or move to where it is not 0.",
        )


def convolve(a: Sequence[RingElement], b: Sequence[RingElement], k: int, ring: LocalisedRing) -> RingElement:
    """sum_(i+j=k) a_i b_j."""
    if a is b:
        total = _sum([a[i] * a[k - i] * 2 for i in range((k + 1) // 2)], ring)
        return total + a[k // 2] * a[k // 2] if k % 2 == 0 else total
    return _sum([a[i] * b[k - i] for i in range(k + 1)], ring)


def _sum(terms: Sequence[RingElement], ring: LocalisedRing) -> RingElement:
    total = ring.zero
    for term in terms:
        if not term.is_zero:
            total = total + term
    return total
