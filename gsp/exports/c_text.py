"""C99: functions that fill an array."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from gsp.algebra.languages import C
from gsp.exports.body import FunctionBody, bodies_of, commented, heading, starts_of, values_of
from gsp.exports.names import renamed
from gsp.exports.reduced_model import ReducedModel
from gsp.exports.reserved_words import C_WORDS


def c_text(model: ReducedModel) -> str:
    """C99 functions that fill an array; parameters in an array, their default values beside."""
    names = renamed(model.symbols, reserved=C_WORDS)
    parameters = values_of(model)
    listed = ", ".join(value for _, value in parameters) or "0.0"
    head = f"const double *state, double {names[model.epsilon]}, const double *parameters, double *out"
    functions = []
    bodies = bodies_of(C, model, names, C_WORDS)
    for name, (body, says) in zip(("reduced_rates", "reduced_slow_manifold"), bodies):
        lines = [f"(void){word};" for word in ("state", names[model.epsilon], "parameters")]
        lines += _read(model, body, names)
        lines += [f"const double {step} = {text};" for step, text in body.steps]
        lines += [f"out[{i}] = {text};" for i, text in enumerate(body.results)]
        functions.append(f"/* {says} */\n" + _function(name, head, lines))
    text = "\n".join(functions)
    places = ", ".join(names[s] for s, _ in parameters) or "there are none"
    prelude = "#include <math.h>\n\n"
    if "sign(" in text:
        prelude += "static double sign(double u)\n{\n    return u > 0.0 ? 1.0 : u < 0.0 ? -1.0 : u;\n}\n\n"
    prelude += f"/* Default values of the parameters: {places}. */\n"
    prelude += f"const double reduced_parameters[{max(len(parameters), 1)}] = {{{listed}}};\n"
    prelude += f"/* {heading('A start of', model.states, names)} */\n"
    prelude += f"const double reduced_start[{len(model.states)}] = {{{starts_of(model)}}};\n"
    return f"{commented(model, names, '/* ', ' */')}\n{prelude}\n{text}"


def _function(name: str, head: str, lines: Sequence[str]) -> str:
    return f"void {name}({head})\n{{\n" + "".join(f"    {line}\n" for line in lines) + "}\n"


def _read(model: ReducedModel, body: FunctionBody, names: Mapping[sp.Symbol, str]) -> list[str]:
    """The symbols that a body uses, from the arrays that hold them."""
    parameters = [symbol for symbol, _ in values_of(model)]
    return [
        f"const double {names[symbol]} = {array}[{i}];"
        for array, symbols in (("state", model.states), ("parameters", parameters))
        for i, symbol in enumerate(symbols)
        if symbol in body.used
    ]
