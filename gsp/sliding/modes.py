"""Modes of a field that switches: on which side of each surface it is, or on it, and where each goes on.

With s' = b + G phi for the surfaces s, phi is 1 or -1 off a surface. On the surfaces S it is what keeps s_S = 0,
phi_S = -G_SS^-1 (b_S + G_SF phi_F), while low < phi < high for what the law bears and (-1)^|S| det G_SS > 0, so that
the surface attracts.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.brevity import in_factors, in_lowest_terms
from gsp.algebra.sharing import size
from gsp.integration.events import Event
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import CompiledFunction, compile_over
from gsp.proofs.ball_functions import BallFunction
from gsp.sliding.between import enclosed
from gsp.sliding.crossing_field import CrossingField
from gsp.splitting.fast_part import adjugate_and_determinant
from gsp.systems.declaration import exact
from gsp.systems.system import VectorField

# Below this share of its terms a rate is zero, and its own rate decides: what events leave is a thousand times smaller.
TANGENT = 1e-9
# Rates of rates that are asked for, each longer by the number of states: a fold is the flatter the more are zero.
ORDERS = 4


class _Margin(NamedTuple):
    """What is positive where a mode goes on beside a surface, by its number, and the size of its terms."""

    surface: int
    value: sp.Expr
    terms: sp.Expr


@dataclass(frozen=True)
class SwitchMode:
    """1, -1 or 0 for each surface, 0 where the field slides on it, for a law that bears `low` < phi < `high`."""

    field: CrossingField
    signs: tuple[int, ...]
    low: float
    high: float

    @property
    def stuck(self) -> list[int]:
        """The surfaces that it slides on."""
        return [c for c, sign in enumerate(self.signs) if sign == 0]

    @cached_property
    def _solved(self) -> tuple[dict[int, sp.Expr], sp.Expr]:
        """phi_c times D for the surfaces that it slides on, and D = (-1)^|S| det G_SS."""
        field, stuck = self.field, self.stuck
        if not stuck:
            return {}, sp.S.One
        G = sp.Matrix([[field.rate_of(field.surfaces[c], field.jumps[d]) for d in stuck] for c in stuck])
        b = sp.Matrix([field.rate_of(field.surfaces[c], self._free) for c in stuck])
        adjugate, determinant = adjugate_and_determinant(G)
        sign = (-1) ** len(stuck)
        phi = {c: in_lowest_terms(value) for c, value in zip(stuck, -sign * adjugate * b)}
        return phi, in_lowest_terms(sign * determinant)

    @cached_property
    def _free(self) -> dict[sp.Symbol, sp.Expr]:
        """The rates with what the surfaces give that it is off."""
        field = self.field
        return {
            z: rate + sp.Add(*(sign * jump[z] for sign, jump in zip(self.signs, field.jumps) if sign))
            for z, rate in field.drift.items()
        }

    @cached_property
    def rates(self) -> dict[sp.Symbol, sp.Expr]:
        """The rates of the states."""
        phi, D = self._solved
        if not phi:
            return self._free
        jumps = self.field.jumps
        return {
            z: in_factors((rate * D + sp.Add(*(value * jumps[c][z] for c, value in phi.items()))) / D)
            for z, rate in self._free.items()
        }

    @cached_property
    def flow(self) -> VectorField:
        """The field of the mode."""
        return self.field.flow(self.rates)

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """What ends it: a surface reached, by its number, a bound of the law, or "both" where D vanishes."""
        phi, D = self._solved
        found = [
            Event(surface, direction=-sign, terminal=True, name=f"{c}")
            for c, (surface, sign) in enumerate(zip(self.field.surfaces, self.signs))
            if sign
        ]
        for c, value in phi.items():
            found.append(Event(value - exact(self.high) * D, direction=1, terminal=True, name=f"{c} above"))
            found.append(Event(value - exact(self.low) * D, direction=-1, terminal=True, name=f"{c} below"))
        if phi and D.has(*self.field.states):
            found.append(Event(D, direction=-1, terminal=True, name="both"))
        return tuple(found)

    @cached_property
    def enclosed_events(self) -> list[BallFunction] | None:
        """The functions of the events in balls."""
        return enclosed(self.flow, self.events)

    @cached_property
    def _margins(self) -> list[_Margin]:
        """What has to be positive beside each surface."""
        field = self.field
        phi, D = self._solved
        found = []
        for c, (surface, sign) in enumerate(zip(field.surfaces, self.signs)):
            if sign:
                terms = sp.Add(*(size(field.rate_of(surface, jump)) for jump in (field.drift, *field.jumps)))
                found.append(_Margin(c, sign * field.rate_of(surface, self.rates), terms))
                continue
            for value in (exact(self.high) * D - phi[c], phi[c] - exact(self.low) * D):
                found.append(_Margin(c, value, size(D) + size(phi[c])))
        return found

    @cached_property
    def _tests(self) -> CompiledFunction:
        """D, then each margin and the size of its terms."""
        outputs = [e for margin in self._margins for e in (margin.value, margin.terms)]
        return compile_over(self.flow, [self._solved[1], *outputs])

    def ends_in_two_fold(self, states: np.ndarray) -> bool:
        """Whether D is zero at the last of the `states` (n, m) of a run in this mode, beside what it was along it.

        There the folds of both sides and D = 0 are one place, and which event is located first is rounding's choice.
        """
        if not self.stuck:
            return False
        constants = compile_flow(self.flow).constants
        along = [abs(self._tests(state, constants)[0]) for state in states.T]
        return bool(along[-1] <= TANGENT * max(along))

    @property
    def is_shared(self) -> bool:
        """Whether no phi moves the surfaces that it slides on apart, so that nothing says what each of them bears."""
        return self._solved[1] == 0

    def goes_on(self, state: np.ndarray, among: set[int]) -> bool:
        """Whether a run on the surfaces `among` can go on in this mode from `state`."""
        if self.is_shared:
            return False
        D, *tests = self._tests(state, compile_flow(self.flow).constants)
        if not D > 0.0:
            return False
        for k, (margin, value, terms) in enumerate(zip(self._margins, tests[::2], tests[1::2])):
            if margin.surface in among:
                opens = value > 0.0 if abs(value) > TANGENT * terms else self._opens(k, state)
                if not opens:
                    return False
        return True

    def _opens(self, k: int, state: np.ndarray) -> bool:
        """Whether margin k, zero at `state`, becomes positive: as the first of its rates that is not zero there."""
        constants = compile_flow(self.flow).constants
        for order in range(ORDERS):
            (rate,) = self._rate(k, order)(state, constants)
            if rate != 0.0:
                return bool(rate > 0.0)
        return False

    def _rate(self, k: int, order: int) -> CompiledFunction:
        """The rate of margin k along the mode, or of its rate and so on; each is made when it is first asked for."""
        known = self._rates_of[k]
        if order == len(known):
            last = known[-1][0] if known else self._margins[k].value
            rate = self.field.rate_of(last, self.rates)
            known.append((rate, compile_over(self.flow, [rate])))
        return known[order][1]

    @cached_property
    def _rates_of(self) -> list[list[tuple[sp.Expr, CompiledFunction]]]:
        return [[] for _ in self._margins]


class SwitchModes:
    """All modes of a field, each made once."""

    def __init__(self, field: CrossingField, low: float, high: float) -> None:
        self.field, self.bounds = field, (low, high)
        self._made: dict[tuple[int, ...], SwitchMode] = {}

    def of(self, signs: tuple[int, ...]) -> SwitchMode:
        """The mode with these signs."""
        if signs not in self._made:
            self._made[signs] = SwitchMode(self.field, signs, *self.bounds)
        return self._made[signs]

    def after(self, signs: tuple[int, ...], among: set[int], state: np.ndarray) -> list[SwitchMode]:
        """The modes in which a run can go on that is on the surfaces `among`: those that slide on the most of them."""
        found: list[SwitchMode] = []
        options = [(0, 1, -1) if c in among else (sign,) for c, sign in enumerate(signs)]
        for chosen in sorted(itertools.product(*options), key=lambda each: -each.count(0)):
            if found and chosen.count(0) < len(found[0].stuck):
                break
            mode = self.of(chosen)
            if mode.goes_on(state, among):
                found.append(mode)
        return found
