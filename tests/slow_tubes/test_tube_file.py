"""Proof files of slow manifolds: what was proved is accepted, and no file changed to say more or another thing."""

import copy
import json
import random
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import pytest
import sympy as sp
from click.testing import CliRunner

from gsp.cli import cli
from gsp.errors import GspError
from gsp.proofs.checked_tube import CheckedTube
from gsp.proofs.programs import IntervalProgram, Rejected
from gsp.proofs.rational_functions import RationalFunctions
from gsp.proofs.verification import verify
from gsp.slow_tubes.certify import certify
from tests.cases import sampled
from tests.proof_files import changed, counted_products, number, written
from tests.slow_tubes.test_slow_tube import (
    HALF_LINE,
    a,
    epsilon,
    michaelis_menten,
    s,
    saddle,
    series,
    sleigh,
    x,
    y,
)


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> dict:
    found = certify(michaelis_menten(1), region=HALF_LINE, epsilon=0.1)
    return written(found, tmp_path_factory.mktemp("tube") / "p.json")


@pytest.fixture(scope="module")
def saddle_proof(tmp_path_factory: pytest.TempPathFactory) -> dict:
    found = certify(saddle(1), region={"s": (-1, 1)}, epsilon=0.1)
    return written(found, tmp_path_factory.mktemp("tube") / "p.json")


def checked(proof: dict, path: Path) -> CheckedTube:
    path.write_text(json.dumps(proof), encoding="utf-8")
    found = verify(path)
    assert isinstance(found, CheckedTube)
    return found


def rejected(proof: dict, path: Path) -> str:
    with pytest.raises(Rejected) as caught:
        checked(proof, path)
    return str(caught.value)


CASES = {
    "sleigh": (lambda: sleigh(2), {"v": (-2, 2), "p": (-2, 2)}, 0.1),
    "saddle": (lambda: saddle(2), {"s": (-1, 1)}, None),
    "pair": (lambda: series({s: -s + x * y / 4}, {x: -x - 8 * y + s, y: x - y}, 1), {"s": (-1, 1)}, 0.01),
    "parameter": (
        lambda: series({x: 1 - x}, {y: -a * y + x}, 2, parameters={a: 1}),
        {"x": (0, 1), "a": (1, 2)},
        0.05,
    ),
    "overflowing": (lambda: series({x: x}, {y: -y + x**2}, 1), {"x": (-1, 1)}, 0.05),
    "largest epsilon": (lambda: michaelis_menten(2), HALF_LINE, None),
}


@pytest.mark.parametrize("name", sampled(CASES, always=set(CASES) - {"largest epsilon", "sleigh"}))
def test_what_was_proved_is_accepted(name: str, tmp_path: Path) -> None:
    make, region, value = CASES[name]
    tube = certify(make(), region=region, epsilon=value)
    tube.save(tmp_path / "p.json")
    found = verify(tmp_path / "p.json")
    assert isinstance(found, CheckedTube)
    assert 0.89 * tube.epsilon_0 <= found.epsilon <= tube.epsilon_0
    power = tube.epsilon_0 ** (tube.series.order + 1)
    for name_, reach in zip(found.fast, found.reach):
        assert tube.widths[name_] * (1 - 1e-9) <= reach * power <= 1.3 * tube.widths[name_]
    assert found.stable == sum(len(b) for b, sign in zip(tube._proof.basis.blocks, tube.signs) if sign < 0)
    assert found.boundary == tube.boundary
    assert found.unique is tube.is_unique
    assert (found.collar == 0.0) is found.unique
    assert tube.collar <= found.collar <= 2 * tube.collar
    small = f"{found.small}^{tube.series.order + 1} on the graph"
    assert str(found).count(small) == len(found.fast)
    assert found.boxes < 6000


def of_text(key: str, place: int, old: str, new: str) -> Callable[[dict], None]:
    def mutate(proof: dict) -> None:
        assert old in proof[key][place]
        proof[key][place] = proof[key][place].replace(old, new, 1)

    return mutate


def number_at(key: str, change: Callable[[float], float], place: int | None = None) -> Callable[[dict], None]:
    def mutate(proof: dict) -> None:
        if place is None:
            proof[key] = number(proof[key], change)
        else:
            proof[key][place] = number(proof[key][place], change)

    return mutate


