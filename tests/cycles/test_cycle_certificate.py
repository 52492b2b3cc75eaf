"""Relaxation cycles proved for every epsilon up to a bound, and what is never called proved."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.algebra.precision import precision
from gsp.cycles import conditions
from gsp.cycles.annulus import Annulus
from gsp.cycles.conditions import NotProved, proved
from gsp.cycles.cycle_certificate import CycleCertificate
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.outline import Outliner, _assembled, frames_of
from gsp.errors import DeclarationError
from tests.cycles.systems import (
    R,
    epsilon,
    fitzhugh_nagumo,
    lengyel_epstein,
    morris_lecar,
    orbit_of,
    system,
    two_cycles,
    van_der_pol,
    x,
    y,
)

# System, start, and the epsilon_0 and epsilon_1 that are reached at least.
CASES = {
    "van der Pol": (van_der_pol(), (2, 0.6), 0.75, 0.15),
    "van der Pol, a = 1/2": (van_der_pol(R(1, 2)), (2, 0.6), 0.28, 0.12),
    "van der Pol, a = 9/10": (van_der_pol(R(9, 10)), (2, 0.6), 0.045, 0.045),
    "FitzHugh-Nagumo": (fitzhugh_nagumo(), (-1.8, 0.5), 0.13, 0.07),
    "Morris-Lecar": (morris_lecar(), (-45, 0.3), 0.0085, 0.0055),
    "Lengyel-Epstein": (lengyel_epstein(), (0.45, 13.5), 0.07, 0.07),
}


@cache
def certified(name: str) -> CycleCertificate:
    found, start, *_ = CASES[name]
    return gsp.certify(orbit_of(found, *start))


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_a_cycle_exists_and_is_the_only_one_for_every_epsilon_up_to_a_bound(name: str) -> None:
    found = certified(name)
    *_, exists, unique = CASES[name]
    assert found.verdict is gsp.ProofVerdict.PROVED
    assert found.epsilon_0 >= exists
    assert found.epsilon_1 >= unique


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["van der Pol, a = 1/2", "FitzHugh-Nagumo", "Lengyel-Epstein"])
@pytest.mark.parametrize("share", [1.0, 0.1])
def test_the_period_and_the_ends_of_a_computed_cycle_are_in_their_bounds(name: str, share: float) -> None:
    found = certified(name)
    for one in (found.existence, found.uniqueness):
        assert one is not None
        small = share * one.epsilon
        u, v = (float(c) for c in CASES[name][1])
        cycle = gsp.periodic_orbit(CASES[name][0], start={"x": u, "y": v}, epsilon=small)
        assert one.turn.period[0] < cycle.period < one.turn.period[1]
        for variable, (low, high) in zip(("y", "x"), one.amplitude):
            values = cycle.values(variable, np.linspace(0.0, 1.0, 2001))
            assert low[0] < values.min() < low[1]
            assert high[0] < values.max() < high[1]


@pytest.mark.exhaustive
def test_an_epsilon_that_is_given_has_an_annulus_of_its_own() -> None:
    orbit = orbit_of(van_der_pol(), 2, 0.6)
    wide, narrow = (gsp.certify(orbit, epsilon=small).uniqueness for small in (0.1, 1e-4))
    assert wide is not None
    assert narrow is not None
    assert wide.epsilon == 0.1
    assert narrow.amplitude[0][1][1] - narrow.amplitude[0][1][0] < 0.02
    assert wide.amplitude[0][1][1] - wide.amplitude[0][1][0] > 0.2
    # The decimal 0.3 is larger than its double.
    assert gsp.certify(orbit, epsilon=0.3).epsilon_0 > 0.3


@pytest.mark.exhaustive
def test_bounds_that_are_loose_by_chance_are_those_of_a_larger_epsilon() -> None:
    """At 0.0021 a strip of Morris and Lecar's annulus nearly meets a zero of the slow rate, a tenth further on none."""
    found = gsp.certify(orbit_of(morris_lecar(), -45, 0.3), epsilon=0.0021)
    assert found.epsilon_0 < 0.00211
    assert found.epsilon_1 >= 0.0021


@pytest.mark.exhaustive
def test_a_line_stays_as_far_from_a_sheet_as_orbits_lag_behind_it() -> None:
    """Folds of one orbit whose delays differ twelvefold: nearer to the sheet, edges are as short as steps of a stiff
    method, and go with the root of epsilon.
    """
    orbit = orbit_of(lengyel_epstein(), 0.45, 13.5)
    outlined = Outliner(EnclosedField.of(lengyel_epstein()), frames_of(orbit), 1e-6)
    assert len(outlined._closed(outer=True).points) < 1000


@pytest.mark.exhaustive
def test_rates_may_depend_on_epsilon() -> None:
    found = gsp.certify(orbit_of(system(-x - epsilon * y, y - x**3 / 3 + x + epsilon * sp.cos(x)), 2, 0.6))
    assert found.epsilon_0 > 0.02
    assert found.epsilon_1 > 0.005
    # An annulus of uniqueness was found here for a larger epsilon than the search for existence had come to.
    both = gsp.certify(orbit_of(system(-x - epsilon * y / 2, y - x**3 / 3 + x + epsilon * x / 3), 2, 0.6))
    assert both.epsilon_0 >= both.epsilon_1 > 0.08


