"""What each language calls the functions: the one table that everything printed as code is made of."""

from __future__ import annotations

from dataclasses import replace

from gsp.algebra.printing import REWRITTEN, Language

SAME = (
    "exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan", "asinh", "acosh",
    "atanh", "log1p", "expm1",
)  # fmt: skip
"""Functions that go by SymPy's name in most languages."""
INVERSE = ("asin", "acos", "atan", "asinh", "acosh", "atanh")


PYTHON = Language(
    "NumPy",
    {
        **{name: f"np.{name}" for name in SAME},
        **{name: f"np.arc{name[1:]}" for name in INVERSE},
        "Abs": "np.abs", "sign": "np.sign", "Max": "np.maximum", "Min": "np.minimum", "erf": "erf",
    },
    "{}**{}".format,
)  # fmt: skip
JAX = Language("JAX", {n: f.replace("np.", "jnp.") for n, f in PYTHON.functions.items()}, "{}**{}".format)
CASADI = Language(
    "CasADi",
    {
        **{name: f"ca.{name}" for name in SAME},
        "Abs": "ca.fabs", "sign": "ca.sign", "Max": "ca.fmax", "Min": "ca.fmin", "erf": "ca.erf",
    },
    "{}**{}".format,
)  # fmt: skip
C = Language(
    "C",
    {
        **{name: name for name in SAME},
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
        **{name: f"Math.{name}" for name in SAME},
        "Abs": "Math.abs", "sign": "Math.sign", "Max": "Math.max", "Min": "Math.min",
    },
    "Math.pow({}, {})".format,
)  # fmt: skip
PAGE = replace(JAVASCRIPT, functions={**JAVASCRIPT.functions, "erf": "erf"})
"""JavaScript with what demos/page/functions.js defines."""
JULIA = Language(
    "Julia",
    {**{name: name for name in SAME}, "Abs": "abs", "sign": "sign", "Max": "max", "Min": "min"},
    "({}^{})".format,
)
XPPAUT = Language(
    "XPPAUT",
    {
        **{name: name for name in SAME if name not in REWRITTEN},
        "Abs": "abs", "sign": "sign", "Max": "max", "Min": "min", "erf": "erf",
    },
    "({}^{})".format,
    # Of a line XPPAUT reads 1024 characters, name and continued lines included.
    longest=900,
)  # fmt: skip
SBML = Language(
    "SBML",
    {
        **{name: name for name in SAME if name not in (*INVERSE, "log1p", "expm1")},
        **{name: f"arc{name[1:]}" for name in INVERSE},
        "log": "ln", "sqrt": "root", "Abs": "abs",
    },
    "<apply><power/>{}{}</apply>".format,
)  # fmt: skip
"""The names are those of MathML."""
