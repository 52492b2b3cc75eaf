"""What a branch loses does not depend on the units of its states: moles are nanomoles times 1e-9."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, classify, solve_critical

x, u, y, z, epsilon = sp.symbols("x u y z epsilon", real=True)
ONE = sp.Integer(1)
SYSTEMS = {
    "pitchfork": ({x: ONE}, {y: x * y - y**3}, {"x": (-1, 1)}),
    "folds and a cusp of one sheet": ({x: ONE}, {y: x + y**3 - y**5}, {"x": (-1, 1), "y": (-2, 2)}),
    "folds over the same x, and a Hopf point": (
        {x: ONE},
        {y: x - z**2 + y * z, z: -z + y / 2 + y**3},
        {"x": (-1, 1), "y": (-1.3, 1.2), "z": (-1.4, 1.1)},
    ),
    "two lines of folds": (
        {x: y - u, u: x},
        {y: -x - u - y**3 / 3 + y},
        {"x": (-1.5, 1.5), "u": (-1, 1), "y": (-3, 3)},
    ),
}
UNITS = {"nano": (-9, -9), "apart": (4, -4), "micro": (-6, -6), "slow micro": (-6, 0), "mega": (6, 6)}


def losses(name: str, powers: tuple[int, int]) -> list[tuple[int, str, float]]:
    """The branch, the kind and the fast coordinate of each loss, in units of 10**power of (slow, fast) variables."""
    slow, fast, region = SYSTEMS[name]
    units = {
        **dict.fromkeys(slow, sp.Integer(10) ** powers[0]),
        **dict.fromkeys(fast, sp.Integer(10) ** powers[1]),
    }
    inner = {state: state / unit for state, unit in units.items()}
    system = SlowFastSystem(
        slow={state: units[state] * rate.subs(inner, simultaneous=True) for state, rate in slow.items()},
        fast={state: units[state] * rate.subs(inner, simultaneous=True) for state, rate in fast.items()},
        epsilon=epsilon,
    )
    of_name = {state.name: float(unit) for state, unit in units.items()}
    box = {state: (low * of_name[state], high * of_name[state]) for state, (low, high) in region.items()}
    return [
        (number, loss.kind.name, round(loss.point["y"] / of_name["y"], 5) + 0.0)
        for number, branch in enumerate(solve_critical(system).branches)
        for loss in sorted(
            classify(branch, region=box).losses, key=lambda loss: (loss.kind.name, loss.point["y"])
        )
    ]


@pytest.mark.exhaustive
@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_losses_are_the_same_in_all_units(name: str, units: str) -> None:
    expected = losses(name, (0, 0))
    assert len(expected) >= 2
    assert losses(name, UNITS[units]) == expected


def test_roots_in_small_bounds_are_those_in_large_ones() -> None:
    found = []
    for unit in (ONE, sp.Rational(1, 10**9)):
        rate = (x + (y / unit) ** 3 - (y / unit) ** 5) * unit
        (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast={y: rate}, epsilon=epsilon)).branches
        bounds = {"y": (-2.0 * float(unit), 2.0 * float(unit))}
        found.append(branch.roots([0.1], bounds=bounds).ravel() / float(unit))
    assert len(found[0]) == 3
    assert found[1] == pytest.approx(found[0], rel=1e-12)


def test_sheets_of_two_fast_variables_in_small_bounds_are_told_apart() -> None:
    counts = []
    for unit in (ONE, sp.Rational(1, 10**9)):
        fast = {y: x * unit - y + z / 2, z: y / 2 - z + 2 * unit * sp.tanh(3 * z / unit)}
        (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=epsilon)).branches
        bounds = {name: (-3.0 * float(unit), 3.0 * float(unit)) for name in ("y", "z")}
        counts.append(np.sort((branch.roots([0.1], bounds=bounds) / float(unit)).ravel()))
    assert len(counts[0]) == 6
    assert counts[1] == pytest.approx(counts[0], rel=1e-10)


@pytest.mark.exhaustive
@pytest.mark.parametrize("unit", [sp.Integer(1), sp.Rational(1, 10**6), sp.Integer(10**6)])
@pytest.mark.parametrize("far", [1, 50, 3000])
def test_a_root_of_what_never_vanishes_switches_nowhere_however_large_it_is_outside(
    far: int, unit: sp.Expr
) -> None:
    # At x = -1 the exponential is exp(3000); over the region it is at most 1.
    fast = {y: sp.sqrt(4 + sp.exp(-far * x / unit)) - y}
    (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=epsilon)).branches
    verdict = classify(branch, region={"x": (0, float(unit))})
    assert not verdict.losses
    assert verdict.holds


@pytest.mark.exhaustive
@pytest.mark.parametrize("powers", [(0, 0), (-6, 6), (6, -6), (-9, -9), (6, 6)])
def test_a_kink_is_a_kink_and_a_jump_a_jump_in_whatever_units(powers: tuple[int, int]) -> None:
    slow, fast = (sp.Integer(10) ** power for power in powers)
    X, Y = x / slow, y / fast
    for rate, jumps, kinks in (
        (sp.Abs(X) - Y, False, True),
        (X + sp.Max(0, 2 * X - Y / 3) - 2 * Y, False, True),
        (sp.Heaviside(X) + X - Y, True, False),
        (X * sp.Abs(X) + X - Y, False, False),
        (sp.Abs(X - Y) + 2 * X - 2 * Y, False, True),
    ):
        system = SlowFastSystem(slow={x: slow}, fast={y: fast * rate}, epsilon=epsilon)
        (branch, *_) = solve_critical(system).branches
        box = {"x": (-float(slow), float(slow)), "y": (-10 * float(fast), 10 * float(fast))}
        (loss,) = (loss for loss in classify(branch, region=box).losses if loss.kind.name == "NON_SMOOTH")
        assert (loss.coefficients["jump"] > 0, loss.coefficients["kink"] > 0) == (jumps, kinks)
        assert ("the whole branch lies" in loss.note) == (rate.has(sp.Abs(X - Y)))
