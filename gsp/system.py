"""Declaration: a slow-fast system in standard form, or any field with poles in epsilon.

x' = f(x, y, epsilon), epsilon y' = g(x, y, epsilon), equation (19) of Eldering (2015): x slow, y fast,
' = d/dt in slow time. All checks are here; later stages trust what they are given.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import sympy as sp
from sympy.core.function import AppliedUndef

from gsp.errors import DeclarationError, nearest
from gsp.flow import Flow, Values
from gsp.laurent import misplaced_epsilon, pole_order

# Numbers given as text: a larger exponent would be written out in full.
DECIMAL = re.compile(r"[+-]?\d{1,60}(\.\d{0,60})?([eE][+-]?\d{1,3}|/\d{1,60})?")


@dataclass(frozen=True, eq=False, repr=False)
class SlowFastSystem(Flow):
    """A system in standard form, x' = f(x, y, epsilon), epsilon y' = g(x, y, epsilon).

    `slow` maps each slow symbol to f, `fast` each fast symbol to g (without the factor 1/epsilon);
    `epsilon` is the small parameter, `parameters` gives every other symbol its value, `observables` are
    further quantities to read off a trajectory. f and g are rational in epsilon and regular at 0.

    Raises `DeclarationError`, naming the fact, the value and the remedy.

    >>> s, c, eps, kappa = sp.symbols("s c epsilon kappa")
    >>> SlowFastSystem(slow={s: -s + s*c}, fast={c: s - (s + kappa)*c}, epsilon=eps, parameters={kappa: 1})
    SlowFastSystem(slow=[s], fast=[c], epsilon=epsilon, parameters={kappa: 1})
    """

    slow: Mapping[sp.Symbol, sp.Expr]
    fast: Mapping[sp.Symbol, sp.Expr]
    epsilon: sp.Symbol
    parameters: Values = field(default_factory=dict)
    name: str = ""
    observables: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        slow, fast = _equations(self.slow, "slow"), _equations(self.fast, "fast")
        if not slow or not fast:
            raise DeclarationError(
                f"a SlowFastSystem has slow and fast variables. Got {len(slow)} slow and {len(fast)} fast. "
                "Declare a VectorField for a field that is not split."
            )
        twice = [symbol.name for symbol in fast if symbol in slow]
        if twice:
            raise DeclarationError(f"{', '.join(twice)} is declared slow and fast. Keep it in one of the two.")
        if self.epsilon is None:
            raise DeclarationError(
                "a SlowFastSystem has a small parameter. Got epsilon=None. "
                "Pass the symbol that multiplies the fast rates."
            )
        observables = _equations(self.observables, "observables")
        parameters = _checked(
            states=(*slow, *fast),
            expressions=(*slow.values(), *fast.values()),
            observables=observables,
            epsilon=self.epsilon,
            parameters=self.parameters,
        )
        for kind, equations in (("slow", slow), ("fast", fast)):
            for symbol, expression in equations.items():
                order = pole_order(expression, self.epsilon)
                if order:
                    raise DeclarationError(
                        f"the {kind} rate of {symbol} has a pole of order {order} in {self.epsilon}: {expression}. "
                        "Write epsilon y' = g with g regular, or declare a VectorField and split it."
                    )
        _freeze(self, slow=slow, fast=fast, parameters=parameters, observables=observables)
        object.__setattr__(self, "states", (*slow, *fast))
        object.__setattr__(self, "rates", (*slow.values(), *(g / self.epsilon for g in fast.values())))

    @property
    def x(self) -> tuple[sp.Symbol, ...]:
        """The slow symbols."""
        return tuple(self.slow)

    @property
    def y(self) -> tuple[sp.Symbol, ...]:
        """The fast symbols."""
        return tuple(self.fast)

    @cached_property
    def f(self) -> sp.ImmutableMatrix:
        """Slow rates f(x, y, epsilon), a column."""
        return sp.ImmutableMatrix(list(self.slow.values()))

    @cached_property
    def g(self) -> sp.ImmutableMatrix:
        """Fast rates g(x, y, epsilon), a column; epsilon y' = g."""
        return sp.ImmutableMatrix(list(self.fast.values()))

    def with_parameters(self, **values: float) -> SlowFastSystem:
        """The same system with other values for some parameters, given by name."""
        return SlowFastSystem(
            slow=self.slow,
            fast=self.fast,
            epsilon=self.epsilon,
            parameters=_updated(self.parameters, values),
            name=self.name,
            observables=self.observables,
        )

    def __repr__(self) -> str:
        return (
            f"SlowFastSystem(slow={_names(self.slow)}, fast={_names(self.fast)}, epsilon={self.epsilon}, "
            f"parameters={_listing(self.parameters)})"
        )

    def __str__(self) -> str:
        rows = [(f"{symbol}'", expression) for symbol, expression in self.slow.items()]
        rows += [(f"{self.epsilon} {symbol}'", expression) for symbol, expression in self.fast.items()]
        return _card(self.name or "slow-fast system", rows, self.parameters)

    def _repr_latex_(self) -> str:
        rows = [(rf"\dot {sp.latex(s)}", e) for s, e in self.slow.items()]
        rows += [(rf"{sp.latex(self.epsilon)}\,\dot {sp.latex(s)}", e) for s, e in self.fast.items()]
        return _aligned(rows)

    def _key(self) -> tuple:
        return (
            "SlowFastSystem",
            tuple(self.slow.items()),
            tuple(self.fast.items()),
            self.epsilon,
            tuple(self.parameters.items()),
            tuple(self.observables.items()),
            self.name,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SlowFastSystem) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