def of_cone(key: str, value: object) -> Callable[[dict], None]:
    return lambda proof: proof["cones"][0].update(
        {key: value(proof["cones"][0][key]) if callable(value) else value}
    )


MUTATIONS: dict[str, Callable[[dict], object]] = {
    "a coefficient of the slow field": of_text("rates", 0, "1/2", "1/3"),
    "a sign of the slow field": of_text("rates", 0, "-z0", "z0"),
    "a coefficient of the fast field": of_text("equations", 0, "z0 + 1", "z0 + 2"),
    "another fast field": changed(["equations", 0], "z0 - z1"),
    "a fast field in epsilon": of_text("equations", 0, "z0", "z0*(1 + z2**3)"),
    "a field with a pole": changed(["equations", 0], lambda t: t + " + 0/(z1 - z1)"),
    "no field": changed(["equations"], []),
    "code as a field": changed(["rates", 0], "__import__('os').getcwd()"),
    "a function in a field": changed(["rates", 0], lambda t: t + " + exp(z0) - exp(z0)"),
    "an unknown variable": changed(["rates", 0], "z9"),
    "a decimal": changed(["rates", 0], "0.5*z0"),
    "a digit of h_0": changed(["series", 0, 0], lambda t: t.replace("+ 1", "+ 2")),
    "a digit of h_1": changed(["series", 1, 0], lambda t: t.replace("2", "3", 1)),
    "a small change of h_1": changed(["series", 1, 0], lambda t: t + " + 1/10**12"),
    "a term left out": lambda proof: proof["series"].pop(),
    "a term more": lambda proof: proof["series"].append(["0"]),
    "no series": changed(["series"], []),
    "a term in the fast variable": changed(["series", 1, 0], lambda t: t + " + z1"),
    "brackets in a term": changed(["series", 1, 0], "0) + (z1"),
    "a digit of the remainder": of_text("remainder", 0, "z1", "2*z1"),
    "a small change of the remainder": changed(["remainder", 0], lambda t: t + " + 1/10**15"),
    "a remainder of zero": changed(["remainder", 0], "0"),
    "a steeper remainder": changed(["remainder", 0], lambda t: f"2*({t})"),
    "a basis of zero": changed(["basis", 0], "0"),
    "another basis": changed(["basis", 0], "2"),
    "a basis that turns singular": changed(["basis", 0], "z0 - 1"),
    "a region across the pole": changed(["region", 0], [(-2.0).hex(), (5.0).hex()]),
    "a reversed region": changed(["region", 0], lambda side: side[::-1]),
    "no region": changed(["region"], []),
    "an unbounded region": changed(["region", 0], ["-inf", "inf"]),
    "a larger epsilon": number_at("epsilon", lambda v: 2 * v),
    "a larger epsilon with its cones": lambda proof: (
        proof.update(epsilon=(2.0).hex()), proof["cones"][0].update(high=(2.0).hex())
    ),
    "a negative epsilon": number_at("epsilon", lambda v: -v),
    "an epsilon that is no number": changed(["epsilon"], "nan"),
    "blocks of nothing": changed(["blocks"], [[]]),
    "a direction twice": changed(["blocks"], [[0], [0]]),
    "no blocks": changed(["blocks"], []),
    "unstable for stable": changed(["signs"], [1]),
    "a sign that is none": changed(["signs"], [0]),
    "a tube too thin": number_at("widths", lambda v: 0.5 * v, 0),
    "a tube a little too thin": number_at("widths", lambda v: 0.97 * v, 0),
    "a tube of no width": number_at("widths", lambda v: 0.0, 0),
    "a negative width": number_at("widths", lambda v: -v, 0),
    "a tube far too wide": number_at("widths", lambda v: 1e8 * v, 0),
    "a reach that is smaller": number_at("reach", lambda v: 0.999 * v, 0),
    "a reach of zero": number_at("reach", lambda v: 0.0, 0),
    "called unique": changed(["unique"], True),
    "called unique without a collar": lambda proof: proof.update(unique=True, collar=(0.0).hex()),
    "called unique as a number": changed(["unique"], 0),
    "called overflowing": changed(["boundary"], "overflowing"),
    "called overflowing and unique": lambda proof: proof.update(
        unique=True, boundary="overflowing", collar=(0.0).hex()
    ),
    "called inflowing and unique": lambda proof: proof.update(
        unique=True, boundary="inflowing", collar=(0.0).hex()
    ),
    "called inflowing": changed(["boundary"], "inflowing"),
    "called something": changed(["boundary"], "unique"),
    "a collar too narrow": number_at("collar", lambda v: 0.8 * v),
    "no collar": changed(["collar"], (0.0).hex()),
    "a negative collar": number_at("collar", lambda v: -v),
    "a collar over the whole region": changed(["collar"], (2.5).hex()),
    "a collar beyond the region": changed(["collar"], (1e308).hex()),
    "a collar of no number": changed(["collar"], "inf"),
    "no cones": changed(["cones"], []),
    "cones that begin late": of_cone("low", (1e-9).hex()),
    "cones that end early": of_cone("high", (0.05).hex()),
    "cones of no slope": of_cone("slope", (0.0).hex()),
    "cones much too flat": of_cone("slope", (1e-9).hex()),
    "cones much too steep": of_cone("slope", (1e12).hex()),
    "cones without a collar": of_cone("collar", (0.0).hex()),
    "a steeper collar": of_cone("collar", (1e6).hex()),
    "names that are no list": changed(["fast"], "c"),
    "a parameter more": changed(["parameters"], ["k"]),
}  # fmt: skip


