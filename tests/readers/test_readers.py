"""Model files: what a user writes is read exactly, what a stranger writes cannot do harm."""

import contextlib
import math
import os
import sys
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gsp
from gsp import models
from gsp.errors import ModelFileError
from gsp.readers import expressions, load
from gsp.readers.expressions import parse_expression, parse_number
from gsp.readers.tokens import DIGITS, EXPONENT, NumberError
from gsp.readers.toml import parsed
from gsp.systems.system import VectorField
from tests.cases import sampled

SYMBOLS = {name: sp.Symbol(name) for name in ("x", "y", "z", "v", "E", "velocity")}
x, y, z, v = (SYMBOLS[name] for name in "xyzv")

# Calls, of Python and of C, that reading one text may make; no load on the machine changes their number.
# The largest makes 1.9 million.
MOST_CALLS = 10_000_000


@contextlib.contextmanager
def calls_within(most):
    """Fails as soon as the block has made more calls than `most`."""
    made, before = 0, sys.getprofile()

    def count(frame, event, argument):
        nonlocal made
        made += event in ("call", "c_call")
        if made > most:
            sys.setprofile(before)
            raise AssertionError(f"more than {most} calls")

    sys.setprofile(count)
    try:
        yield
    finally:
        sys.setprofile(before)


MICHAELIS_MENTEN = """
name = "michaelis_menten"
title = "An enzyme & its <substrate>"

[parameters]
kappa = 1
lambda = 0.5

[slow]
s = "-s + (s + kappa - lambda)*c"

[fast]
c = "s - (s + kappa)*c"

[region]
s = [0.1, 2]

[start]
s = 1
c = 0.5

[scene]
span = [0, 5]
epsilon = 0.01
"""

SLEIGH = """
name = "chaplygin_sleigh"

[parameters]
m = 1
I = 1
a = "1/5"

[states]
v = "omega*w + a*omega^2"
omega = "a*w/(I*epsilon)"
w = "-v*omega - (I + m*a^2)/(I*m*epsilon)*w"

[reconstruction]
phi = "omega"
x = "v*cos(phi) - w*sin(phi)"
y = "v*sin(phi) + w*cos(phi)"

[region]
v = [-2, 2]
omega = [-2, 2]
w = [-1, 1]

[start]
v = -1.5
omega = 1
phi = 2
w = 0

[scene]
span = [0, 12]
epsilon = 0.05
epsilons = [0.02, 0.01, 0.005, 0.0025]
path = ["x", "y"]
"""


def parse(text: str) -> sp.Expr:
    return parse_expression(text, symbols=SYMBOLS)


def write(folder: Path, text: str, name: str = "model.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# The grammar


VALUES = {
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "sqrt", "exp")},
    **{name: getattr(math, name) for name in ("sinh", "cosh", "tanh", "asinh", "atanh", "log", "erf")},
    **{"acosh": lambda z: math.acosh(1 + z), "ln": math.log, "abs": abs, "sign": lambda z: math.copysign(1, z)},
    **{"min": lambda z: min(z, 0.5), "max": lambda z: max(z, 0.5)},
}


def test_a_number_is_exact_up_to_its_limits_of_digits_and_exponent() -> None:
    assert parse_number("12.5e-3") == sp.Rational(1, 80)
    assert parse_number("12.5e+3") == parse_number("12.5E3") == 12500
    assert parse_number(".5") == sp.Rational(1, 2)
    for text in (".", "", "x", "1e", "-1", "1.5.2"):
        with pytest.raises(NumberError, match="is no decimal number"):
            parse_number(text)
    assert parse_number("7." + "1" * (DIGITS - 1)) * 10 ** (DIGITS - 1) == int("7" + "1" * (DIGITS - 1))
    with pytest.raises(NumberError, match=f"a number has {DIGITS + 1} digits; {DIGITS} are allowed"):
        parse_number("7." + "1" * DIGITS)
    for sign in ("", "-"):
        assert parse_number(f"1e{sign}{EXPONENT}") == sp.Integer(10) ** int(f"{sign}{EXPONENT}")
        with pytest.raises(NumberError, match=f"beyond {EXPONENT}"):
            parse_number(f"1e{sign}{EXPONENT + 1}")