@dataclass(frozen=True, eq=False, repr=False, init=False)
class VectorField(Flow):
    """A field z' = F(z, epsilon); F may have poles in epsilon, and `epsilon=None` says that it has none.

    A field without epsilon can be integrated, not split. Raises `DeclarationError` as `SlowFastSystem` does,
    and when `epsilon` is given but appears in no equation.

    >>> v, w, eps = sp.symbols("v w epsilon")
    >>> VectorField(states={v: -w, w: -w/eps + v}, epsilon=eps)
    VectorField(states=[v, w], epsilon=epsilon, parameters={})
    """

    equations: Mapping[sp.Symbol, sp.Expr]
    epsilon: sp.Symbol | None
    parameters: Values
    name: str
    observables: Values

    def __init__(
        self,
        states: Mapping[sp.Symbol, sp.Expr],
        *,
        epsilon: sp.Symbol | None,
        parameters: Values | None = None,
        name: str = "",
        observables: Values | None = None,
    ) -> None:
        equations = _equations(states, "states")
        if not equations:
            raise DeclarationError("a VectorField has at least one state. Got none.")
        watched = _equations(observables or {}, "observables")
        values = _checked(
            states=tuple(equations),
            expressions=tuple(equations.values()),
            observables=watched,
            epsilon=epsilon,
            parameters=parameters or {},
        )
        if epsilon is not None and not any(e.has(epsilon) for e in equations.values()):
            shown = ", ".join(f"{s}' = {e}" for s, e in equations.items())
            raise DeclarationError(
                f"{epsilon} does not appear in any equation. Got {shown}. "
                f"Write the fast rates as g/{epsilon}, use `SlowFastSystem`, or pass epsilon=None."
            )
        _freeze(self, equations=equations, parameters=values, observables=watched)
        object.__setattr__(self, "states", tuple(equations))
        object.__setattr__(self, "rates", tuple(equations.values()))
        object.__setattr__(self, "epsilon", epsilon)
        object.__setattr__(self, "name", name)

    def with_parameters(self, **values: float) -> VectorField:
        """The same field with other values for some parameters, given by name."""
        return VectorField(
            self.equations,
            epsilon=self.epsilon,
            parameters=_updated(self.parameters, values),
            name=self.name,
            observables=self.observables,
        )

    def __repr__(self) -> str:
        return (
            f"VectorField(states={_names(self.equations)}, epsilon={self.epsilon}, "
            f"parameters={_listing(self.parameters)})"
        )

    def __str__(self) -> str:
        rows = [(f"{symbol}'", expression) for symbol, expression in self.equations.items()]
        return _card(self.name or "vector field", rows, self.parameters)

    def _repr_latex_(self) -> str:
        return _aligned([(rf"\dot {sp.latex(s)}", e) for s, e in self.equations.items()])

    def _key(self) -> tuple:
        return (
            "VectorField",
            tuple(self.equations.items()),
            self.epsilon,
            tuple(self.parameters.items()),
            tuple(self.observables.items()),
            self.name,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, VectorField) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


