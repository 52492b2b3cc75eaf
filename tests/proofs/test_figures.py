"""The systems that proofs were promised for: how many boxes each takes, and what is proved of it."""

import pytest
import sympy as sp

import gsp
from gsp.proofs.verdict import ProofVerdict
from gsp.slow_tubes.certify import certify
from tests import example_systems as systems

v, w, s, x, y, z, n, eps = sp.symbols("v w s x y z n epsilon")
Q = sp.Rational
PROVED = ProofVerdict.PROVED


def branch(slow: dict, fast: dict, parameters: dict, through: dict | None = None):
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=eps, parameters=parameters)
    found = gsp.solve_critical(system).branches[0]
    return found if through is None else found.through(through)


def sleigh():
    return gsp.solve_critical(systems.sleigh()).branches[0]


def koper():
    return gsp.solve_critical(systems.koper()).branches[0].through({"y": 0.0, "z": 0.0, "x": 2.4})


def fitzhugh_nagumo():
    current = sp.Symbol("i")
    return branch(
        {w: Q(2, 25) * (v + Q(7, 10) - Q(4, 5) * w)},
        {v: v - v**3 / 3 - w + current},
        {current: Q(0)},
        {"w": 0.0, "v": -1.7},
    )


def morris_lecar():
    # Set 1 of the usual constants: C = 20, V_K = -84, V_L = -60, V_Ca = 120, I = 90.
    open_share = (1 + sp.tanh((x + Q(6, 5)) / 18)) / 2
    fast = (90 - 2 * (x + 60) - Q(22, 5) * open_share * (x - 120) - 8 * n * (x + 84)) / 20
    return branch({n: x - n}, {x: fast}, {}, {"n": 0.3, "x": -45.0})


def complex_pair():
    return branch({s: -s}, {x: -x - 8 * y + s * x / 4, y: x - y + s**2}, {})


def saddle():
    return branch({s: -s, z: -z}, {x: (1 + s / 4) * x - z**2 + y / 5, y: -(1 + z**2) * y + s * x / 4}, {})


def four_fast():
    # Two stable, a stable pair, one of them made unstable, and quadratic terms with coefficients of a fixed draw.
    import random

    draw = random.Random(4)
    fast = sp.symbols("y1:5")
    linear = sp.Matrix([[-1, 2, 0, 0], [-2, -1, 0, 0], [0, 0, -2, 0], [0, 0, 0, 1]])
    rates = list(linear * sp.Matrix(fast))
    for i in range(4):
        for first in (s, z):
            rates[i] += Q(draw.randint(-10, 10), 100) * first
            for second in fast:
                rates[i] += Q(draw.randint(-10, 10), 100) * first * second
        rates[i] += Q(draw.randint(-10, 10), 100) * fast[i] * fast[(i + 1) % 4]
    return branch(
        {s: -s, z: -z}, dict(zip(fast, rates)), {}, {"s": 0.0, "z": 0.0, **{f"y{i}": 0.0 for i in range(1, 5)}}
    )


CASES = {
    "sleigh": (sleigh, {"v": (-10, 10), "p": (-10, 10), "m": (0.5, 2), "I": (0.5, 2), "a": (0, 1)}, (1, 0), 14),
    "FitzHugh-Nagumo": (fitzhugh_nagumo, {"w": (-0.25, 1.5), "i": (0, 0.25)}, (1, 0), 20),
    "Koper": (
        koper, {"y": (-0.25, 0.75), "z": (-1, 1), "k": (-10.125, -9.875), "lambda": (-7.125, -6.875)}, (1, 0), 8
    ),
    "Morris-Lecar": (morris_lecar, {"n": (0.1328, 0.5)}, (1, 0), 14),
    "complex pair": (complex_pair, {"s": (-1, 1)}, (2, 0), 5),
    "saddle": (saddle, {"s": (-1, 1), "z": (-1, 1)}, (1, 1), 10),
    "four fast": (four_fast, {"s": (-1, 1), "z": (-1, 1)}, (3, 1), 10),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_promised_systems_are_proved_in_few_boxes(name: str) -> None:
    make, region, counts, most = CASES[name]
    found = certify(make(), region=region)
    assert found.verdict is PROVED, found.reason
    assert (found.stable, found.unstable) == counts
    assert found.gap > 0.0
    assert found.tried <= most


def test_the_enzyme_is_proved_for_an_interval_of_its_constants() -> None:
    from gsp.scenes.study import study_of

    study = study_of(gsp.models.load("michaelis_menten"))
    found = certify(study.branch, region={"s": (0, 5), "kappa": (0.5, 2)})
    assert found.verdict is PROVED
    # g = s - (s + kappa) c: the eigenvalue is -(s + kappa).
    assert 0.2 < found.gap <= 0.5
    assert found.tried <= 20
