"""What the functions of a text are made of: steps and results in a language, parameters, and the comment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.algebra.printing import Language, Printer
from gsp.exports.names import fresh
from gsp.exports.reduced_model import ReducedModel


@dataclass(frozen=True)
class FunctionBody:
    """Intermediate values and results of a function, and which symbols they use."""

    steps: Sequence[tuple[str, str]]
    results: Sequence[str]
    used: frozenset[sp.Basic]


def body_of(
    language: Language,
    outputs: list[sp.Expr],
    names: Mapping[sp.Symbol, str],
    reserved: Iterable[str],
    *,
    printer: type[Printer] = Printer,
) -> FunctionBody:
    """The outputs in `language`; what is used more than once is a step, called by none of `reserved`."""
    taken = fresh(names.values(), reserved=set(reserved), cases=False)
    steps, results = printer(language, names).steps(outputs, taken)
    return FunctionBody(steps, results, frozenset(s for output in outputs for s in output.free_symbols))


def bodies_of(
    language: Language, model: ReducedModel, names: Mapping[sp.Symbol, str], reserved: Iterable[str]
) -> tuple[tuple[FunctionBody, str], tuple[FunctionBody, str]]:
    """The bodies of the two functions of a text, rates and slow manifold, with what a comment says of each."""
    return (
        (body_of(language, model.rates, names, reserved), heading("The rates of", model.states, names)),
        (
            body_of(language, model.manifold, names, reserved),
            heading("The slow manifold:", model.observed, names),
        ),
    )


def values_of(model: ReducedModel, *, with_epsilon: bool = False) -> list[tuple[sp.Symbol, str]]:
    """Parameters with their default values, to the last bit."""
    first = [(model.epsilon, repr(model.value))] if with_epsilon else []
    return first + [(symbol, repr(nearest(value))) for symbol, value in model.parameters.items()]


def starts_of(model: ReducedModel) -> str:
    """The start of each state to the last bit, with commas between."""
    return ", ".join(map(repr, model.start))


def nearest(value: sp.Expr) -> float:
    return int(value.p) / int(value.q) if isinstance(value, sp.Rational) else float(value)


def heading(what: str, symbols: Iterable[sp.Symbol], names: Mapping[sp.Symbol, str]) -> str:
    return f"{what} {', '.join(names[s] for s in symbols)}."


def commented(model: ReducedModel, names: Mapping[sp.Symbol, str], begin: str, end: str = "") -> str:
    return "".join(f"{begin}{line}{end}\n" for line in model.comment(names))