# What the checker refuses by its last conditions, after a second of work.
LATE = {
    "a larger epsilon with its cones", "a tube a little too thin", "a steeper collar",
    "cones much too flat", "cones much too steep",
}  # fmt: skip


@pytest.mark.parametrize("name", sampled(MUTATIONS, always=set(MUTATIONS) - LATE))
def test_a_changed_proof_is_rejected(name: str, proof: dict, tmp_path: Path) -> None:
    mutant = copy.deepcopy(proof)
    MUTATIONS[name](mutant)
    assert json.dumps(mutant) != json.dumps(proof)
    assert rejected(mutant, tmp_path / "p.json")


@pytest.mark.parametrize(
    "mutate",
    [
        changed(["signs"], [-1, -1]),
        changed(["signs"], [1, 1]),
        lambda proof: proof["signs"].reverse(),
        lambda proof: proof["widths"].reverse(),
        lambda proof: proof["basis"].reverse(),
        changed(["blocks"], [[0, 1]]),
        changed(["remainder"], lambda rows: rows[::-1]),
    ],
)
def test_a_saddle_is_not_taken_for_something_else(
    mutate: Callable[[dict], object], saddle_proof: dict, tmp_path: Path
) -> None:
    assert checked(saddle_proof, tmp_path / "p.json").unstable == 1
    mutant = copy.deepcopy(saddle_proof)
    mutate(mutant)
    assert mutant != saddle_proof
    assert rejected(mutant, tmp_path / "p.json")


def test_what_claims_less_is_accepted(proof: dict, tmp_path: Path) -> None:
    less = copy.deepcopy(proof)
    less["epsilon"] = less["cones"][0]["high"] = (0.0625).hex()
    less["reach"] = [number(less["reach"][0], lambda v: 2 * v)]
    less["region"] = [[(1.0).hex(), (2.0).hex()]]
    assert checked(less, tmp_path / "p.json").epsilon == 0.0625


@pytest.mark.parametrize(("rate", "value"), [(1, 1.1), (3, 0.4)])
def test_cones_beyond_the_crossing_of_rates_are_rejected(rate: int, value: float, tmp_path: Path) -> None:
    # x' = -rate x, epsilon y' = -y + x: beyond epsilon = 1/rate no map that is Lipschitz attracts.
    manifold = series({x: -rate * x}, {y: -y + x}, 2)
    proof = written(certify(manifold, region={"x": (-1, 1)}, epsilon=0.1 / rate), tmp_path / "p.json")
    assert checked(proof, tmp_path / "p.json").boundary == "inflowing"
    for slope in (0.01, 1.0, 100.0, 1e6):
        proof["epsilon"] = proof["cones"][0]["high"] = value.hex()
        proof["cones"][0]["slope"] = slope.hex()
        proof["cones"][0]["collar"] = (1e-9).hex()
        assert "cones" in rejected(proof, tmp_path / "p.json")


