"""The text of a reduced model in each language; every one stands alone."""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.exports.names import fresh, renamed
from gsp.exports.printing import Language, Printer
from gsp.exports.reduced_model import ReducedModel

_SAME = (
    "exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan", "asinh", "acosh",
    "atanh",
)  # fmt: skip
_INVERSE = ("asin", "acos", "atan", "asinh", "acosh", "atanh")


def _words(text: str) -> set[str]:
    return set(text.split())


PYTHON = Language(
    "NumPy",
    {
        **{name: f"np.{name}" for name in _SAME},
        **{name: f"np.arc{name[1:]}" for name in _INVERSE},
        "Abs": "np.abs", "sign": "np.sign", "Max": "np.maximum", "Min": "np.minimum", "erf": "erf",
    },
    "{}**{}".format,
)  # fmt: skip
C = Language(
    "C",
    {
        **{name: name for name in _SAME},
        "Abs": "fabs",
        "sign": "sign",
        "Max": "fmax",
        "Min": "fmin",
        "erf": "erf",
    },
    "pow({}, {})".format,
    whole="{}.0",
)
JAVASCRIPT = Language(
    "JavaScript",
    {
        **{name: f"Math.{name}" for name in _SAME},
        "Abs": "Math.abs", "sign": "Math.sign", "Max": "Math.max", "Min": "Math.min",
    },
    "Math.pow({}, {})".format,
)  # fmt: skip
JULIA = Language(
    "Julia",
    {**{name: name for name in _SAME}, "Abs": "abs", "sign": "sign", "Max": "max", "Min": "min"},
    "({}^{})".format,
)
XPPAUT = Language(
    "XPPAUT",
    {
        **{name: name for name in _SAME if name not in ("asinh", "acosh", "atanh")},
        "Abs": "abs", "sign": "sign", "Max": "max", "Min": "min",
    },
    "({}^{})".format,
)  # fmt: skip

_PYTHON_WORDS = {
    *keyword.kwlist,
    *keyword.softkwlist,
    "np",
    "math",
    "erf",
    "t",
    "slow",
    "rates",
    "slow_manifold",
}
_C_WORDS = {
    *_words(
        "auto break case char const continue default do double else enum extern float for goto if inline int long "
        "register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while "
        "asm bool true false nullptr constexpr alignas alignof thread_local static_assert typeof typeof_unqual "
        "slow parameters out sign reduced_rates reduced_slow_manifold reduced_parameters class new this template "
        "namespace private public protected operator delete try catch throw using virtual friend explicit export "
        "mutable typename const_cast and or not xor bitand bitor compl and_eq or_eq not_eq xor_eq NAN INFINITY "
        "HUGE_VAL linux unix main errno signgam gamma lgamma tgamma erf erfc j0 j1 jn y0 y1 yn"
    ),
    *_SAME, "pow", "fabs", "fmax", "fmin",
}  # fmt: skip
_JAVASCRIPT_WORDS = _words(
    "abstract arguments await boolean break byte case catch char class const continue debugger default delete do "
    "double else enum eval export extends false final finally float for function goto if implements import in "
    "instanceof int interface let long native new null package private protected public return short static super "
    "switch synchronized this throw throws transient true try typeof undefined var void volatile while with yield "
    "async of get set NaN Infinity Math module exports require "
    "slow given rates slowManifold parameters globalThis"
)
_JULIA_WORDS = {
    *_words(
        "baremodule begin break catch const continue do else elseif end export false finally for function global if "
        "import let local macro module quote return struct true try using while abstract mutable primitive type where "
        "in isa outer as public NaN Inf pi im missing nothing slow rates slow_manifold"
    ),
    *_SAME, "abs", "sign", "max", "min",
}  # fmt: skip
_XPPAUT_WORDS = {
    *_words(
        "t pi sin cos tan atan atan2 sinh cosh tanh exp delay ln log log10 heav sign ceil flr ran normal max min erf "
        "erfc mod if then else sum of shift del_shft hom_bcs besselj bessely besseli lgamma not poisson int abs sqrt "
        "asin acos ishift set par param params parameter parameters number num init aux global table markov wiener "
        "volt volterra bdry bndry solv solve special export vector include options only done p i d b dae"
    ),
    *(f"arg{k}" for k in range(1, 10)),
}  # fmt: skip
# XPPAUT keeps so many characters of a name.
_XPPAUT_NAME = 9


