"""Which words the texts of each language may not take for names."""

from __future__ import annotations

import keyword

from gsp.algebra.languages import SAME


def _words(text: str) -> set[str]:
    return set(text.split())


PYTHON_WORDS = {
    *keyword.kwlist,
    *keyword.softkwlist,
    *_words("np jnp ca math erf t state start rates slow_manifold"),
}
C_WORDS = {
    *_words(
        "auto break case char const continue default do double else enum extern float for goto if inline int long "
        "register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while "
        "asm bool true false nullptr constexpr alignas alignof thread_local static_assert typeof typeof_unqual "
        "state parameters out sign reduced_rates reduced_slow_manifold reduced_parameters reduced_start "
        "class new this template namespace "
        "private public protected operator delete try catch throw using virtual friend explicit export "
        "mutable typename const_cast and or not xor bitand bitor compl and_eq or_eq not_eq xor_eq NAN INFINITY "
        "linux unix main errno signgam gamma lgamma tgamma erf erfc j0 j1 jn y0 y1 yn "
        # What math.h defines, where it is not asked for the standard alone too.
        "HUGE_VAL HUGE_VALF HUGE_VALL FP_NAN FP_INFINITE FP_ZERO FP_SUBNORMAL FP_NORMAL FP_ILOGB0 FP_ILOGBNAN "
        "FP_FAST_FMA FP_FAST_FMAF FP_FAST_FMAL MATH_ERRNO MATH_ERREXCEPT math_errhandling MAXFLOAT SNAN M_E M_LOG2E "
        "M_LOG10E M_LN2 M_LN10 M_PI M_PI_2 M_PI_4 M_1_PI M_2_PI M_2_SQRTPI M_SQRT2 M_SQRT1_2"
    ),
    *SAME, "pow", "fabs", "fmax", "fmin",
}  # fmt: skip
JAVASCRIPT_WORDS = _words(
    "abstract arguments await boolean break byte case catch char class const continue debugger default delete do "
    "double else enum eval export extends false final finally float for function goto if implements import in "
    "instanceof int interface let long native new null package private protected public return short static super "
    "switch synchronized this throw throws transient true try typeof undefined var void volatile while with yield "
    "async of get set NaN Infinity Math module exports require "
    "state start given rates slowManifold parameters globalThis"
)
JULIA_WORDS = {
    *_words(
        "baremodule begin break catch const continue do else elseif end export false finally for function global if "
        "import let local macro module quote return struct true try using while abstract mutable primitive type where "
        "in isa outer as public NaN Inf pi im missing nothing state start rates slow_manifold"
    ),
    *SAME, "abs", "sign", "max", "min",
}  # fmt: skip
XPPAUT_WORDS = {
    *_words(
        "t pi sin cos tan atan atan2 sinh cosh tanh exp delay ln log log10 heav sign ceil flr ran normal max min erf "
        "erfc mod if then else sum of shift del_shft hom_bcs besselj bessely besseli lgamma not poisson int abs sqrt "
        "asin acos ishift set par param params parameter parameters number num init aux global table markov wiener "
        "volt volterra bdry bndry solv solve special export vector include options only done p i d b dae start end"
    ),
    *(f"arg{k}" for k in range(1, 21)),
}  # fmt: skip
# XPPAUT keeps so many characters of a name.
XPPAUT_NAME = 9