def test_attraction_that_is_lost_before_epsilon_is_rejected(tmp_path: Path) -> None:
    manifold = series({x: sp.Integer(1)}, {y: -(1 - 4 * epsilon) * y + x}, 2)
    proof = written(certify(manifold, region={"x": (0, 1)}, epsilon=0.05), tmp_path / "p.json")
    proof["epsilon"] = proof["cones"][0]["high"] = (0.26).hex()
    proof["widths"] = [(1e6).hex()]
    proof["reach"] = [(2e6).hex()]
    assert "face" in rejected(proof, tmp_path / "p.json")


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        pytest.param("(z0 + z1 + z2 + 1)**40*(z0 - z1 + 1)**40 + z0", "products", marks=pytest.mark.exhaustive),
        ("(((9999999999**999)**999)**999)", "bits"),
        ("(" * 5000 + "z0" + ")" * 5000, "nested"),
        ("z0**99999", "exponent"),
        ("sin(z0)", "rational"),
    ],
)
def test_huge_expressions_are_refused_by_name(expression: str, words: str, proof: dict, tmp_path: Path) -> None:
    mutant = copy.deepcopy(proof)
    mutant["equations"] = [expression]
    assert words in rejected(mutant, tmp_path / "p.json")


@pytest.mark.exhaustive
def test_a_check_takes_few_operations(proof: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = counted_products(monkeypatch)
    found = checked(proof, tmp_path / "p.json")
    assert found.boxes < 500
    assert calls[0] < 100_000


def test_only_proofs_are_saved(tmp_path: Path) -> None:
    undecided = certify(michaelis_menten(1), region={"s": (-2, 1)}, epsilon=0.01)
    with pytest.raises(GspError, match="only a proof"):
        undecided.save(tmp_path / "p.json")
    assert not list(tmp_path.iterdir())


def test_the_command_line_verifies_it(proof: dict, tmp_path: Path) -> None:
    file = tmp_path / "p.json"
    file.write_text(json.dumps(proof), encoding="utf-8")
    held = CliRunner().invoke(cli, ["verify", str(file)])
    assert held.exit_code == 0
    assert "the proof holds" in held.stdout
    assert "others may lie outside the tube" in held.stdout
    read = json.loads(CliRunner().invoke(cli, ["verify", str(file), "--json"]).stdout)
    assert (read["holds"], read["epsilon"], read["order"]) == (True, 0.1, 1)
    file.write_text(json.dumps(proof | {"epsilon": (3.0).hex()}), encoding="utf-8")
    assert CliRunner().invoke(cli, ["verify", str(file)]).exit_code == 1


# -- rational functions ------------------------------------------------------------------------


def random_expression(draw: random.Random, depth: int) -> str:
    if depth == 0:
        return draw.choice(["z0", "z1", "z2", str(draw.randint(1, 9))])
    one, two = random_expression(draw, depth - 1), random_expression(draw, draw.randint(0, depth - 1))
    kind = draw.choice("+-*/^")
    return f"({one})**{draw.randint(-2, 3)}" if kind == "^" else f"({one}){kind}({two})"


@pytest.mark.exhaustive
def test_rational_functions_are_those_of_sympy() -> None:
    draw = random.Random(12)
    symbols = sp.symbols("z0 z1 z2")
    met = 0
    for _ in range(150):
        text = random_expression(draw, 3)
        ring = RationalFunctions(3)
        try:
            (element,) = ring.evaluate(IntervalProgram((text,), 3), [ring.variable(i) for i in range(3)])
        except Rejected:
            continue
        expression = sp.parse_expr(text)
        place = draw.randrange(3)
        pairs = [(element, expression), (ring.derivative(element, place), expression.diff(symbols[place]))]
        for found, exact in pairs:
            at = [Fraction(draw.randint(-20, 20), draw.randint(1, 7)) for _ in range(3)]
            try:
                value = sum(
                    c * at[0] ** e[0] * at[1] ** e[1] * at[2] ** e[2] for e, c in found.numerator.items()
                )
                for k, power in found.powers.items():
                    factor = sum(
                        c * at[0] ** e[0] * at[1] ** e[1] * at[2] ** e[2] for e, c in ring.factors[k].items()
                    )
                    value *= Fraction(factor) ** power
            except ZeroDivisionError:
                continue
            known = exact.subs({v: sp.Rational(t.numerator, t.denominator) for v, t in zip(symbols, at)})
            if not known.is_Rational:
                continue
            assert Fraction(int(known.p), int(known.q)) == value, text
            met += 1
    assert met > 100