def test_a_sum_of_constants_that_nearly_cancels_is_kept_and_one_that_does_is_refused() -> None:
    near = parse("x + sqrt(2) - 1.4142135623730950488016")
    assert 8e-23 < float((near - sp.Symbol("x")).evalf(30)) < 9e-23
    with pytest.raises(ModelFileError, match="a sum of constants cancels up to rounding"):
        parse("x + sqrt(2) - 1.41421356237309504880168872420969807857")


@pytest.mark.parametrize("name", expressions.FUNCTIONS)
def test_every_function_has_its_value_and_takes_no_argument_more_or_less(name: str) -> None:
    given = {"acosh": ["1 + x"], "min": ["x", "0.5"], "max": ["x", "0.5"]}.get(name, ["x"])
    found = parse(f"{name}({', '.join(given)})")
    assert float(found.subs(sp.Symbol("x"), sp.Rational(3, 10))) == pytest.approx(VALUES[name](0.3), rel=1e-14)
    for wrong in ([*given, "1"], given[1:]):
        with pytest.raises(ModelFileError):
            parse(f"{name}({', '.join(wrong)})")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.1", sp.Rational(1, 10)),
        ("1e-3*x", x / 1000),
        ("1.5E+2", sp.Integer(150)),
        (".5 + 2.", sp.Rational(5, 2)),
        ("-x^2", -(x**2)),
        ("(-x)**2", x**2),
        ("2^-x^2", 2 ** (-(x**2))),
        ("x^y^z", x ** (y**z)),
        ("x - y - z", x - y - z),
        ("x/y/z", x / (y * z)),
        ("x/y*z", x * z / y),
        ("x - -y", x + y),
        ("2*-x", -2 * x),
        ("+x", x),
        ("x^0.5", sp.sqrt(x)),
        ("sqrt(x)*exp(-y) + log(z)", sp.sqrt(x) * sp.exp(-y) + sp.log(z)),
        ("max(x, 1) - min(y, z)", sp.Max(x, 1) - sp.Min(y, z)),
        ("abs(x)*sign(y)", sp.Abs(x) * sp.sign(y)),
        ("sin(pi/6)", sp.Rational(1, 2)),
        ("E*x", SYMBOLS["E"] * x),
        ("x +\n\t y", x + y),
        ("0^0", sp.Integer(1)),
        ("x^0 - tanh(13.82)", 1 - sp.tanh(sp.Rational(691, 50))),
    ],
)
def test_the_grammar_reads_as_mathematics_does(text, expected):
    assert parse(text) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("empty", "Write 0")),
        ("2x", ("no operator between '2' and 'x'", "character 2", "2*x")),
        ("x(y + 1)", ("no operator between 'x' and '('",)),
        ("(x)(y)", ("no operator between ')' and '('",)),
        ("1.2.3", ("no operator",)),
        ("x +", ("ends too early", "Complete")),
        ("(x", ("not closed", "character 1")),
        ("max(x", ("not closed",)),
        ("x)", ("never opened",)),
        ("x, y", ("','",)),
        ("x * / y", ("'/' stands where a value belongs",)),
        ("sin", ("sin is a function", "sin(x)")),
        ("sin x", ("sin is a function",)),
        ("min(x)", ("min takes 2 arguments and got 1",)),
        ("sin(x, y)", ("sin takes 1 argument and got 2",)),
        ("sinn(x)", ("no function", 'Did you mean "sin"')),
        (
            "velocity + sin(t)",
            ('"t" is not declared', "character 16", 'a state of rate 1, such as clock = "1"'),
        ),
        ("velocty", ('"velocty" is not declared', "character 1", 'Did you mean "velocity"')),
        ("e*x", ("exp(1)",)),
        ("x / 0", ("divides by zero", "character 3")),
        ("x / (1 - 1)", ("divides by zero",)),
        ("0^-1", ("not positive",)),
        ("0^x", ("not positive",)),
        ("log(0)", ("not real and finite",)),
        ("sqrt(-1)", ("'sqrt' is not real",)),
        ("(-8)^(1/3)", ("not a real number",)),
        ("acos(2)", ("not a real number",)),
        ("tan(pi/2)", ("not real and finite",)),
        ("x.real", ("'.' means nothing", "character 2")),
        ("x[0]", ("'[' means nothing",)),
        ("'x'", ('"\'" means nothing',)),
        ("x; y", ("';' means nothing",)),
        ("\u03b5", ("means nothing",)),
        ("\u0661", ("means nothing",)),
    ],
)
def test_a_slip_is_named_with_its_place_and_its_remedy(text, words):
    with pytest.raises(ModelFileError) as caught:
        parse(text)
    for word in words:
        assert word in str(caught.value)