@pytest.mark.exhaustive
def test_units_do_not_matter() -> None:
    """Volts for millivolts and hours for seconds: epsilon_0 goes with the time of the slow variable."""
    k, m, t = R(1, 1000), R(50), R(1, 3600)
    slow, fast = (-x, y - x**3 / 3 + x)
    turned = {x: x / k, y: y / m}
    scaled = system(m * t * slow.xreplace(turned), k * fast.xreplace(turned))
    plain = gsp.certify(orbit_of(van_der_pol(), 2, 0.6))
    found = gsp.certify(orbit_of(scaled, 0.002, 30))
    # Slow time runs 1/3600 as fast: epsilon x' = k g means epsilon/t in the old time.
    assert found.epsilon_0 * float(t) == pytest.approx(plain.epsilon_0, rel=0.15)
    assert found.epsilon_1 * float(t) == pytest.approx(plain.epsilon_1, rel=0.15)


# -- never proved --------------------------------------------------------------------------------------


def test_an_excitable_parameter_is_undecided() -> None:
    for found, start in ((van_der_pol(R(6, 5)), (2, 0.6)), (fitzhugh_nagumo(R(0)), (-1.8, 0.5))):
        cycle = gsp.certify(orbit_of(found, *start))
        assert cycle.verdict is gsp.ProofVerdict.UNDECIDED
        assert "does not close" in cycle.reason
        assert cycle.epsilon_0 == cycle.epsilon_1 == 0.0


@pytest.mark.parametrize("small", [0.01, 0.05, 0.1])
def test_a_canard_window_is_undecided(small: float) -> None:
    """The maximal canard of a - x is at a = 1 - epsilon/8: for a = 0.9987 at epsilon = 0.0104; no drops beyond."""
    cycle = gsp.certify(orbit_of(van_der_pol(R(9987, 10000)), 2, 0.6), epsilon=small)
    assert cycle.verdict is gsp.ProofVerdict.UNDECIDED


@pytest.mark.exhaustive
def test_a_cycle_within_a_cycle_is_not_called_unique() -> None:
    field = EnclosedField.of(two_cycles())
    inside, outside = (Outliner(field, frames_of(orbit_of(two_cycles(), u, 0.5)), 1e-4) for u in (1.2, 2.8))
    each = [gsp.certify(orbit_of(two_cycles(), u, 0.5), epsilon=1e-4) for u in (1.2, 2.8)]
    assert all(one.epsilon_1 >= 1e-4 for one in each)
    polygons = [outside._closed(outer=True), inside._closed(outer=False)]
    for k, frame in enumerate(outside.frames):
        for level in (-0.2, 0.2):
            polygons = [p.cut(k, level * frame.fast, frame.fast) for p in polygons]
    annulus = _assembled(*polygons, flip=outside.frames[0].slow * outside.frames[0].fast < 0.0)
    with precision(64):
        turn = proved(field, annulus, 1e-4, 24)
    # Cycles exist between the polygons; the repelling sheet between them is in the bound.
    assert turn.contraction > 0.0


def test_a_piece_without_a_drop_is_undecided() -> None:
    orbit = orbit_of(van_der_pol(), 2, 0.6)
    without = replace(orbit, pieces=tuple(replace(piece, fold=None) for piece in orbit.pieces))
    assert "otherwise than at a fold" in gsp.certify(without).reason


