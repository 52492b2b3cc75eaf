"""Ball arithmetic of several threads at once, and under any precision that python-flint is left at."""

from collections.abc import Iterator
from threading import Barrier, Thread

import flint
import pytest
import sympy as sp

import gsp
from gsp.slow_tubes.certify import certify

x, y, z, eps = sp.symbols("x y z epsilon")
FAST = (
    {y: -y - y**3 + x / 3},
    {y: -3 * y + sp.exp(-x) / 7},
    {y: -y + z / 5, z: -y / 3 - 2 * z + x**2},
    {y: -y * (2 + sp.cos(3 * x)) + x / 7},
)
REGION = {"x": (-1.0, 1.0)}


def branch(fast: dict) -> gsp.Branch:
    system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast=fast, epsilon=eps)
    return gsp.solve_critical(system).branches[0]


def proved(fast: dict) -> tuple:
    """What a proof and the enclosures of a verdict say."""
    found, verdict = certify(branch(fast), region=REGION), gsp.classify(branch(fast), region=REGION)
    assert verdict.exclusion is not None
    return found.gap, found.gaps, found.tangential, verdict.exclusion.gap


@pytest.fixture
def ambient() -> Iterator[None]:
    before = flint.ctx.prec
    yield
    flint.ctx.prec = before


@pytest.mark.exhaustive
def test_four_threads_prove_what_one_does() -> None:
    alone = [proved(fast) for fast in FAST]
    assert len({gap for gap, *_ in alone}) == len(FAST)
    together, before = {}, flint.ctx.prec
    start = Barrier(len(FAST))

    def work(k: int) -> None:
        start.wait(60)
        together[k] = proved(FAST[k])

    threads = [Thread(target=work, args=(k,)) for k in range(len(FAST))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [together[k] for k in range(len(FAST))] == alone
    assert flint.ctx.prec == before


@pytest.mark.exhaustive
@pytest.mark.parametrize("bits", [4, 300])
@pytest.mark.usefixtures("ambient")
def test_the_precision_outside_does_not_matter(bits: int) -> None:
    found = proved(FAST[2])
    flint.ctx.prec = bits
    assert proved(FAST[2]) == found
    assert flint.ctx.prec == bits