def test_a_name_where_nothing_is_declared_asks_for_a_number():
    """As of --set k=nan, where a parameter that is declared would not help."""
    with pytest.raises(ModelFileError, match=r'"nan" is not declared.*Give a number'):
        parse_expression("nan", symbols={})


def test_the_offending_place_is_marked_by_a_caret():
    with pytest.raises(ModelFileError) as caught:
        parse("x*\tq + 1")
    assert str(caught.value).splitlines()[1:] == ["    x* q + 1", "       ^"]


REPEATED = {
    "nested tanh": "tanh(#/(1 + tanh(#/(1 + tanh(#/(1 + tanh(#*x)))))))",
    "wide tanh": "tanh(#/(1 + tanh(#/(1 + #*x))))",
    "wide cosh": "cosh(#/(1 + cosh(#/(1 + #*x))))",
    "roots": "sqrt(#/(1 + sqrt(#/(1 + #*x))))",
    "denominators": "1/#7^90",
    "exponents": "1/#e250",
}
HOSTILE = {
    "import": "__import__('os').system('touch /tmp/owned')",
    "call by name": "__import__(x)",
    "attribute": "x.__class__.__mro__",
    "lambda": "(lambda: 0)()",
    "power tower": "9**9**9**9",
    "nested powers": "((((x^9)^9)^9)^9)",
    "large exponent": "1e999999999",
    "many digits": "9" * 9000,
    "minus signs": "-" * 50_000 + "x",
    "allowed minus signs": "-" * 9000 + "x",
    "megabyte of parentheses": "(" * 1_000_000,
    "parentheses": "(" * 4000 + "x" + ")" * 900,
    "power chain": "x" + "^x" * 2000,
    "hidden power of two": "exp(log(2)*10^9 + x)",
    "hidden power": "exp(10^9*log(x))",
    "hidden power by quotient": "2^(10^9*log(x)/log(2))",
    "root and power": "(2^(1/2))^(10^9)",
    "exponential tower": "exp(exp(exp(100)))",
    "exponential tower behind abs": "abs(exp(exp(exp(100))) - 1)",
    "constants that cancel": "abs(sqrt(2) + sqrt(3) - sqrt(5 + 2*sqrt(6)))",
    "extrema": "max(" * 90 + "x" + ", y)" * 90,
    "hyperbolic nest": "tanh(" * 90 + "x" + ")" * 90,
    "long product": "*".join(["(x + y)"] * 400),
    "large product": "*".join(["9^999"] * 1200),
    **{key: "+".join(part.replace("#", str(i)) for i in range(1, 180)) for key, part in REPEATED.items()},
}


def test_a_call_counts_once_for_itself_and_once_for_each_that_is_nested_in_it() -> None:
    # sqrt(1 + cos(..)) weighs 1 + 3 (1 + 1) = 7, and 120 are allowed.
    def text(count: int) -> str:
        return " + ".join(f"sqrt(1 + cos({k + 1}*x))" for k in range(count))

    x = sp.Symbol("x")
    assert parse_expression(text(17), symbols={"x": x}).has(sp.cos(17 * x))
    with pytest.raises(ModelFileError, match="more than 120 functions"):
        parse_expression(text(18), symbols={"x": x})