def test_the_annuli_are_drawn_about_the_orbit() -> None:
    axes = certified("van der Pol").plot()
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert [label.split(",")[0] for label in labels if "up to" in label] == ["a cycle", "the only cycle"]
    (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for patch in axes.patches:
        x, y = patch.get_path().vertices.T
        assert low < x.min() < x.max() < high
        assert bottom < y.min() < y.max() < top


@pytest.mark.exhaustive
def test_a_report_says_what_is_proved_of_its_cycle() -> None:
    study = gsp.analyse(gsp.models.load("van_der_pol"))
    cycle = study.boundary.cycle
    assert cycle is not None
    assert cycle.epsilon_1 >= study.scene.epsilon


def test_a_cycle_of_more_variables_is_refused() -> None:
    z = sp.Symbol("z")
    spatial = gsp.SlowFastSystem(
        slow={y: -x + z / 3, z: x - z + y / 2}, fast={x: y - x**3 / 3 + x + z / 10}, epsilon=epsilon
    )
    start = {"x": 2, "y": 0.6, "z": 0.5}
    orbit = gsp.singular_orbit(gsp.solve_critical(spatial).nearest(start), start, max_pieces=1)
    with pytest.raises(DeclarationError, match="one slow and one fast"):
        gsp.certify(orbit)


# -- each condition ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def annulus() -> Annulus:
    found = gsp.certify(orbit_of(van_der_pol(), 2, 0.6), epsilon=0.05).existence
    assert found is not None
    return found.annulus


def moved(polygon: np.ndarray, place: int, by: tuple[float, float]) -> np.ndarray:
    found = polygon.copy()
    found[place] += by
    return found


CHANGES = {
    "two vertices of P swapped": lambda a: (a.outer[[1, 0, *range(2, len(a.outer))]], a.inner, a.cuts),
    "two vertices of Q swapped": lambda a: (a.outer, a.inner[[1, 0, *range(2, len(a.inner))]], a.cuts),
    "P clockwise": lambda a: (a.outer[::-1], a.inner, a.cuts),
    "Q clockwise": lambda a: (a.outer, a.inner[::-1], a.cuts),
    "a vertex twice": lambda a: (np.vstack([a.outer, a.outer[-1:]]), a.inner, a.cuts),
    "P in Q": lambda a: (a.inner, a.outer, tuple((i, o) for o, i in a.cuts)),
    "Q beside P": lambda a: (a.outer, a.inner + np.array([0.0, 10.0]), a.cuts),
    "Q larger than P": lambda a: (a.outer, 3.0 * a.inner, a.cuts),
    "P touches Q": lambda a: (moved(a.outer, 20, a.inner[20] - a.outer[20]), a.inner, a.cuts),
    "no cuts": lambda a: (a.outer, a.inner, ()),
    "three cuts": lambda a: (a.outer, a.inner, a.cuts[:3]),
    "cuts out of order": lambda a: (a.outer, a.inner, a.cuts[::-1]),
    "cuts in turn the other way": lambda a: (a.outer, a.inner, (*a.cuts[1:], a.cuts[0])),
    "a cut askew": lambda a: (a.outer, a.inner, ((a.cuts[0][0], a.cuts[0][1] + 1), *a.cuts[1:])),
    "two cuts from one vertex": lambda a: (a.outer, a.inner, (a.cuts[0], a.cuts[0], *a.cuts[2:])),
    "P on the sheet": lambda a: (0.93 * a.outer, a.inner, a.cuts),
    "Q over the sheet": lambda a: (a.outer, 1.05 * a.inner, a.cuts),
    "P turned": lambda a: (a.outer @ np.array([[1.0, 0.1], [-0.1, 1.0]]), a.inner, a.cuts),
    "Q turned": lambda a: (a.outer, a.inner @ np.array([[1.0, 0.1], [-0.1, 1.0]]), a.cuts),
    "Q a point": lambda a: (a.outer, 1e-3 * a.inner, a.cuts),
}


@pytest.mark.parametrize("name", CHANGES)
def test_an_annulus_that_breaks_a_condition_is_not_proved(annulus: Annulus, name: str) -> None:
    field = EnclosedField.of(van_der_pol())
    with precision(64):
        assert proved(field, annulus, 0.05, 16).contraction < 0.0
        with pytest.raises(NotProved):
            proved(field, Annulus(*CHANGES[name](annulus)), 0.05, 16)


@pytest.mark.parametrize("scale", [10.0, 100.0])
def test_an_annulus_is_not_proved_for_a_larger_epsilon(annulus: Annulus, scale: float) -> None:
    with precision(64), pytest.raises(NotProved):
        proved(EnclosedField.of(van_der_pol()), annulus, scale * 0.05, 16)


@pytest.mark.parametrize(
    "other",
    [
        van_der_pol(R(9, 10)),
        van_der_pol(R(3, 2)),
        system(x, y - x**3 / 3 + x),
        system(-x, x**3 / 3 - x - y),
        system(-x, y - x**3 / 3 + x + R(1, 2)),
    ],
)
def test_an_annulus_is_not_proved_for_another_field(annulus: Annulus, other: gsp.SlowFastSystem) -> None:
    with precision(64), pytest.raises(NotProved):
        proved(EnclosedField.of(other), annulus, 0.05, 16)


def test_segments_that_touch_meet_and_neighbours_do_not() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.0], [0.5, 1.0], [2.0, 0.0], [0.5, 1e-300]])
    assert conditions._meet(points, (0, 1), (2, 3))
    assert not conditions._meet(points, (0, 1), (5, 3))
    assert not conditions._meet(points, (0, 1), (1, 4))
    assert conditions._meet(points, (0, 1), (0, 2))
    assert conditions._meet(points, (0, 4), (2, 1))


def test_progress_of_a_cycle_and_of_a_passage_rises_to_one_and_an_interrupt_in_it_ends_both() -> None:
    orbit, fold = orbit_of(van_der_pol(), 2, 0.6), gsp.fold_passage(van_der_pol(), {"x": 1, "y": -2 / 3})

    def interrupt(share: float) -> None:
        if share > 0.2:
            raise KeyboardInterrupt

    for noun, options in ((orbit, {}), (fold, {"start": {"y": 0.6}})):
        shares: list[float] = []
        gsp.certify(noun, **options, progress=shares.append)
        assert shares == sorted(shares)
        assert (shares[0], shares[-1]) == (0.0, 1.0)
        assert len(set(shares)) > 4
        with pytest.raises(KeyboardInterrupt):
            gsp.certify(noun, **options, progress=interrupt)