def exact(value: float | str | sp.Expr) -> sp.Rational:
    """Exact rational of a number; a float counts as the shortest decimal that prints it, 0.2 as 1/5."""
    if isinstance(value, sp.Rational):
        return value
    if isinstance(value, bool) or value is None:
        raise DeclarationError(f"{value!r} is no number. Give an int, a float or a Fraction.")
    if isinstance(value, str) and not DECIMAL.fullmatch(value):
        raise DeclarationError(
            f"{value[:80]!r} is no number. Give an int, a float or a Fraction, or digits as text."
        )
    if isinstance(value, sp.Float):
        # SymPy prints 15 digits; a double needs up to 17 to come back.
        value = float(value) if getattr(value, "_prec", 53) <= 53 else sp.sstr(value, full_prec=True)
    try:
        number = sp.Rational(str(value))
    except (TypeError, ValueError):
        number = None
    if not isinstance(number, sp.Rational):
        raise DeclarationError(f"{value!r} is no finite real number. Give an int, a float or a Fraction.")
    return number


def _equations(equations: Mapping, what: str) -> dict[sp.Symbol, sp.Expr]:
    if not isinstance(equations, Mapping):
        raise DeclarationError(f"{what} maps symbols to expressions. Got {type(equations).__name__}.")
    result: dict[sp.Symbol, sp.Expr] = {}
    for symbol, expression in equations.items():
        if not isinstance(symbol, sp.Symbol):
            raise DeclarationError(f"{what} is keyed by SymPy symbols. Got the key {symbol!r}.")
        if isinstance(expression, float):
            expression = exact(expression)
        try:
            expression = sp.sympify(expression, strict=True)
        except sp.SympifyError:
            raise DeclarationError(
                f"the right-hand side of {symbol} is a {type(expression).__name__}, {expression!r}. "
                "Give a SymPy expression; text is read by gsp.load only."
            ) from None
        if not isinstance(expression, sp.Expr) or isinstance(expression, (sp.MatrixBase, sp.MatrixExpr)):
            raise DeclarationError(
                f"the right-hand side of {symbol} is no scalar expression. Got {expression!r}."
            )
        result[symbol] = _exact_numbers(expression)
    return result


def _exact_numbers(expression: sp.Expr) -> sp.Expr:
    floats = expression.atoms(sp.Float)
    return expression.xreplace({number: exact(number) for number in floats}) if floats else expression


def _checked(
    *,
    states: tuple[sp.Symbol, ...],
    expressions: tuple[sp.Expr, ...],
    observables: Mapping[sp.Symbol, sp.Expr],
    epsilon: sp.Symbol | None,
    parameters: Mapping,
) -> dict[sp.Symbol, sp.Rational]:
    """Parameter values, exact, in the order given, after every check that does not depend on the noun."""
    if epsilon is not None and not isinstance(epsilon, sp.Symbol):
        raise DeclarationError(f"epsilon is a SymPy symbol. Got {epsilon!r}; its value is given later.")
    if not isinstance(parameters, Mapping):
        raise DeclarationError(f"parameters maps symbols to numbers. Got {type(parameters).__name__}.")
    values: dict[sp.Symbol, sp.Rational] = {}
    for symbol, value in parameters.items():
        if not isinstance(symbol, sp.Symbol):
            raise DeclarationError(f"parameters is keyed by SymPy symbols. Got the key {symbol!r}.")
        if value is None:
            raise DeclarationError(f"the parameter {symbol} has no value. Give it a number.")
        try:
            values[symbol] = exact(value)
        except DeclarationError as error:
            raise DeclarationError(f"the parameter {symbol} has the value {value!r}. {error}") from None
    everything = (*expressions, *observables.values())
    used = set().union(*(e.free_symbols for e in everything))
    own = () if epsilon is None else (epsilon,)
    _check_names([*states, *own, *values, *(used - set(states) - set(own) - set(values)), *observables])
    for role, symbols in (("epsilon", own), ("a parameter", values), ("an observable", observables)):
        for symbol in symbols:
            if symbol in states:
                raise DeclarationError(
                    f"{symbol} is a state and also {role}. Give one of the two another name."
                )
    for symbol in observables:
        if symbol in values or symbol in own:
            role = "epsilon" if symbol in own else "a parameter"
            raise DeclarationError(f"{symbol} is an observable and also {role}. Give it another name.")
    if epsilon in values:
        raise DeclarationError(
            f"{epsilon} is epsilon and also a parameter. Its value is given when integrating."
        )
    unknown = sorted(used - set(states) - set(own) - set(values), key=str)
    if unknown:
        names = ", ".join(map(str, unknown))
        known = [s.name for s in (*states, *values, *own)]
        raise DeclarationError(
            f"{names} has no value: it is no state and no parameter. "
            f"Add it as parameters={{{unknown[0]}: ...}}." + nearest(unknown[0].name, known)
        )
    for expression in everything:
        _check_expression(expression)
        if epsilon is not None:
            wrong = misplaced_epsilon(expression, epsilon)
            if wrong is not None:
                raise DeclarationError(
                    f"{epsilon} stands in {wrong}, which is no pole or power of {epsilon}. "
                    f"Replace it by its Taylor polynomial in {epsilon}, or rescale."
                )
    return values


