"""Definitions of a model file: written out exactly, within the reader's bounds, and never over another name."""

from __future__ import annotations

from pathlib import Path

import pytest
import sympy as sp

import gsp
from gsp.errors import ModelFileError
from gsp.readers import expressions
from gsp.readers.definitions import read_definitions

MODEL = """
[parameters]
v1 = -1.2
v2 = 18
I = 0.5

[definitions]
{definitions}

[slow]
w = "{slow}"

[fast]
v = "{fast}"

[region]
w = [-1, 1]

[start]
w = 0
v = 0

[scene]
span = [0, 1]
epsilon = 0.01
"""


def read(folder: Path, definitions: str, *, slow: str = "v - w", fast: str = "I - v - w") -> gsp.Scene:
    path = folder / "model.toml"
    path.write_text(MODEL.format(definitions=definitions, slow=slow, fast=fast))
    return gsp.load(path)


def rates(scene: gsp.Scene) -> tuple[sp.Expr, sp.Expr]:
    assert isinstance(scene.system, gsp.SlowFastSystem)
    return next(iter(scene.system.slow.values())), next(iter(scene.system.fast.values()))


def test_definitions_are_written_out_where_they_are_used(tmp_path: Path) -> None:
    v, w, v1, v2, drive = sp.symbols("v w v1 v2 I")
    scene = read(
        tmp_path,
        '"minf(u)" = "0.5*(1 + tanh((u - shift)/v2))"\nshift = "v1 + 2*half"\nhalf = 0.5\n"mix(a, b)" = "a*b - b"',
        slow="mix(minf(v), w) - minf(w^2)",
        fast="I - v - mix(w, mix(v, 2))",
    )

    def gate(u: sp.Expr) -> sp.Expr:
        return (1 + sp.tanh((u - v1 - 1) / v2)) / 2

    slow, fast = rates(scene)
    assert sp.expand(slow - (gate(v) * w - w - gate(w**2))) == 0
    assert sp.expand(fast - (drive - v - (w * (2 * v - 2) - (2 * v - 2)))) == 0