def test_a_call_that_stands_in_many_places_counts_once() -> None:
    """It is built once, as the intermediate values of an exported reduction are that its other lines are made of."""
    x = sp.Symbol("x")
    told = parse_expression(" + ".join(f"x^{k}*sqrt(1 + cos(x))" for k in range(1, 60)), symbols={"x": x})
    assert told.xreplace({x: sp.S.Zero}) == 0
    extrema = parse_expression(" + ".join(f"x^{k}*max(x, 1)" for k in range(1, 60)), symbols={"x": x})
    assert extrema.atoms(sp.Max) == {sp.Max(1, x)}


@pytest.mark.parametrize("key", sampled(HOSTILE, always=set(HOSTILE) - {"wide cosh", "wide tanh", "roots"}))
def test_hostile_text_is_refused_at_once(key):
    # Unguarded, these take minutes or the memory of the machine.
    with calls_within(MOST_CALLS), pytest.raises(ModelFileError):
        parse(HOSTILE[key])


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "text",
    [
        "+".join(f"tanh({i}/(1 + tanh({i}/(1 + {i}*x))))" for i in range(1, 9)),
        "+".join(f"cosh({i}/(1 + cosh({i}/(1 + {i}*x))))" for i in range(1, 6)),
        "+".join(f"sqrt({i}/(1 + sqrt({i}/(1 + {i}*x))))" for i in range(1, 9)),
        "*".join(f"sqrt({10**49 + i})" for i in range(16)),
        "+".join(f"tanh({i}/(1 + {i}*x))" for i in range(1, 41)),
        "(" * 99 + "x" + ")" * 99,
        "1/(1 + " * 50 + "x" + ")" * 50,
        "+".join(f"{i}*x*y^{i % 9}*z" for i in range(1, 400)),
    ],
    ids=lambda text: text[:16],
)
def test_the_largest_text_that_is_allowed_is_read_quickly(text):
    with calls_within(MOST_CALLS):
        assert isinstance(parse(text), sp.Expr)


@pytest.mark.exhaustive
@given(
    st.lists(
        st.sampled_from([*"xyz012.e+-*/^(),", "**", " ", "sin(", "log(", "sqrt(", "max(", "pi"]), max_size=25
    )
)
@settings(max_examples=400)
def test_random_near_misses_raise_nothing_but_our_own_error(pieces):
    with contextlib.suppress(ModelFileError):
        assert isinstance(parse("".join(pieces)), sp.Expr)


def _join(operator):
    symbol, build = operator
    return lambda pair: (f"({pair[0][0]}){symbol}({pair[1][0]})", build(pair[0][1], pair[1][1]))


def _apply(name):
    return lambda inner: (f"{name}({inner[0]})", expressions.FUNCTIONS[name][1](inner[1]))


LEAVES = st.one_of(
    st.sampled_from([(name, SYMBOLS[name]) for name in "xyz"]),
    st.decimals(0, 99, places=2).map(lambda number: (str(number), sp.Rational(str(number)))),
)
BINARY = [
    ("+", lambda a, b: a + b),
    (" - ", lambda a, b: a - b),
    ("*", lambda a, b: a * b),
]
TREES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        *(st.tuples(inner, inner).map(_join(operator)) for operator in BINARY),
        inner.map(lambda tree: (f"-({tree[0]})", -tree[1])),
        st.tuples(inner, st.integers(0, 3)).map(
            lambda pair: (f"({pair[0][0]})^{pair[1]}", pair[0][1] ** pair[1])
        ),
        st.sampled_from("xyz").flatmap(
            lambda name: inner.map(
                lambda tree: (f"({tree[0]})/(1 + {name}^2)", tree[1] / (1 + SYMBOLS[name] ** 2))
            )
        ),
        st.sampled_from(["sin", "cos", "atan", "exp", "tanh"]).flatmap(lambda name: LEAVES.map(_apply(name))),
    ),
    max_leaves=8,
)