def _check_names(symbols: Iterable[sp.Symbol]) -> None:
    seen: dict[str, sp.Symbol] = {}
    for symbol in symbols:
        if not symbol.name.isidentifier() or len(symbol.name) > 64:
            raise DeclarationError(
                f"the symbol {symbol.name[:80]!r} is no plain word. Use letters, digits and _, at most 64."
            )
        other = seen.setdefault(symbol.name, symbol)
        if other != symbol:
            raise DeclarationError(
                f"two different symbols are named {symbol.name} (their assumptions differ). Use one object throughout."
            )


def _check_expression(expression: sp.Expr) -> None:
    if expression.has(sp.nan, sp.zoo, sp.oo, -sp.oo):
        raise DeclarationError(f"{expression} is not finite. Remove the division by zero.")
    if expression.has(sp.I):
        raise DeclarationError(f"{expression} is complex. Declare real and imaginary parts as separate states.")
    applied = expression.atoms(AppliedUndef)
    if applied:
        raise DeclarationError(
            f"{expression} contains the unknown function {sorted(map(str, applied))[0]}. "
            "Use plain symbols for states; for time declare a state t with t' = 1."
        )
    for piece in sp.preorder_traversal(expression):
        if isinstance(piece, (sp.Derivative, sp.Integral)):
            raise DeclarationError(f"{expression} contains {piece}. Carry out derivatives and integrals first.")


def _updated(parameters: Values, values: Mapping[str, float]) -> dict[sp.Symbol, sp.Expr]:
    names = {symbol.name: symbol for symbol in parameters}
    result = dict(parameters)
    for name, value in values.items():
        if name not in names:
            raise DeclarationError(
                f'there is no parameter "{name}". The parameters are {", ".join(names) or "none"}.'
                + nearest(name, names)
            )
        result[names[name]] = exact(value)
    return result


def _freeze(target: object, **mappings: Mapping) -> None:
    for attribute, mapping in mappings.items():
        object.__setattr__(target, attribute, MappingProxyType(dict(mapping)))


def _names(symbols: Iterable[sp.Symbol]) -> str:
    return "[" + ", ".join(s.name for s in symbols) + "]"


def _listing(parameters: Values) -> str:
    return "{" + ", ".join(f"{s}: {v}" for s, v in parameters.items()) + "}"


def _card(title: str, rows: list[tuple[str, sp.Expr]], parameters: Values) -> str:
    width = max(len(left) for left, _ in rows)
    lines = [title, *(f"  {left:>{width}} = {right}" for left, right in rows)]
    if parameters:
        lines.append("  with " + ", ".join(f"{s} = {v}" for s, v in parameters.items()))
    return "\n".join(lines)


def _aligned(rows: list[tuple[str, sp.Expr]]) -> str:
    body = r" \\ ".join(f"{left} &= {sp.latex(right)}" for left, right in rows)
    return rf"$\displaystyle \begin{{aligned}} {body} \end{{aligned}}$"
