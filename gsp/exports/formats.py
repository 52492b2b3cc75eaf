"""The text of a reduced model in each language; every one stands alone."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

import sympy as sp

from gsp.algebra.languages import JAVASCRIPT, JULIA, XPPAUT
from gsp.algebra.sharing import is_shared
from gsp.errors import BudgetError
from gsp.exports.body import bodies_of, body_of, commented, heading, starts_of, values_of
from gsp.exports.c_text import c_text
from gsp.exports.names import renamed
from gsp.exports.python_texts import casadi_text, jax_text, python_text
from gsp.exports.reduced_model import ReducedModel
from gsp.exports.reserved_words import JAVASCRIPT_WORDS, JULIA_WORDS, XPPAUT_NAME, XPPAUT_WORDS
from gsp.exports.sbml_text import sbml_text
from gsp.results.long_formulas import NamedParts, lines
from gsp.results.tex import as_spelt, name_in_tex, tex
from gsp.systems.tolerances import RTOL


def javascript_text(model: ReducedModel) -> str:
    """JavaScript functions that return an array; `given` replaces default values of parameters."""
    names = renamed(model.symbols, reserved=JAVASCRIPT_WORDS)
    parameters = values_of(model)
    listed = ", ".join(f"{names[s]}: {value}" for s, value in parameters)
    functions = []
    bodies = bodies_of(JAVASCRIPT, model, names, JAVASCRIPT_WORDS)
    for name, (body, says) in zip(("rates", "slowManifold"), bodies):
        lines = [f"const {names[s]} = state[{i}];" for i, s in enumerate(model.states) if s in body.used]
        used = [names[s] for s, _ in parameters if s in body.used]
        if used:
            lines.append(f"const {{{', '.join(used)}}} = {{...parameters, ...given}};")
        lines += [f"const {step} = {text};" for step, text in body.steps]
        lines.append(f"return [{', '.join(body.results)}];")
        functions.append(
            f"// {says}\nfunction {name}(state, {names[model.epsilon]} = {model.value!r}, given = {{}}) {{\n"
            + "".join(f"  {line}\n" for line in lines)
            + "}\n"
        )
    exported = 'if (typeof module !== "undefined") module.exports = {parameters, start, rates, slowManifold};\n'
    head = f"const parameters = {{{listed}}};\nconst start = [{starts_of(model)}];\n"
    return "\n".join([commented(model, names, "// "), head, *functions, exported])


def julia_text(model: ReducedModel) -> str:
    """Julia functions that return a vector, keyword arguments for parameters."""
    names = renamed(model.symbols, reserved=JULIA_WORDS)
    functions = []
    bodies = bodies_of(JULIA, model, names, JULIA_WORDS)
    for name, (body, says) in zip(("rates", "slow_manifold"), bodies):
        values = ", ".join(f"{names[s]} = {value}" for s, value in values_of(model))
        lines = [f"{names[s]} = state[{i + 1}]" for i, s in enumerate(model.states) if s in body.used]
        lines += [f"{step} = {text}" for step, text in body.steps]
        lines.append(f"return [{', '.join(body.results)}]")
        head = (
            f"function {name}(state, {names[model.epsilon]} = {model.value!r}{'; ' + values if values else ''})"
        )
        functions.append(f"# {says}\n{head}\n" + "".join(f"    {line}\n" for line in lines) + "end\n")
    begin = f"# {heading('A start of', model.states, names)}\nstart = [{starts_of(model)}]\n"
    return "\n".join([commented(model, names, "# "), begin, *functions])


def ode_text(model: ReducedModel) -> str:
    """An .ode file of XPPAUT; what is no state is an auxiliary quantity."""
    names = renamed(model.symbols, reserved=XPPAUT_WORDS, longest=XPPAUT_NAME, cases=False)
    body = body_of(XPPAUT, [*model.rates, *model.manifold], names, XPPAUT_WORDS)
    rates, manifold = body.results[: len(model.states)], body.results[len(model.states) :]
    lines = [f"par {names[s]}={value}" for s, value in values_of(model, with_epsilon=True)]
    lines += [f"{name}={text}" for name, text in body.steps]
    lines += [f"{names[s]}'={text}" for s, text in zip(model.states, rates)]
    lines += [f"aux {names[s]}={text}" for s, text in zip(model.observed, manifold)]
    lines += [f"init {names[s]}={value!r}" for s, value in zip(model.states, model.start)]
    total = model.span[1] - model.span[0]
    # By itself XPPAUT takes steps of 0.05, keeps 5000 of them, and ends a run at a value above 100.
    lines += [
        f"@ t0={model.span[0]!r}, total={total!r}, dt={total / 1000!r}, bounds={sys.float_info.max!r}",
        f"@ meth=5dp, toler={RTOL!r}, atoler={model.tolerance!r}",
        "done",
    ]
    return commented(model, names, "# ") + "".join(f"{line}\n" for line in lines)


def latex_text(model: ReducedModel) -> str:
    """An `align` environment of amsmath: rates, then the slow manifold, a row for each power of epsilon.

    What is wider than a page has a name in its row, and its sum below: TeX sets no line of more than 6 m.
    """
    if any(is_shared(term) for row in (*model.rate_terms, *model.manifold_terms) for term in row):
        raise BudgetError(
            "the coefficients are programs of many steps, which share their parts, and no formulas.",
            "Export to another format, or at order 0.",
        )
    names = renamed(model.symbols, reserved=())
    symbols = {s: sp.Symbol(name) for s, name in names.items()}
    named, parts = NamedParts(names.values()), []

    def fitting(term: sp.Expr) -> sp.Expr:
        if term in named:
            return named[term]
        broken, within = lines(term, named)
        whole = named[term] if len(broken) > 1 else broken[0]
        parts.extend([*([(whole, broken)] if len(broken) > 1 else []), *within])
        return whole

    terms_of = [
        [[fitting(row[i].xreplace(symbols)) for row in terms] for i in range(len(terms[0]))]
        for terms in (model.rate_terms, model.manifold_terms)
    ]
    letters = _letters([*symbols.values(), *(symbol for symbol, _ in parts)])

    def latex(expression: sp.Expr) -> str:
        return tex(expression, names=letters)

    rows = []
    for left, variables, coefficients in zip((r"\dot{{{}}}", "{}"), (model.states, model.observed), terms_of):
        for variable, terms in zip(variables, coefficients):
            start = left.format(latex(symbols[variable])) + " &= "
            for k, term in enumerate(terms):
                if term == 0 and (k or any(terms)):
                    continue
                factor = "" if k == 0 else latex(symbols[model.epsilon] ** k)
                rows.append(start + (latex(term) if k == 0 else rf"{factor} \left({latex(term)}\right)"))
                start = r"&\quad + "
    for symbol, sums in parts:
        start = f"{latex(symbol)} &= "
        for text in map(latex, sums):
            rows.append(start.removesuffix("+ " if text.startswith("-") else "") + text)
            start = r"&\quad + "
    values = [f"{latex(symbols[s])} = {latex(v)}" for s, v in model.parameters.items()]
    text = commented(model, names, "% ") + "\\begin{align}\n" + " \\\\\n".join(rows) + "\n\\end{align}\n"
    return text + (f"with ${', '.join(values)}$.\n" if values else "")


def _letters(symbols: Iterable[sp.Symbol]) -> dict[sp.Symbol, str]:
    """A name as a letter, or as it is spelt where that would be another's, or a rate: xdot is not that of x."""
    found = {symbol: name_in_tex(symbol.name) for symbol in symbols}
    often = Counter(found.values())
    return {
        symbol: as_spelt(symbol.name) if often[text] > 1 or "dot{" in text else text
        for symbol, text in found.items()
    }


FORMATS: Mapping[str, Callable[[ReducedModel], str]] = {
    "python": python_text,
    "jax": jax_text,
    "casadi": casadi_text,
    "c": c_text,
    "javascript": javascript_text,
    "julia": julia_text,
    "latex": latex_text,
    "ode": ode_text,
    "sbml": sbml_text,
}
