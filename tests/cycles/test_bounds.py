"""What is proved of period, ends and divergence against cycles computed in 34 digits, for epsilon down to 1e-8."""

import pytest
from flint import arb

import gsp
from tests.cycles.collocation import Field, computed_cycle
from tests.cycles.systems import fitzhugh_nagumo, lengyel_epstein, morris_lecar, orbit_of, van_der_pol


def van_der_pol_field(x: arb, y: arb) -> tuple[arb, ...]:
    return -y, x - y**3 / 3 + y, arb(0), arb(-1), arb(1), 1 - y**2


def fitzhugh_nagumo_field(x: arb, y: arb) -> tuple[arb, ...]:
    return (
        y + arb(7) / 10 - arb(4) / 5 * x, y - y**3 / 3 - x + arb(1) / 2,
        -arb(4) / 5, arb(1), arb(-1), 1 - y**2,
    )  # fmt: skip


def morris_lecar_field(x: arb, y: arb) -> tuple[arb, ...]:
    u, v, w = (y + arb(6) / 5) / 18, (y - 12) / arb("17.4"), (y - 12) / arb("34.8")
    opened, held = ((1 + z.tanh()) / 2 for z in (u, v))
    opens, holds = ((1 - z.tanh() ** 2) / 2 / size for z, size in ((u, 18), (v, arb("17.4"))))
    return (
        (held - x) * w.cosh(), (45 - 2 * (y + 60) - 8 * x * (y + 84) - 4 * opened * (y - 120)) / 20,
        -w.cosh(), holds * w.cosh() + (held - x) * w.sinh() / arb("34.8"),
        -8 * (y + 84) / 20, (-2 - 8 * x - 4 * opened - 4 * opens * (y - 120)) / 20,
    )  # fmt: skip


def lengyel_epstein_field(x: arb, y: arb) -> tuple[arb, ...]:
    share, slope = y / (1 + y**2), (1 - y**2) / (1 + y**2) ** 2
    return y - x * share, 20 - y - 4 * x * share, -share, 1 - x * slope, -4 * share, -1 - 4 * x * slope


# System, start of the singular orbit, rates, and a start and a section of x for the computed cycle.
CASES: dict[str, tuple[gsp.SlowFastSystem, tuple[float, float], Field, tuple[float, float], float]] = {
    "van der Pol": (van_der_pol(), (2, 0.6), van_der_pol_field, (0.3, 1.9), 0.0),
    "FitzHugh-Nagumo": (fitzhugh_nagumo(), (-1.8, 0.5), fitzhugh_nagumo_field, (0.6, -1.75), 0.4),
    "Morris-Lecar": (morris_lecar(), (-45, 0.3), morris_lecar_field, (0.3, -45.0), 0.2),
    "Lengyel-Epstein": (lengyel_epstein(), (0.45, 13.5), lengyel_epstein_field, (13.5, 0.45), 12.0),
}
EPSILONS = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 5e-4, 2e-3, 1e-2, 3e-2, 7e-2]
# Ten values where a cycle is proved.
OTHERS = {
    "Morris-Lecar": [1e-8, 1e-7, 1e-6, 1e-5, 5e-5, 2e-4, 7e-4, 2e-3, 4e-3, 5.5e-3],
    "Lengyel-Epstein": EPSILONS,
}


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "small"), [(name, small) for name in CASES for small in OTHERS.get(name, EPSILONS)]
)
def test_a_computed_cycle_and_the_law_of_the_period_are_within_what_is_proved(name: str, small: float) -> None:
    system, start, field, begin, level = CASES[name]
    orbit = orbit_of(system, *start)
    found = gsp.certify(orbit, epsilon=small)
    one = found.uniqueness or (found.existence if name in OTHERS else None)
    assert one is not None
    cycle = computed_cycle(field, small, begin, level)
    least, most = one.turn.period
    assert least < cycle.period < most
    assert least < orbit.period(small) < most
    # The width goes with the delay at the folds, until that of the strips is larger.
    assert name in OTHERS or most - least < 70.0 * small ** (2.0 / 3.0) + 0.3
    assert cycle.divergence < one.turn.contraction
    assert name in OTHERS or one.turn.contraction < 0.0
    for (low, high), (first, last) in zip(cycle.ends, one.amplitude):
        assert first[0] < low < first[1]
        assert last[0] < high < last[1]


@pytest.mark.exhaustive
def test_the_second_route_has_the_periods_of_the_literature() -> None:
    """The period at mu = 10 of van der Pol's equation in docs/relaxation.md, found by collocation in doubles."""
    cycle = computed_cycle(van_der_pol_field, 1e-2, (0.3, 1.9), 0.0)
    assert 10.0 * cycle.period == pytest.approx(19.07836956694, abs=1e-10)
