"""Fields that switch on several surfaces, against solutions by hand."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError
from gsp.sliding.crossing_field import CrossingField
from gsp.sliding.law import W
from gsp.sliding.modes import SwitchModes
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.sliding.piecewise_run import Side, run_piecewise

t, u, w, x, a = sp.symbols("t u w x a")
PLUS, MINUS, SLIDING = Side.PLUS, Side.MINUS, Side.SLIDING


def test_two_blocks_that_know_nothing_of_each_other_stop_each_in_its_time() -> None:
    """u' = -2 sign(u) from 1 and w' = -sign(w) from -1: they stop at 1/2 and at 1."""
    field = CrossingField({u: 0, w: 0}, [{u: -2}, {w: -1}], [u, w])
    run = run_piecewise(field, start={"u": 1, "w": -1}, span=(0, 2))
    assert [piece.sides for piece in run.pieces] == [(PLUS, MINUS), (SLIDING, MINUS), (SLIDING, SLIDING)]
    assert run.changes == pytest.approx((0.5, 1.0), abs=1e-10)
    assert (run["u"][-1], run["w"][-1]) == pytest.approx((0, 0), abs=1e-12)


@pytest.mark.exhaustive
def test_a_block_upon_another_slips_when_it_is_pulled_too_hard() -> None:
    """The lower of two blocks of mass 1 is pulled by t; the ground bears 1, what is between them 1/2.

    At t = 1 both go, with (t - 1)/2; at t = 2 the upper is asked for 1/2, and goes with 1/2 from then on.
    """
    field = CrossingField({t: 1, u: t, w: -t}, [{u: -1, w: 1}, {u: sp.Rational(1, 2), w: -1}], [u, w])
    run = run_piecewise(field, start={"t": 0, "u": 0, "w": 0}, span=(0, 3))
    assert [piece.sides for piece in run.pieces] == [(SLIDING, SLIDING), (PLUS, SLIDING), (PLUS, MINUS)]
    assert run.changes == pytest.approx((1.0, 2.0), abs=1e-9)
    assert [piece.loss for piece in run.pieces] == [LossKind.VISIBLE_FOLD, LossKind.VISIBLE_FOLD, None]
    # u = int (t - 1)/2 = 1/4 at t = 2, then u' = t - 3/2; w is the upper's velocity less u.
    assert run["u"][-1] == pytest.approx(0.25 + 1.0, abs=1e-9)
    assert run["w"][-1] == pytest.approx(0.5 - 1.0, abs=1e-9)


@pytest.mark.exhaustive
def test_a_law_that_overshoots_holds_both_for_longer() -> None:
    stribeck = W / sp.sqrt(1 + W**2) + W / (1 + W**2)
    field = CrossingField({t: 1, u: t, w: -t}, [{u: -1, w: 1}, {u: sp.Rational(1, 2), w: -1}], [u, w])
    run = run_piecewise(field, start={"t": 0, "u": 0, "w": 0}, span=(0, 1.5), phi=stribeck)
    assert run.pieces[0].loss is LossKind.SLIP_ONSET
    assert run.changes[0] > 1.1


def test_surfaces_that_depend_on_one_another_are_named() -> None:
    """Two blocks that touch each other and the ground, at rest: what each contact bears is not told by their rest."""
    field = CrossingField({u: 0, w: 0}, [{u: -2}, {w: -2}, {u: -1, w: 1}], [u, w, u - w])
    run = run_piecewise(field, start={"u": 1, "w": 1}, span=(0, 2))
    assert [piece.sides for piece in run.pieces] == [(PLUS, PLUS, SLIDING)]
    assert str(run.message).startswith(
        "u = 0 and w = 0 and u - w = 0 are met at once and depend on one another"
    )


def test_one_surface_is_a_field_of_two_sides() -> None:
    given = PiecewiseField({x: 1, u: x}, {x: 1, u: 1}, u)
    modes = SwitchModes(given.crossing, -1.0, 1.0)
    for signs, rates in (((1,), given.plus), ((-1,), given.minus), ((0,), given.sliding.equations)):
        assert all(sp.cancel(modes.of(signs).rates[z] - rates[z]) == 0 for z in rates)
    state = np.array([-0.5, 0.0])
    (mode,) = modes.after((1,), {0}, state)
    assert mode.signs == (0,)


@pytest.mark.parametrize(
    ("drift", "jumps", "surfaces", "says"),
    [
        ({u: 0}, [{u: 1}], [], "jumps is a list, with one entry"),
        ({u: 0}, [{u: 1}, {u: 1}], [u], "jumps is a list, with one entry"),
        ({u: 0}, [{w: 1}], [u], "states of drift only"),
        ({u: 0}, [{u: 1}], [a], "a has no value"),
        ({u: 0}, [{u: 1}], [sp.S.One], "depends on no state"),
        ({u: 0}, [{u: 1}] * 7, [u] * 7, "7 surfaces, of which 6"),
        (3, [{u: 1}], [u], "drift maps symbols"),
    ],
)
def test_what_makes_no_such_field_is_refused(drift, jumps, surfaces, says) -> None:
    with pytest.raises(DeclarationError, match=says):
        CrossingField(drift, jumps, surfaces)