def test_a_function_called_epsilon_is_no_small_parameter(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(
        '[definitions]\n"epsilon(u)" = "u^2"\n[states]\nx = "-epsilon(x)"\n[start]\nx = 1\n[scene]\nspan = [0, 1]'
    )
    system = gsp.load(path).system
    assert system.epsilon is None
    assert system.rates == (-(sp.Symbol("x") ** 2),)


def test_an_argument_is_its_own_function_s_alone(tmp_path: Path) -> None:
    slow, _ = rates(read(tmp_path, '"f(u)" = "u + g(2*u)"\n"g(u)" = "u^2"', slow="f(w) + v"))
    v, w = sp.symbols("v w")
    assert sp.expand(slow - (w + 4 * w**2 + v)) == 0


@pytest.mark.parametrize(
    ("definitions", "words"),
    [
        ('a = "b"\nb = "c + 1"\nc = "2*a"', "a -> b -> c -> a is a circle"),
        ('"f(u)" = "f(u - 1)"', "f -> f is a circle"),
        ('v = "2"', "v is a name of the model"),
        ('"f(v)" = "2*v"', "v is a name of the model"),
        ('"f(epsilon)" = "2"', "epsilon is a name of the model"),
        ('tanh = "2"', "tanh is a word of the grammar"),
        ('"f(exp)" = "2"', "exp is a word of the grammar"),
        ('ln = "2"', "ln is a word of the grammar"),
        ('"f(u)" = "u"\nf = "2"', "f is defined twice"),
        ('"f(g)" = "2*g"\ng = "1"', "g is defined too"),
        ('"f(u, u)" = "u"', "each once"),
        ('"f()" = "1"', "neither a name nor a function"),
        ('"f(u" = "1"', "neither a name nor a function"),
        ('"__class__" = "1"', "neither a name nor a function"),
        ('"f(u)" = "u + nobody"', 'definitions.f(u): the name "nobody" is not declared'),
        ('"f(u)" = "u +"', "definitions.f(u): the expression ends too early"),
        ('f = ["1"]', "definitions.f is a number, or text"),
        (f'"f({",".join(f"a{k}" for k in range(33))})" = "a0"', "at most 32 arguments"),
    ],
)
def test_what_no_definition_is_is_refused_by_name(tmp_path: Path, definitions: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        read(tmp_path, definitions)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("slow", "words"),
    [
        ("f(v, w) - w", "f is defined as f(u)"),
        ("f - w", "f is defined as f(u)"),
        ("k(v) - w", "k is defined as k"),
        ("f(v) - ff(w)", 'Did you mean "f"'),
        ("v - z(2)", "in z(u)"),
    ],
)
def test_a_definition_is_used_as_it_is_defined(tmp_path: Path, slow: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        read(tmp_path, '"f(u)" = "u^2"\nk = "3"\n"z(u)" = "1/(u - 2)"', slow=slow)
    assert words in str(caught.value)


def test_what_a_few_lines_could_grow_to_is_bounded(tmp_path: Path) -> None:
    doubling = '"f0(u)" = "1/(u + 1) + 1/(u + 2) + 1/(u + 3)"\n' + "\n".join(
        f'"f{k}(u)" = "f{k - 1}(f{k - 1}(u))"' for k in range(1, 6)
    )
    with pytest.raises(ModelFileError, match=f"more than {expressions.WRITTEN} symbols"):
        read(tmp_path, doubling, slow="f5(v)")
    chain = "\n".join(f'a{k} = "a{k + 1}"' for k in range(200)) + '\na200 = "1"'
    with pytest.raises(ModelFileError, match="nested more than"):
        read(tmp_path, chain, slow="a0*v")
    with pytest.raises(ModelFileError, match="too deep in each other"):
        read(tmp_path, '"t(u)" = "tanh(u)"', slow="t(t(t(t(t(v)))))")
    with pytest.raises(ModelFileError, match="total degree"):
        read(tmp_path, '"p(u)" = "u^9"', slow="p(p(p(v)))")
    with pytest.raises(ModelFileError, match="2000 are allowed"):
        read(tmp_path, "\n".join(f"a{k} = 1" for k in range(2001)))


def test_as_many_as_are_allowed_are_read() -> None:
    assert len(read_definitions({f"a{k}": "1" for k in range(2000)}, {})) == 2000
    arguments = [f"b{k}" for k in range(32)]
    (widest,) = read_definitions({f"f({', '.join(arguments)})": "b0 + b31"}, {}).values()
    assert widest.arguments == tuple(arguments)


@pytest.mark.exhaustive
def test_what_a_file_writes_out_in_all_is_bounded(tmp_path: Path) -> None:
    states = 1500
    big = " + ".join(f"u/{k}" for k in range(1, 150))
    text = (
        f'[definitions]\n"f(u)" = "{big}"\n[states]\n'
        + "".join(f'x{i} = "f(x{i}/epsilon)"\n' for i in range(states))
        + "[region]\nx0 = [0, 2]\n[start]\n"
        + "".join(f"x{i} = 1\n" for i in range(states))
        + "[scene]\nspan = [0, 1]\nepsilon = 0.01\n"
    )
    path = tmp_path / "wide.toml"
    path.write_text(text)
    with pytest.raises(ModelFileError, match=f"more than {expressions.ALL_WRITTEN} symbols"):
        gsp.load(path)


@pytest.mark.exhaustive
def test_a_network_of_two_thousand_states_is_read(tmp_path: Path) -> None:
    n = 2000
    text = (
        '[definitions]\n"flow(u, w)" = "a*(u - w)"\n[parameters]\na = 1\n[states]\n'
        + "".join(f'x{i} = "flow(x{i - 1}, x{i})"\n' for i in range(1, n))
        + 'x0 = "-x0/epsilon"\n[region]\nx0 = [0, 2]\n[start]\n'
        + "".join(f"x{i} = 1\n" for i in range(n))
        + "[scene]\nspan = [0, 1]\nepsilon = 0.01\n"
    )
    path = tmp_path / "network.toml"
    path.write_text(text)
    scene = gsp.load(path)
    assert len(scene.system.states) == n
    a, left, own = sp.symbols("a x6 x7")
    assert sp.expand(scene.system.rates[6] - a * (left - own)) == 0
    path.write_text(text.replace("[region]", 'extra = "1"\n[region]'))
    with pytest.raises(ModelFileError, match="2000 are allowed"):
        gsp.load(path)