def python_text(model: ReducedModel) -> str:
    """NumPy functions of numbers or of arrays, keyword arguments for parameters."""
    names = renamed(model.symbols, reserved=_PYTHON_WORDS)
    functions = []
    for head, places, outputs, says in (
        ("rates(t, slow", "slow", model.rates, _named("The rates of", model.slow, names)),
        ("slow_manifold(slow", "slow", model.manifold, _named("The slow manifold:", model.fast, names)),
    ):
        body = _body(PYTHON, model, outputs, names, _PYTHON_WORDS)
        values = "".join(f", {names[s]}={v}" for s, v in _values(model, with_epsilon=True))
        lines = [f"{names[s]} = {places}[{i}]" for i, s in enumerate(model.slow) if s in body.used]
        lines += [f"{name} = {text}" for name, text in body.steps]
        # What is constant gets the shape of the others.
        results = ", ".join(body.results)
        lines.append(f"return np.array(np.broadcast_arrays({results}, 0.0 * slow[0])[:-1])")
        functions.append(f'def {head}{values}):\n    """{says}"""\n' + "".join(f"    {x}\n" for x in lines))
    text = "\n\n".join(functions)
    imports = "import numpy as np\n"
    if "erf(" in text:
        imports = f"import math\n\n{imports}\nerf = np.vectorize(math.erf, otypes=[float])\n"
    return f"{_commented(model, names, '# ')}\n{imports}\n\n{text}"


def c_text(model: ReducedModel) -> str:
    """C99 functions that fill an array; parameters in an array, their default values beside."""
    names = renamed(model.symbols, reserved=_C_WORDS)
    parameters = _values(model)
    listed = ", ".join(value for _, value in parameters) or "0.0"
    head = f"const double *slow, double {names[model.epsilon]}, const double *parameters, double *out"
    functions = []
    for name, outputs, says in (
        ("reduced_rates", model.rates, _named("The rates of", model.slow, names)),
        ("reduced_slow_manifold", model.manifold, _named("The slow manifold:", model.fast, names)),
    ):
        body = _body(C, model, outputs, names, _C_WORDS)
        lines = [f"const double {names[s]} = slow[{i}];" for i, s in enumerate(model.slow) if s in body.used]
        lines += [
            f"const double {names[s]} = parameters[{i}];"
            for i, (s, _) in enumerate(parameters)
            if s in body.used
        ]
        lines += [f"const double {step} = {text};" for step, text in body.steps]
        lines += [f"out[{i}] = {text};" for i, text in enumerate(body.results)]
        unused = [f"(void){word};" for word in ("slow", names[model.epsilon], "parameters")]
        functions.append(
            f"/* {says} */\nvoid {name}({head})\n{{\n"
            + "".join(f"    {x}\n" for x in (*unused, *lines))
            + "}\n"
        )
    text = "\n".join(functions)
    places = ", ".join(names[s] for s, _ in parameters) or "there are none"
    prelude = "#include <math.h>\n\n"
    if "sign(" in text:
        prelude += "static double sign(double u)\n{\n    return u > 0.0 ? 1.0 : u < 0.0 ? -1.0 : u;\n}\n\n"
    prelude += f"/* Default values of the parameters: {places}. */\n"
    prelude += f"const double reduced_parameters[{max(len(parameters), 1)}] = {{{listed}}};\n"
    return f"{_commented(model, names, '/* ', ' */')}\n{prelude}\n{text}"


def javascript_text(model: ReducedModel) -> str:
    """JavaScript functions that return an array; `given` replaces default values of parameters."""
    names = renamed(model.symbols, reserved=_JAVASCRIPT_WORDS)
    parameters = _values(model)
    listed = ", ".join(f"{names[s]}: {value}" for s, value in parameters)
    functions = []
    for name, outputs, says in (
        ("rates", model.rates, _named("The rates of", model.slow, names)),
        ("slowManifold", model.manifold, _named("The slow manifold:", model.fast, names)),
    ):
        body = _body(JAVASCRIPT, model, outputs, names, _JAVASCRIPT_WORDS)
        lines = [f"const {names[s]} = slow[{i}];" for i, s in enumerate(model.slow) if s in body.used]
        used = [names[s] for s, _ in parameters if s in body.used]
        if used:
            lines.append(f"const {{{', '.join(used)}}} = {{...parameters, ...given}};")
        lines += [f"const {step} = {text};" for step, text in body.steps]
        lines.append(f"return [{', '.join(body.results)}];")
        functions.append(
            f"// {says}\nfunction {name}(slow, {names[model.epsilon]} = {model.value!r}, given = {{}}) {{\n"
            + "".join(f"  {line}\n" for line in lines)
            + "}\n"
        )
    exported = 'if (typeof module !== "undefined") module.exports = {parameters, rates, slowManifold};\n'
    head = f"const parameters = {{{listed}}};\n"
    return "\n".join([_commented(model, names, "// "), head, *functions, exported])