@pytest.mark.exhaustive
@given(TREES)
@settings(max_examples=200)
def test_a_printed_tree_is_read_back_as_itself(tree):
    text, expected = tree
    found = parse(text)
    assert found == expected or sp.expand(found - expected) == 0


# Files


def test_a_file_in_standard_form_equals_the_named_scene(tmp_path):
    scene = load(write(tmp_path, MICHAELIS_MENTEN))
    assert scene.system == models.load("michaelis_menten").system
    assert scene.title == "An enzyme & its <substrate>"
    assert scene.region == {"s": (0.1, 2.0)}
    assert scene.epsilons == (0.02, 0.01, 0.005, 0.0025)
    assert scene.tolerance == 1e-6
    assert gsp.load(str(tmp_path / "model.toml")) == scene


def test_a_file_with_poles_and_reconstruction_equals_the_named_scene(tmp_path):
    scene, named = load(write(tmp_path, SLEIGH)), models.load("chaplygin_sleigh")
    assert scene.system == named.system
    assert scene.full_flow == named.full_flow
    assert scene.full_start == named.full_start
    for attribute in ("region", "start", "span", "epsilon", "epsilons", "tolerance", "path"):
        assert getattr(scene, attribute) == getattr(named, attribute)


def test_the_name_defaults_to_the_files_and_is_a_plain_word(tmp_path):
    text = MICHAELIS_MENTEN.replace('name = "michaelis_menten"', "")
    assert load(write(tmp_path, text, "my model (2).toml")).name == "my_model_2"


def test_windows_files_with_a_byte_order_mark_are_read(tmp_path):
    path = tmp_path / "model.toml"
    path.write_bytes(b"\xef\xbb\xbf" + MICHAELIS_MENTEN.replace("\n", "\r\n").encode())
    assert load(path).name == "michaelis_menten"


def test_another_epsilon_and_observables_can_be_declared(tmp_path):
    text = (
        'epsilon = "mu"\n'
        + SLEIGH.replace("*epsilon)", "*mu)")
        + '\n[observables]\nspeed = "sqrt(v^2 + w^2)"\n'
    )
    system = load(write(tmp_path, text)).system
    assert isinstance(system, VectorField)
    assert system.epsilon == sp.Symbol("mu")
    w = sp.Symbol("w")
    assert system.observables == {sp.Symbol("speed"): sp.sqrt(v**2 + w**2)}


def test_numbers_of_a_file_stay_exact(tmp_path):
    text = MICHAELIS_MENTEN.replace("kappa = 1", "kappa = 0.1").replace("0.5\n\n[slow]", "-1_0.25e-1\n\n[slow]")
    values = {symbol.name: value for symbol, value in load(write(tmp_path, text)).system.parameters.items()}
    assert values == {"kappa": sp.Rational(1, 10), "lambda": sp.Rational(-41, 40)}


