"""The reduced flow: x' = f(x, h_epsilon(x), epsilon) on the slow manifold, as a series in epsilon."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError, GspError
from gsp.integration.loop import Tests
from gsp.kernels import scan
from gsp.kernels.addresses import SHEET
from gsp.kernels.compilation import address_of
from gsp.kernels.sheets import reach_sheet
from gsp.results.card import Card
from gsp.slow.series import SeriesManifold
from gsp.systems.flow import Flow, Point, Values, plain, values_by_name


@dataclass(frozen=True, eq=False, repr=False)
class ReducedFlow(Flow, Card):
    """The flow on the slow manifold through `order`; an ordinary, non-stiff `Flow`.

    Its states are coordinates on the critical manifold: the slow variables, or on an implicit branch the chart's,
    where y0 stands for the point of M0 over x and is named after the fast variable with a 0. The slow and fast
    variables themselves, and the raw states of a split field, are among its observables. Parameters have their values.
    `base` is the point (x, y) of M0 over a state, `driven_rates` the rates of what is reconstructed in the system's own
    variables, `last_terms` the last two terms of the series of y after h_0. A run ends where normal hyperbolicity is
    lost, and at orders above 0 where the series ends before.
    """

    manifold: SeriesManifold
    order: int
    states: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]
    observables: Values
    epsilon: sp.Symbol
    parameters: Values = field(default_factory=dict)
    is_stiff: bool = False
    driven: tuple[sp.Symbol, ...] = ()
    base: tuple[sp.Expr, ...] = ()
    driven_rates: tuple[sp.Expr, ...] = ()
    last_terms: tuple[tuple[sp.Expr, ...], ...] = ()
    is_reduced = True

    @property
    def fixed(self) -> Values:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Values of the system's parameters, which the rates no longer contain."""
        return self.manifold.branch.system.parameters

    @property
    def variables_shown(self) -> tuple[sp.Symbol, ...]:
        """The states, or on an implicit branch the slow and the fast variables in the place of the chart's."""
        branch = self.manifold.branch
        return self.states if branch.is_explicit else (*branch.system.states, *self.driven)

    def initial(self, start: Point) -> tuple[float, ...]:
        """State over the slow variables that `start` names.

        Fast variables may be named too: on an implicit branch without a fixed sheet they choose the sheet. Otherwise
        they say nothing: the start is moved along x = const to the graph, or to the fixed sheet even where another is
        nearer. Quantities that are reconstructed start at 0 when not named.
        """
        names, over, places, rest = self._usual
        known = self._known(start, names) if names else None
        if known is not None:
            if over is not None:
                point = (*known, *over(np.array(known)).tolist())
                known = [point[place] for place in places]
            return (*known, *rest)
        given = values_by_name(start, what="start")
        slow, allowed, own, driven = self._names
        if not allowed.issuperset(given) or not given.keys() >= slow.keys():
            unknown = sorted(set(given) - allowed)
            missing = [name for name in slow if name not in given]
            fact = f"start names {', '.join(unknown)}, unknown here" if unknown else ""
            lack = f"start gives no value for {', '.join(missing)}" if missing else ""
            raise DeclarationError(
                f"{'; '.join(filter(None, (fact, lack)))}.",
                f"A reduced flow starts at its slow variables {', '.join(slow)}.",
                got=given,
            )
        branch = self.manifold.branch
        values = given
        if not branch.is_explicit:
            system = branch.system
            x = np.array([given[name] for name in slow])
            fast = [given[y.name] for y in system.y if y.name in given]
            near = fast if len(fast) == len(system.y) else None
            y = branch.points(x[None, :], near=near)[0] if branch.seed is None else branch.over(x)
            values = dict(zip([state.name for state in system.states], [*x.tolist(), *y.tolist()]))
        return (*[values[name] for name in own], *[given.get(name, 0.0) for name in driven])

    @cached_property
    def leaves_pairs(self) -> bool:
        """Whether imaginary pairs are sought in finished runs, there being too many coupled fast variables."""
        from gsp.integration.reduction_end.validity import validity_of

        return validity_of(self).leaves_pairs

    @cached_property
    def tests(self) -> Tests:
        """What compiled code takes to see whether anything may happen along a run."""
        # Imported here: what is watched is made of this flow.
        from gsp.integration.reduction_end.validity import validity_of

        validity = validity_of(self)
        functions, count = validity.functions, validity.along.outputs
        _, over, places, _ = self._usual
        if over is not None:
            functions = np.concatenate([functions, places, self.manifold.branch._sheet])
            functions[scan.SHEET], functions[scan.SLOW] = address_of(reach_sheet, SHEET), len(places)
        return Tests(functions, count)

    def slow_start(self, start: Point) -> tuple[float, ...] | None:
        """The slow variables and what starts at 0, where compiled code finds the point of M0 over them; else None."""
        names, over, places, rest = self._usual
        # Compiled code puts as many coordinates in the place of the slow variables as there are of these.
        known = self._known(start, names) if over is not None and len(places) == len(names) else None
        return None if known is None else (*known, *rest)

    def _known(self, start: Point, names: tuple[str, ...]) -> tuple[float, ...] | None:
        """The values of `names` of a start that has these, or all slow and fast variables, and no others; else None."""
        known = plain(start, names)
        if known is None:
            # Where `_usual` names anything no fast variable chooses a sheet.
            every, places = self._every
            given = plain(start, every)
            known = None if given is None else tuple([given[place] for place in places])
        return known

    @cached_property
    def _every(self) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """The names of all slow and fast variables, and where among them those of `_usual` are."""
        every = tuple(s.name for s in self.manifold.branch.system.states)
        return every, tuple(map(every.index, self._usual[0]))

    @cached_property
    def _names(self) -> tuple[dict[str, None], frozenset[str], tuple[str, ...], tuple[str, ...]]:
        """Of the slow variables, in order, of what a start may name, the manifold's coordinates and what is driven."""
        system = self.manifold.branch.system
        driven = tuple(s.name for s in self.driven)
        return (
            dict.fromkeys(x.name for x in system.x),
            frozenset([*(s.name for s in system.states), *driven]),
            tuple(s.name for s in self.manifold.coordinates),
            driven,
        )

    @cached_property
    def _usual(
        self,
    ) -> tuple[tuple[str, ...], Callable[[np.ndarray], np.ndarray] | None, tuple[int, ...], tuple[float, ...]]:
        """What most starts name, the slow variables alone, none where that is not enough; what gives y over them.

        Then which of (x, y) the manifold's coordinates are, and where what is reconstructed starts.
        """
        branch, coordinates = self.manifold.branch, self.manifold.coordinates
        states, rest = branch.system.states, (0.0,) * len(self.driven)
        if branch.is_explicit:
            return tuple(s.name for s in coordinates), None, (), rest
        if branch.seed is None:
            return (), None, (), rest
        names = tuple(x.name for x in branch.system.x)
        return names, branch.over, tuple(states.index(s) for s in coordinates), rest

    def initials(self, starts: Mapping[str, np.ndarray]) -> np.ndarray:
        """State array (m, n) of many starts; no start costs more than its copy, or on a fixed sheet Newton's method."""
        branch = self.manifold.branch
        names, over, places, rest = self._usual
        if over is not None and starts.keys() == set(names):
            x = np.stack([starts[name] for name in names], axis=1)
            y = branch.over_each(x)
            states = np.hstack([x, y])[:, places]
            # The sheet does not reach there, or bends on the way: as for one start, with its error.
            for i in np.flatnonzero(np.isnan(y).any(axis=1)).tolist():
                try:
                    states[i] = self.initial(dict(zip(names, x[i].tolist())))[: len(places)]
                except GspError as error:
                    raise error.under(f"member {i}") from None
            return np.hstack([states, np.tile(rest, (len(x), 1))])
        if not branch.is_explicit:
            return super().initials(starts)
        # The names decide alike for all, so that one start checks them.
        self.initial(dict.fromkeys(starts, 0.0))
        zeros = np.zeros(len(next(iter(starts.values()))))
        return np.stack([starts.get(state.name, zeros) for state in self.states], axis=1)

    def __repr__(self) -> str:
        return f"ReducedFlow({self.manifold.branch}, order={self.order})"

    def __str__(self) -> str:
        lines = [f"reduced flow through order {self.order}"]
        lines += [f"  {s}' = {rate}" for s, rate in zip(self.states, self.rates)]
        return "\n".join(lines)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ReducedFlow) and (self is other or self._key == other._key)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _key(self) -> tuple:
        # All that a run depends on: where it ends is decided by the branch, which the rates do not tell.
        return (
            self.manifold.branch,
            self.order,
            self.states,
            self.rates,
            tuple(self.observables.items()),
            self.epsilon,
            tuple(self.parameters.items()),
            self.is_stiff,
            self.driven,
            self.base,
            self.driven_rates,
            self.last_terms,
        )

    @cached_property
    def _hash(self) -> int:
        return hash(self._key)
