"""`average`: what moves slowly beside a fast phase, averaged over it to any order, exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp

from gsp.algebra.brevity import brief
from gsp.algebra.centres import centres
from gsp.algebra.laurent import misplaced_epsilon
from gsp.algebra.sharing import size
from gsp.averaging.near_identity import NearIdentity
from gsp.averaging.phase_form import PhaseForm, phase_form
from gsp.averaging.turning_rate import require_turning
from gsp.errors import DeclarationError, GspError, SplittingError, met_at
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.results.drawn import Drawn
from gsp.results.table import names_of
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.slow_time import in_slow_time
from gsp.splitting.fast_time import divided, divides, is_in_fast_time
from gsp.systems.arguments import check_each, check_flag, check_noun, shown
from gsp.systems.flow import Point, Values, check_epsilon, check_order, complete, read_only
from gsp.systems.region import Interval, check_region
from gsp.systems.system import SlowFastSystem, VectorField


@dataclass(frozen=True, eq=False, repr=False)
class Averaging(Drawn, Tabular):
    """The averaged field of a field with a fast phase, through `order` in epsilon, and the transformation to it.

    - `averaged_field`: F_0, F_1, ... by slow variable, X' = sum epsilon^k F_k(X) in slow time;
    - `frequency`: omega, G_1, G_2, ... with epsilon T' = omega(X) + sum epsilon^k G_k(X), one term more;
    - `transformation`: u_1, u_2, ... by slow variable and phase, x = X + sum epsilon^k u_k(X, T) and theta likewise,
      each of mean zero over the phase; the averaged variables have the names of those that they are means of;
    - `form`: the field in slow variables and phase, `form.coordinates` these in its states;
    - `scene`, where one was averaged.

    Slow variables are in error by O(epsilon^(order + 1)) over times of order 1, from a base point through the order,
    where the rates are smooth: across a jump in a slow variable by O(epsilon), as the transformation jumps there.
    """

    system: SlowFastSystem | VectorField
    form: PhaseForm
    order: int
    averaged_field: tuple[Values, ...]
    frequency: tuple[sp.Expr, ...]
    transformation: tuple[Values, ...]
    scene: Scene | None = None

    def averaged(self, order: int | None = None) -> VectorField:
        """The averaged field through `order`, in the slow variables alone."""
        return self._field(self._rates(self._through(order)), {})

    def with_phase(self, order: int | None = None) -> VectorField:
        """The averaged field with the phase, which turns at (omega + sum epsilon^k G_k)/epsilon, k to `order` + 1.

        Its observables are the slow variables and the phase before they are averaged, under the names `named_in_full`.
        """
        n = self._through(order)
        epsilon = self.epsilon
        turning = sp.Add(*[g * epsilon ** (k - 1) for k, g in enumerate(self.frequency[: n + 2])])
        full = dict(zip(self.named_in_full.values(), self._full(n)))
        return self._field({**self._rates(n), self.form.phase: turning}, full)

    def restored(self, run: Trajectory) -> dict[str, np.ndarray]:
        """The states of the system, arrays (m,) by name, along a run of `with_phase`."""
        check_noun(run, Trajectory, verb="restored")
        points = np.stack([run[symbol.name] for symbol in self.named_in_full.values()], axis=1)
        constants = parameter_vector(self.system, 1.0)
        code = compile_over(self.system, list(self.form.inverse.values()), arguments=self._variables)
        return {z.name: values for z, values in zip(self.form.inverse, code(points, constants).T)}

    @cached_property
    def watched(self) -> VectorField:
        """The system, with its slow variables among the observables under the names that `with_phase` gives them."""
        old = self.system
        new = {self.named_in_full[x]: self.form.coordinates[x] for x in self.form.rates}
        return VectorField(
            dict(zip(old.states, old.rates)),
            epsilon=old.epsilon,
            parameters=old.parameters,
            name=old.name,
            observables={**old.observables, **new},
        )

    @cached_property
    def named_in_full(self) -> Mapping[sp.Symbol, sp.Symbol]:
        """What each slow variable, and the phase, is called before it is averaged: r_full and so on."""
        free = names_of(self.system)
        for symbol in self._variables:
            free(symbol.name)
        return read_only({x: sp.Symbol(free(f"{x}_full")) for x in self._variables})

    @property
    def epsilon(self) -> sp.Symbol:
        """The small parameter."""
        assert self.system.epsilon is not None
        return self.system.epsilon

    def base_point(self, start: Point, *, epsilon: float, order: int | None = None) -> dict[str, float]:
        """The averaged variables and phase, by name, of a point of the system, through `order` in epsilon.

        Raises `GspError` where epsilon is too large for the transformation to be inverted by iteration.
        """
        check_epsilon(epsilon)
        raw = np.array(complete(start, self.system.states, what="start"))
        p = parameter_vector(self.system, epsilon)
        point = compile_over(self.system, list(self.form.coordinates.values()))(raw, p)
        names = [symbol.name for symbol in self.form.coordinates]
        image = compile_over(self.system, self._full(self._through(order)), arguments=self._variables)
        known = np.array([point[names.index(s.name)] for s in self._variables])
        sizes = compile_over(self.system, self._reach(self._through(order)), arguments=self._variables)(
            known, p
        )
        found, last = known, np.inf
        # A contraction for small epsilon, whose steps fall until they are rounding.
        while True:
            moved = found + known - image(found, p)
            steps = np.abs(moved - found)
            step = float(np.divide(steps, sizes, out=steps, where=sizes > 0.0).max())
            if not step < last / 2:
                break
            found, last = moved, step
        if not last <= np.sqrt(np.finfo(float).eps):
            raise GspError(
                f"the transformation to averaged variables could not be inverted at {self.epsilon} = {epsilon:g}.",
                "Take a smaller epsilon or a lower order, or a start away from where the transformation is singular.",
            )
        return {s.name: float(v) for s, v in zip(self._variables, found)}

    def as_dict(self) -> dict[str, object]:
        """Coordinates, averaged field, frequency and transformation, as plain values."""
        rows = {"averaged_field": self.averaged_field, "transformation": self.transformation}
        return {
            "phase": self.form.phase.name,
            "order": self.order,
            "coordinates": {s.name: str(e) for s, e in self.form.coordinates.items()},
            **{name: [{s.name: str(e) for s, e in row.items()} for row in part] for name, part in rows.items()},
            "frequency": [str(g) for g in self.frequency],
        }

    def __repr__(self) -> str:
        slow = ", ".join(s.name for s in self.form.rates)
        return f"Averaging({slow} over the phase {self.form.phase}, through order {self.order})"

    def __str__(self) -> str:
        epsilon, phase = self.epsilon, self.form.phase
        lines = [f"averaged over the phase {phase}, through order {self.order} in {epsilon}"]
        lines += [f"  {s} = {e}, a new coordinate" for s, e in self.form.coordinates.items() if s != e]
        for s in self.form.rates:
            lines.append(f"  {s}' = {_series([row[s] for row in self.averaged_field], epsilon)}")
        lines.append(f"  {epsilon} {phase}' = {_series(self.frequency, epsilon)}")
        for s, first in self.transformation[0].items() if self.transformation else ():
            if first != 0:
                lines.append(f"  {s} before averaging = {s} + {_series([sp.Integer(0), first], epsilon)}")
        return "\n".join(lines)

    @property
    def _variables(self) -> tuple[sp.Symbol, ...]:
        return (*self.form.rates, self.form.phase)

    def _through(self, order: int | None) -> int:
        if order is not None and check_order(order) > self.order:
            raise DeclarationError(
                f"the averaged field is known through order {self.order}.",
                "Give average() a higher order.",
                got=order,
            )
        return self.order if order is None else order

    def _rates(self, order: int) -> dict[sp.Symbol, sp.Expr]:
        powers = [self.epsilon**k for k in range(order + 1)]
        return {
            s: sp.Add(*[e * row[s] for e, row in zip(powers, self.averaged_field)]) for s in self.form.rates
        }

    def _field(self, rates: Values, observables: Values) -> VectorField:
        held = any(rate.has(self.epsilon) for rate in rates.values())
        return VectorField(
            rates,
            epsilon=self.epsilon if held else None,
            parameters=self.system.parameters,
            name=self.system.name,
            observables=observables,
        )

    def _full(self, order: int) -> list[sp.Expr]:
        """x + sum epsilon^k u_k of each slow variable, and of the phase."""
        powers = [self.epsilon ** (k + 1) for k in range(order)]
        return [
            sp.Add(s, *[e * row[s] for e, row in zip(powers, self.transformation)]) for s in self._variables
        ]

    def _reach(self, order: int) -> list[sp.Expr]:
        """|x| of each slow variable, 1 of the phase, and as far as each is moved with every sine and cosine at 1."""
        sizes = {**{x: size(x) for x in self.form.rates}, self.form.phase: sp.S.One}
        for k, row in enumerate(self.transformation[:order]):
            for s, moved in row.items():
                waves = {f: sp.S.One for f in moved.atoms(sp.sin, sp.cos) if f.has(self.form.phase)}
                widths = [size(term.xreplace(waves)) for term in sp.Add.make_args(moved)]
                sizes[s] += self.epsilon ** (k + 1) * sp.Add(*widths)
        return [sizes[s] for s in self._variables]


def _series(coefficients: Sequence[sp.Expr], epsilon: sp.Symbol) -> str:
    terms = []
    for k, c in enumerate(coefficients):
        if c != 0:
            told = brief(c)
            plain = not c.is_Add and not c.could_extract_minus_sign()
            terms.append(told if k == 0 else f"{epsilon**k}*{told if plain else f'({told})'}")
    return " + ".join([*(terms or ["0"]), "..."])


def average(
    system: SlowFastSystem | VectorField | Scene,
    *,
    phase: str | sp.Symbol | None = None,
    pair: Sequence[str | sp.Symbol] | None = None,
    region: Mapping[str, Interval] | None = None,
    order: int = 3,
    symbolic: bool = True,
) -> Averaging:
    """Average a system over its fast phase, through `order` in epsilon.

    `phase` names the state that turns, theta' = omega(x)/epsilon + ..., or `pair` the two that turn about one another,
    as position and velocity of a weakly nonlinear oscillator do: in place of these come amplitude and phase. With both,
    the pair is taken in the frame of the phase, near whose rate it turns. A `Scene` that has a phase says it itself. A
    field in fast time, x' = epsilon f and theta' = omega, is first divided by epsilon.
    Where omega depends on the state, `region` bounds it, {name: (low, high)}, and omega must be nowhere 0 over it.

    The rates are polynomials in sine and cosine of the phase, with coefficients of any kind in the slow variables.
    Rates of order 1/epsilon with mean zero are vibrations, and are taken off first. Parameters stay symbols unless
    `symbolic` is False, which puts their values in first. Raises `SplittingError` for what is no fast phase, and
    `UnsupportedFunctionError` for what has no finite Fourier series, both by name.

    >>> u, v, eps = sp.symbols("u v epsilon")
    >>> field = VectorField({u: v/eps, v: -u/eps + (1 - u**2)*v}, epsilon=eps)
    >>> average(field, pair=(u, v), order=1).averaged_field[0]
    mappingproxy({r: -r*(r - 2)*(r + 2)/8})
    """
    check_noun(system, (SlowFastSystem, VectorField, Scene), verb="average")
    check_order(order)
    check_flag(symbolic, what="symbolic")
    scene = system if isinstance(system, Scene) else None
    if isinstance(system, Scene):
        if phase is None and pair is None and system.phase is not None:
            phase, pair = system.phase.name or None, system.phase.pair
        bounds = system.region if region is None else region
        system = system.system
    else:
        bounds = {} if region is None else region
    turns = None if phase is None else _state(system, phase, "phase")
    two = None if pair is None else _pair(system, pair)
    if turns is None and two is None:
        raise DeclarationError(
            "nothing says what turns.",
            'Name the state that is the phase, phase="theta", or the two that turn about one another, pair=("u", "v"); '
            "on the command line --phase theta or --pair u,v.",
        )
    if turns is not None and two is not None and turns in two:
        raise DeclarationError(f"{turns} is the phase and one of the pair.", "Name three different states.")
    small = system.epsilon
    if isinstance(system, VectorField) and small is not None and is_in_fast_time(system):
        faster = divided(system)
        # Else what moves beside the phase is as fast as the phase.
        if not any(
            divides(faster.equations[z], small) for z in faster.states if z not in (turns, *(two or ()))
        ):
            system, scene = faster, None if scene is None else in_slow_time(scene)
    bounds = (
        {}
        if isinstance(bounds, Mapping) and not bounds
        else check_region(bounds, [s.name for s in system.states])
    )
    for rate in system.rates:
        if system.epsilon is not None and (wrong := misplaced_epsilon(rate, system.epsilon)) is not None:
            raise SplittingError(
                f"{system.epsilon} stands in {wrong}, which is no pole or power of {system.epsilon}.",
                f"Replace it by its Taylor polynomial in {system.epsilon}.",
            )
    known = centres(system.rates, system.states) if symbolic else system.centres
    # A pair turns about its centre, and expanded about the origin a rate loses digits.
    here = {z: c for z, c in known.items() if z != turns}
    with met_at(f"about {system.place(here)}") if here else nullcontext():
        own = phase_form(system.about(here), turns, two)
    form, there = own.back_from(here)
    require_turning(form.omega, form.phase, region=bounds, parameters=system.parameters)
    if not form.rates:
        raise SplittingError(
            f"the phase {form.phase} is all that there is, and nothing moves slowly.",
            "There is nothing to average.",
        )
    assert system.epsilon is not None
    found = NearIdentity(
        own,
        epsilon=system.epsilon,
        constants=list(system.parameters) if symbolic else [],
        values={} if symbolic else system.parameters,
        order=order,
    )

    def back(rows: Sequence[Values]) -> tuple[Values, ...]:
        return tuple(read_only({s: e.xreplace(there) for s, e in row.items()}) for row in rows)

    frequency = tuple(g.xreplace(there) for g in found.frequency)
    return Averaging(
        system, form, order, back(found.averaged_field), frequency, back(found.transformation), scene
    )


def _state(system: SlowFastSystem | VectorField, given: object, what: str) -> sp.Symbol:
    known = {s.name: s for s in system.states}
    name = given.name if isinstance(given, sp.Symbol) else given
    if not isinstance(name, str) or name not in known:
        raise DeclarationError.none_of(
            known, name, f"{what} names {shown(given)}, which is no state.", "They are"
        )
    return known[name]


def _pair(system: SlowFastSystem | VectorField, given: object) -> tuple[sp.Symbol, sp.Symbol]:
    names = check_each(given, lambda one: _state(system, one, "pair"), what="pair", be="two states")
    if len(set(names)) != 2 or len(names) != 2:
        raise DeclarationError("pair is two different states.", 'Give pair=("u", "v").', got=shown(given))
    return names[0], names[1]