CHANGES = {
    "malformed": ("[slow]", "[slow", ("not valid TOML", "line")),
    "key twice": ("kappa = 1", "kappa = 1\nkappa = 2", ("not valid TOML",)),
    "unknown table": ("[region]", "[regions]", ("regions is unknown", 'Did you mean "region"')),
    "unknown key": ("span =", "spam =", ("scene.spam is unknown", 'Did you mean "span"')),
    "table of the top": (
        "span =",
        "start = {x = 1}\nspan =",
        ("scene.start is unknown", "write [start] on a line"),
    ),
    "key of the top": ("span =", "title =", ("scene.title is unknown", "It belongs above the first table")),
    "key of another table": ("[parameters]", "span = [0, 5]\n[parameters]", ("span is unknown", "scene.span")),
    "value of epsilon at the top": (
        "[parameters]",
        "epsilon = 0.1\n[parameters]",
        ("names the symbol", "[scene]"),
    ),
    "no span": ("span = [0, 5]", "", ("scene.span is missing", "span = [0, 5]")),
    "epsilon by a parameter's name": (
        "epsilon = 0.01",
        'epsilon = "kappa"',
        ("scene.epsilon is a number", 'epsilon = "kappa" at the top'),
    ),
    "no epsilon": ("epsilon = 0.01", "", ("scene.epsilon is missing",)),
    "neither": (
        "span = [0, 5]\nepsilon = 0.01",
        "",
        ("scene.span and scene.epsilon are missing", "Write span = [0, 5] and epsilon = 0.01 under [scene]"),
    ),
    "no region": ("s = [0.1, 2]", "", ("region bounds no state",)),
    "no start": ("c = 0.5", "", ("no value for c",)),
    "no fast": ('c = "s - (s + kappa)*c"', "", ("[fast] is missing or empty",)),
    "both forms": ("[slow]", '[states]\nq = "-q"\n[slow]', ("both", "Keep one")),
    "no equations": (MICHAELIS_MENTEN, "[scene]\nspan = [0, 1]", ("neither", "Write one", "[slow] and [fast]")),
    "equations in a table of another name": (
        MICHAELIS_MENTEN,
        '[equations]\nx = "-x"\n[scene]\nspan = [0, 1]',
        ("neither, but [equations], [scene]", "[slow] and [fast], or [states]"),
    ),
    "a name with a dot": ("kappa = 1", "k.on = 1\nkappa = 1", ("parameters.k", "a table", "one plain word")),
    "table that is a value": (
        "[parameters]",
        "observables = 3\n[parameters]",
        ("observables is a table", "number"),
    ),
    "list as a rate": ('s = "-s + (s', 's = ["s"]\nz = "(s', ("slow.s is a number, or text", "list")),
    "boolean": ("kappa = 1", "kappa = true", ("parameters.kappa", "boolean")),
    "nan": ("kappa = 1", "kappa = nan", ("parameters.kappa", "finite")),
    "inf": ("c = 0.5", "c = -inf", ("start.c", "finite")),
    "nan in region": ("[0.1, 2]", "[0.1, nan]", ("region.s", "finite")),
    "irrational parameter": ("kappa = 1", 'kappa = "pi"', ("kappa", "pi")),
    "large number": ("kappa = 1", "kappa = 1e999999999", ("parameters.kappa", "exponent")),
    "huge number": ("kappa = 1", "kappa = 1e9999999999999999999999", ("not valid TOML",)),
    "long integer": ("kappa = 1", "kappa = " + "1" * 5000, ("not valid TOML",)),
    "long hexadecimal": ("kappa = 1", "kappa = 0x" + "f" * 9000, ("parameters.kappa",)),
    "date": ("kappa = 1", "kappa = 2020-01-01", ("parameters.kappa", "date")),
    "title that is a number": (
        'title = "An enzyme & its <substrate>"',
        "title = 3",
        ("title is text", "number"),
    ),
    "long title": ("An enzyme", "An enzyme" * 99, ("title has", "200")),
    "path as a name": ('name = "michaelis_menten"', 'name = "../../etc/passwd"', ("plain word",)),
    "one number": ("[0.1, 2]", "[2]", ("region.s is a pair", "1")),
    "undeclared name": ("(s + kappa)*c", "(s + kapa)*c", ("fast.c", '"kapa"', 'Did you mean "kappa"')),
    "code": ("s - (s + kappa)*c", "__import__('os').system('id')", ("fast.c", "means nothing")),
    "code as a name": ('c = "s -', '"__import__(\'os\')" = "s -', ("plain word",)),
    "reserved name": ("kappa = 1", "kappa = 1\nexp = 1", ("parameters.exp", "grammar")),
    "name used twice": ("kappa = 1", "kappa = 1\ns = 1", ("slow.s", "parameters", "Keep one")),
    "long name": ("kappa = 1", "k" * 65 + " = 1\nkappa = 1", ("plain word", "64")),
    "many parameters": (
        "kappa = 1",
        "kappa = 1\n" + "\n".join(f"p{i} = 1" for i in range(2000)),
        ("2002", "2000"),
    ),
    "many states": ("[fast]", "[fast]\n" + "\n".join(f"p{i} = 1" for i in range(2000)), ("2002", "2000")),
    "feedback": (
        "[slow]",
        '[reconstruction]\nphi = "s"\n[slow]\nq = "phi"',
        ("slow.q depends on phi", "reconstruction variable"),
    ),
    "misplaced epsilon": ("(s + kappa)*c", "(s + kappa)*c*exp(epsilon)", ("no pole or power",)),
    "pole in the fast rates": ("(s + kappa)*c", "(s + kappa)*c/epsilon", ("pole of order 1",)),
    "path of one": ("epsilon = 0.01", 'epsilon = 0.01\npath = ["s"]', ("scene.path", "pair")),
    "ladder that is a number": (
        "epsilon = 0.01",
        "epsilon = 0.01\nepsilons = 0.1",
        ("scene.epsilons is a list",),
    ),
}


