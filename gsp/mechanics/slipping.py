"""What all friction against slip has in common: a constrained system in its limit, a frame, a field and scenes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import sympy as sp

from gsp.integration.trajectory import Trajectory
from gsp.mechanics.algebra import within_budget
from gsp.mechanics.constraints import ConstrainedSystem
from gsp.mechanics.frame import MovingFrame
from gsp.mechanics.frame_starts import frame_values, new_region
from gsp.mechanics.hamel import HamelEquations, clocked, extended, split_positions
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.scenes.scene import Scene
from gsp.sliding.no_slip import Contacts
from gsp.splitting.splitting import Splitting
from gsp.systems.flow import Point, Values
from gsp.systems.region import Interval, check_region
from gsp.systems.system import SlowFastSystem, VectorField


class SlippingSystem(ABC):
    """A mechanical system with friction against the slip w = A(q) qdot + c(q), `limit` the one that cannot slip."""

    limit: ConstrainedSystem
    epsilon: sp.Symbol

    @property
    def system(self) -> LagrangianSystem:
        """The system without friction."""
        return self.limit.system

    @property
    def constraints(self) -> tuple[sp.Expr, ...]:
        """The constraints, in (q, qdot)."""
        return self.limit.constraints

    @property
    def frame(self) -> MovingFrame:
        """The moving frame: quasi-velocities u along D, slip velocities w across it."""
        return self.limit.frame

    @property
    def quasi_velocities(self) -> Values:
        """u and w in terms of (q, qdot)."""
        return MappingProxyType(self.frame.expressions(self.system.velocities))

    @property
    def velocities(self) -> Values:
        """qdot in terms of (q, u, w)."""
        return self._equations.raw_velocities()

    @cached_property
    def field(self) -> VectorField:
        """q', u', w' for the positions that matter, time last; the poles are those of the friction."""
        matter, _, rates = self._split
        return clocked(self.system, matter, rates, epsilon=self.epsilon)

    @cached_property
    def reconstruction(self) -> Values:
        """Rates, in (u, w), of the positions that no other rate depends on."""
        return MappingProxyType(self._split[1])

    @property
    def full_field(self) -> VectorField:
        """`field` with the reconstruction variables behind its states."""
        return extended(self.field, self.reconstruction)

    @property
    @abstractmethod
    def splitting(self) -> Splitting:
        """Slow and fast variables."""

    @property
    def standard_form(self) -> SlowFastSystem:
        """`splitting.system`."""
        system = self.splitting.system
        assert system is not None
        return system

    @property
    @abstractmethod
    def has_constant_fibres(self) -> bool:
        """Whether `gsp.split` finds the slow variables of `field` by itself."""

    def constraint_residual(self, trajectory: Trajectory) -> np.ndarray:
        """w = A qdot + c (k, m) along a trajectory of `field`, `full_field` or `standard_form`."""
        return np.stack([trajectory[w] for w in self.frame.across])

    # -- a question about it -----------------------------------------------------------------------

    def scene(
        self,
        *,
        region: Mapping[str, Interval] | Mapping[sp.Symbol, Interval],
        start: Point,
        span: Interval,
        epsilon: float,
        epsilons: Iterable[float] | None = None,
        tolerance: float = 1e-6,
        path: tuple[str, str] | None = None,
        name: str = "",
        title: str = "",
        source: str = "",
        description: str = "",
        claims: Mapping[str, Values] | None = None,
        observables: Values | None = None,
    ) -> Scene:
        """A scene about this system, positions that nothing depends on as its reconstruction.

        `start` gives raw velocities, or quasi-velocities, and positions; reconstructed positions start at 0
        unless given. `region` bounds states of `field`. The scene is about `field` where `gsp.split` splits it,
        else about `standard_form`, with the region's image, the other quasi-velocities among its
        observables. `observables` are further ones in the states of `field`, as `{H: system.energy()}`. Without a
        `description` the scene says what its velocities and momenta are. Raises `DeclarationError` where a damping that
        depends on positions is not positive definite in the region.
        """
        states, positions = frame_values(self.system, self.frame, self.field, self.reconstruction, start)
        field = self.field
        system: VectorField | SlowFastSystem = VectorField(
            field.equations,
            epsilon=self.epsilon,
            parameters=field.parameters,
            name=field.name,
            observables=observables,
        )
        box: Mapping = region
        reconstruction, new = dict(self.reconstruction), {}
        if not self.has_constant_fibres:
            bounds = check_region(region, [s.name for s in (*self.field.states, *self.standard_form.states)])
            inverse = dict(self.splitting.inverse)
            given = {s: _put(e, inverse) for s, e in system.observables.items()}
            standard = self.standard_form
            system = replace(standard, observables={**standard.observables, **given})
            box = new_region(self.splitting, bounds)
            states, new = self.splitting.to_new(states), self.splitting.coordinates
            reconstruction = {q: _put(rate, inverse) for q, rate in reconstruction.items()}
        scene = Scene(
            system,
            box,
            states,
            span,
            epsilon,
            cast("tuple[float, ...]", epsilons),
            tolerance,
            name=name,
            title=title,
            source=source,
            description=description or _told({**new, **self.quasi_velocities}),
            reconstruction=reconstruction,
            reconstruction_start=positions,
            path=path,
            claims=claims or {},
            contacts=self.bearing,
        )
        self._check_over(scene)
        return scene

    @property
    def bearing(self) -> Contacts | None:
        """What contacts bear along runs of `limit`, which scenes carry; None for viscous friction."""
        return None

    # -- parts -------------------------------------------------------------------------------------

    @property
    def _equations(self) -> HamelEquations:
        return self.limit.hamel

    @cached_property
    def _drift(self) -> list[sp.Expr]:
        """eta' without constraint force and friction."""
        return self._equations.written(self._equations.force)

    @cached_property
    @within_budget()
    def _split(self) -> tuple[dict, dict, dict]:
        rates, others = self._rates()
        equations = self._equations
        positions = {q: equations.algebra.write(e) for q, e in equations.positions().items()}
        matter, driven = split_positions(positions, [*rates.values(), *others], self.system.clock)
        return matter, driven, rates

    @abstractmethod
    def _rates(self) -> tuple[dict[sp.Symbol, sp.Expr], list[sp.Expr]]:
        """u' and w', and further expressions whose positions matter."""

    @abstractmethod
    def _check_over(self, scene: Scene) -> None:
        """Raise `DeclarationError` where the friction is none at a place of the scene's region."""

    def __str__(self) -> str:
        lines = [str(self.field)]
        lines += [f"  {u} = {e}" for u, e in self.quasi_velocities.items()]
        lines += [f"  {q}' = {rate}" for q, rate in self.reconstruction.items()]
        return "\n".join(lines)


def _told(values: Mapping[sp.Symbol, sp.Expr]) -> str:
    """What the symbols are that are no names for themselves."""
    return "; ".join(f"{symbol} = {e}" for symbol, e in values.items() if symbol != e)


def _put(expression: Any, values: Mapping[sp.Symbol, sp.Expr]) -> Any:
    return expression.xreplace(values)