def julia_text(model: ReducedModel) -> str:
    """Julia functions that return a vector, keyword arguments for parameters."""
    names = renamed(model.symbols, reserved=_JULIA_WORDS)
    functions = []
    for name, outputs, says in (
        ("rates", model.rates, _named("The rates of", model.slow, names)),
        ("slow_manifold", model.manifold, _named("The slow manifold:", model.fast, names)),
    ):
        body = _body(JULIA, model, outputs, names, _JULIA_WORDS)
        values = ", ".join(f"{names[s]} = {value}" for s, value in _values(model))
        lines = [f"{names[s]} = slow[{i + 1}]" for i, s in enumerate(model.slow) if s in body.used]
        lines += [f"{step} = {text}" for step, text in body.steps]
        lines.append(f"return [{', '.join(body.results)}]")
        head = (
            f"function {name}(slow, {names[model.epsilon]} = {model.value!r}{'; ' + values if values else ''})"
        )
        functions.append(f"# {says}\n{head}\n" + "".join(f"    {line}\n" for line in lines) + "end\n")
    return "\n".join([_commented(model, names, "# "), *functions])


def ode_text(model: ReducedModel) -> str:
    """An .ode file of XPPAUT; the fast variables are auxiliary quantities."""
    names = renamed(model.symbols, reserved=_XPPAUT_WORDS, longest=_XPPAUT_NAME, cases=False)
    body = _body(XPPAUT, model, [*model.rates, *model.manifold], names, _XPPAUT_WORDS)
    rates, manifold = body.results[: len(model.slow)], body.results[len(model.slow) :]
    lines = [f"par {names[s]}={value}" for s, value in _values(model, with_epsilon=True)]
    lines += [f"{name}={text}" for name, text in body.steps]
    lines += [f"{names[s]}'={text}" for s, text in zip(model.slow, rates)]
    lines += [f"aux {names[s]}={text}" for s, text in zip(model.fast, manifold)]
    lines += [f"init {names[s]}={model.start[s.name]!r}" for s in model.slow]
    lines += [f"@ t0={model.span[0]!r}, total={model.span[1] - model.span[0]!r}", "done"]
    return _commented(model, names, "# ") + "".join(f"{line}\n" for line in lines)


def latex_text(model: ReducedModel) -> str:
    """An `align` environment of amsmath: rates, then the slow manifold, a row for each power of epsilon."""
    names = renamed(model.symbols, reserved=())
    symbols = {s: sp.Symbol(name) for s, name in names.items()}
    power = symbols[model.epsilon]
    rows = []
    for left, variables, terms in (
        (r"\dot{{{}}}", model.slow, model.rate_terms),
        ("{}", model.fast, model.manifold_terms),
    ):
        for i, variable in enumerate(variables):
            start = left.format(sp.latex(symbols[variable])) + " &= "
            for k, row in enumerate(terms):
                term = row[i].xreplace(symbols)
                if term == 0 and (k or any(other[i] != 0 for other in terms)):
                    continue
                factor = "" if k == 0 else sp.latex(power**k)
                text = sp.latex(term) if k == 0 else rf"{factor} \left({sp.latex(term)}\right)"
                rows.append(start + text)
                start = r"&\quad + "
    values = [f"{sp.latex(symbols[s])} = {sp.latex(v)}" for s, v in model.parameters.items()]
    text = _commented(model, names, "% ") + "\\begin{align}\n" + " \\\\\n".join(rows) + "\n\\end{align}\n"
    return text + (f"with ${', '.join(values)}$.\n" if values else "")


FORMATS: Mapping[str, Callable[[ReducedModel], str]] = {
    "python": python_text,
    "c": c_text,
    "javascript": javascript_text,
    "julia": julia_text,
    "latex": latex_text,
    "ode": ode_text,
}


@dataclass(frozen=True)
class _Body:
    """Intermediate values and results of a function, and which symbols they use."""

    steps: Sequence[tuple[str, str]]
    results: Sequence[str]
    used: frozenset[sp.Basic]


def _body(
    language: Language,
    model: ReducedModel,
    outputs: list[sp.Expr],
    names: Mapping[sp.Symbol, str],
    reserved: Iterable[str],
) -> _Body:
    taken = fresh(names.values(), reserved=set(reserved), cases=False)
    steps, results = Printer(language, names).steps(outputs, taken)
    return _Body(steps, results, frozenset(s for output in outputs for s in output.free_symbols))


def _values(model: ReducedModel, *, with_epsilon: bool = False) -> list[tuple[sp.Symbol, str]]:
    """Parameters with their default values, to the last bit."""
    first = [(model.epsilon, repr(model.value))] if with_epsilon else []
    return first + [(symbol, repr(_nearest(value))) for symbol, value in model.parameters.items()]


def _nearest(value: sp.Expr) -> float:
    return int(value.p) / int(value.q) if isinstance(value, sp.Rational) else float(value)


def _named(what: str, symbols: Iterable[sp.Symbol], names: Mapping[sp.Symbol, str]) -> str:
    return f"{what} {', '.join(names[s] for s in symbols)}."


def _commented(model: ReducedModel, names: Mapping[sp.Symbol, str], begin: str, end: str = "") -> str:
    return "".join(f"{begin}{line}{end}\n" for line in model.comment(names))