@pytest.mark.parametrize("key", CHANGES)
def test_a_wrong_file_is_refused_with_its_name_the_key_and_the_remedy(key, tmp_path):
    old, new, words = CHANGES[key]
    assert old in MICHAELIS_MENTEN
    path = write(tmp_path, MICHAELIS_MENTEN.replace(old, new, 1))
    with pytest.raises(ModelFileError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith("model.toml: ")
    for word in words:
        assert word in message


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    cases = {
        "missing.toml": ("no such file", "missing.toml"),
        "folder.toml": ("no regular file",),
        "pipe.toml": ("no regular file",),
        "latin.toml": ("not UTF-8", "line 2"),
        "large.toml": ("larger than 256 KiB",),
        "zero\0.toml": ("cannot be read",),
    }
    (tmp_path / "folder.toml").mkdir()
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "latin.toml").write_bytes(b"\ntitle = '\xe9'")
    (tmp_path / "large.toml").write_bytes(b"#" * 300_000)
    for name, words in cases.items():
        with pytest.raises(ModelFileError) as caught:
            load(tmp_path / name)
        for word in words:
            assert word in str(caught.value)


BOMBS = {
    "deep arrays": "a = " + "[" * 100_000,
    "deep tables": "a = " + "{a = " * 40_000,
    "dotted key": "a." * 120_000 + "a = 1",
    "dotted header": "[" + "a." * 120_000 + "a]",
    "dotted key in a table": 'a = {b = "", ' + "a." * 120_000 + "a = 1}",
    "dotted key without value": "a." * 120_000,
    "dotted key behind a string": 'a = {b = "", c = "x.y",' + "a." * 120_000 + 'a = "1"}',
    "dotted key behind lines": 'a = ["""\n""", {' + "a." * 120_000 + 'a = "1"}]',
    "dotted key behind other lines": "a = ['''\n''', {" + "a." * 120_000 + "a = '1'}]",
    "dotted key of strings": '"a".' * 60_000 + '"a" = 1',
    "many dotted keys": "\n".join("a." * 40 + f"b{i} = 1" for i in range(2900)),
    "header and keys": "[" + "a." * 39 + "a]\n" + "\n".join(f"b{i}=1" for i in range(28_000)),
    "parentheses": MICHAELIS_MENTEN.replace("(s + kappa)*c", "(" * 200_000),
    "minus signs": MICHAELIS_MENTEN.replace("(s + kappa)*c", "-" * 50_000 + "s"),
    "many arrays": "a = [" + "[]," * 80_000 + "]",
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("key", BOMBS)
def test_a_file_made_to_exhaust_the_reader_is_refused_at_once(key, tmp_path):
    path = write(tmp_path, BOMBS[key])
    # Unguarded, these take minutes or the memory of the machine.
    with calls_within(MOST_CALLS), pytest.raises(ModelFileError):
        load(path)


def test_decimals_and_dots_of_comments_are_no_dotted_key(tmp_path: Path) -> None:
    rate = " + ".join(f"0.{k + 1}*s" for k in range(60))
    text = MICHAELIS_MENTEN.replace("(s + kappa)*c", f"({rate})*c")
    assert text != MICHAELIS_MENTEN
    scene = load(write(tmp_path, "# " + "." * 70 + "\n" + text))
    s, c = sp.symbols("s c")
    total = sum(sp.Rational(f"0.{k + 1}") for k in range(60))
    assert scene.system.fast[c].coeff(s, 1).coeff(c, 1) == -total


def test_dots_are_counted_in_keys_only_and_in_all_of_them() -> None:
    assert len(parsed("a = [" + ", ".join(["0.5"] * 50) + "]")["a"]) == 50
    assert parsed("a = '" + "." * 50 + "'\nb = \"" + "." * 50 + '"  # ' + "." * 50)["a"] == "." * 50
    # What looks like a string in the second line of each stands between two strings.
    for quote in ('"', "'"):
        with pytest.raises(ModelFileError, match="line 2 has more than 40 dots in a row of words"):
            parsed(f"a = {{b = {3 * quote}x\n{3 * quote}, {'c.' * 50}c = {quote}y{quote}}}")


@pytest.mark.parametrize("before", [0, 5, 39, 40, 41, 200])
@pytest.mark.parametrize("behind", [0, 100])
def test_the_caret_stands_under_the_place(before: int, behind: int) -> None:
    text = "x+" * (before // 2) + " " * (before % 2) + "?" + "+x" * (behind // 2)
    with pytest.raises(ModelFileError, match=f"at character {before + 1}") as caught:
        parse(text)
    *_, excerpt, caret = str(caught.value).splitlines()
    assert excerpt[caret.index("^")] == "?"
    assert excerpt.count("?") == caret.count("^") == 1
    assert len(excerpt) < 80


@given(st.text(max_size=80))
@settings(max_examples=60)
def test_random_files_raise_nothing_but_our_own_error(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "random.toml"
    path.write_text(text, encoding="utf-8", errors="replace")
    with pytest.raises(ModelFileError):
        load(path)


def test_a_missing_file_is_named_once() -> None:
    with pytest.raises(ModelFileError) as caught:
        load("nofile.toml")
    assert str(caught.value).count("nofile.toml") == 1


@pytest.mark.parametrize("error", [ArithmeticError, AttributeError, NotImplementedError, TypeError, ValueError])
def test_what_sympy_raises_on_the_way_is_a_refusal_with_its_place(monkeypatch, error) -> None:
    # SymPy's cache reads the message of every TypeError as text, and raises an AttributeError where it is none.
    def stumble(*arguments: sp.Expr) -> sp.Expr:
        raise error("stumbled")

    monkeypatch.setattr(expressions, "FUNCTIONS", {**expressions.FUNCTIONS, "sinh": (1, stumble)})
    with pytest.raises(ModelFileError, match=r"'sinh' cannot be worked out here.*at character 5"):
        parse_expression("x + sinh(x)", symbols={"x": sp.Symbol("x")})


@pytest.mark.parametrize("text", ["(2/7)^0.123457", "6.022e23^(1/3)", "1.38e-23^0.25", "2^0.123456789"])
def test_roots_of_numbers_are_read_whatever_their_order(text) -> None:
    base, exponent = text.split("^")
    value = float(parse_expression(base, symbols={})) ** float(parse_expression(exponent, symbols={}))
    assert float(parse_expression(text, symbols={})) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["6.022e23^0.333333333", "0.5^1e-300", "x*72^0.666667"])
def test_roots_that_sympy_would_write_out_by_huge_numbers_are_refused(text) -> None:
    with pytest.raises(ModelFileError, match="too many digits, at character"):
        parse_expression(text, symbols={"x": sp.Symbol("x")})
