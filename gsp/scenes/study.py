"""A study: a scene made ready, each stage of the theory computed once and kept.

From the splitting to the reduced flows every stage rests on those before it. Verbs hand the study on, so that nothing
is made twice; what depends on epsilon is kept by its value, and everything else serves a scene asked about at another
epsilon or tolerance too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import CriticalManifold, solve_critical
from gsp.errors import BudgetError, SplittingError
from gsp.fibres.base_points import BasePoint, base_point_of
from gsp.fibres.inner_expansion import InnerExpansion, expand_inner
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, classify
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.results.card import Card
from gsp.scenes.image import image_of
from gsp.scenes.scaled import take_scaling
from gsp.scenes.scene import Scene
from gsp.scenes.sheet import sheet_of
from gsp.scenes.slow_time import has_slow_time, in_slow_time
from gsp.scenes.small_parameter import no_small_parameter
from gsp.scenes.switched import in_fast_variables
from gsp.slow.expansion import Expansion
from gsp.slow.run_series import run_series
from gsp.slow.series import LONGEST, SeriesManifold, length, series_of
from gsp.splitting.scaling import Scaling
from gsp.splitting.splitting import NON_STANDARD, Splitting, has_higher_pole, split
from gsp.splitting.switches import Switch, has_switches
from gsp.systems.arguments import check_noun
from gsp.systems.flow import check_epsilon, check_order
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem, VectorField
from gsp.systems.tolerances import absolute_tolerance

# Full runs that are kept: far below the width of a line.
RTOL = 1e-8

T = TypeVar("T")


class _Kept:
    """Values by key, each made once, with the seconds that each took without those it rests on."""

    def __init__(self) -> None:
        self.values: dict[tuple[Hashable, ...], object] = {}
        self.seconds: dict[tuple[Hashable, ...], float] = {}
        self._inner = 0.0

    def once(self, key: tuple[Hashable, ...], make: Callable[[], T]) -> T:
        if key not in self.values:
            outer, self._inner = self._inner, 0.0
            begun = time.perf_counter()
            try:
                self.values[key] = make()
            finally:
                spent = time.perf_counter() - begun
                self.seconds[key] = spent - self._inner
                self._inner = outer + spent
        return self.values[key]  # pyright: ignore[reportReturnType]


@dataclass(frozen=True, eq=False, repr=False)
class Study(Card):
    """A scene made ready: its stages are computed when they are first read, and kept.

    `splitting` is None when the scene is declared in standard form. `start` and `region` are those of the scene in the
    coordinates of `system`; `branch` is the one to which the start belongs, its sheet fixed. Reading a
    stage raises what the stage raises: `SplittingError` where the field stays non-standard, `BranchError` where no
    branch passes, `DeclarationError` when the region does not bound every raw state that a slow coordinate is made of.
    A scene whose field has switches phi(s/epsilon) is kept in the variables in which they are fast, and `switches` says
    which these are. One whose field has a pole of higher order is kept in scaled variables, and `scaling` says which.
    One whose field has no pole is in fast time: it is kept in slow time, and `given` is the scene as it was.
    `measured` are errors of its reduced flows by order, where they were measured against a full run from the start, and
    `is_stiff` is whether these flows have fast modes of their own, and are run as stiff ones.

    >>> from gsp import models, study
    >>> michaelis = study(models.load("michaelis_menten"))
    >>> michaelis.series(1).coefficients[0]
    (s/(kappa + s),)
    """

    scene: Scene
    switches: tuple[Switch, ...] = ()
    scaling: Scaling | None = None
    given: Scene | None = None
    measured: Mapping[int, float] = field(default_factory=dict)
    is_stiff: bool = False
    _kept: _Kept = field(default_factory=_Kept)

    @property
    def splitting(self) -> Splitting | None:
        """How the field was split into slow and fast, None when it was declared so."""
        return self._once(("splitting",), self._split)

    @property
    def system(self) -> SlowFastSystem:
        """The system in standard form."""
        if isinstance(self.scene.system, SlowFastSystem):
            return self.scene.system
        splitting = self.splitting
        assert splitting is not None
        assert splitting.system is not None
        return splitting.system

    @property
    def start(self) -> Mapping[str, float]:
        """The scene's start in slow and fast variables."""
        return self._once(("start",), self._start)

    @property
    def region(self) -> Mapping[str, Interval]:
        """The scene's region in slow and fast variables."""
        return self._once(("region",), self._region)

    @property
    def critical(self) -> CriticalManifold:
        """The critical manifold, all branches of it."""
        return self._once(("critical",), lambda: solve_critical(self.system))

    @property
    def branch(self) -> Branch:
        """The branch nearest to the start within the region's bounds on fast variables, its sheet fixed.

        Where the start lies off it, and its layer settles on another within these bounds, it is that one.
        """
        return self._once(
            ("branch",), lambda: sheet_of(self.critical, self.start, self.region, off=self.scene.epsilons[0])
        )

    @property
    def hyperbolicity(self) -> Hyperbolicity:
        """The verdict over the region, with the conditions at the scene's epsilon."""
        epsilon = self.scene.epsilon
        return self._once(("hyperbolicity", epsilon), lambda: self._verdict(epsilon))

    def _verdict(self, epsilon: float) -> Hyperbolicity:
        found = classify(self.branch, region=self.region, epsilon=epsilon)
        if self.scene.contacts is None:
            return found
        return replace(found, losses=tuple(replace(loss, kind=loss.kind.of_contact) for loss in found.losses))

    def series(self, order: int, *, symbolic: bool = True) -> SeriesManifold:
        """The slow manifold through `order` as `expand` gives it; one expansion grows with the orders asked for."""
        check_order(order)
        kind = "series" if symbolic else "numeric series"

        def expansion() -> Expansion:
            return self._expansion if symbolic else self._expansion.numeric

        return self._once((kind, order), lambda: series_of(expansion(), order))

    def series_within_budget(self, order: int, *, symbolic: bool = False) -> tuple[SeriesManifold, str]:
        """The series through `order` or as far as the budget of the exact algebra goes, the parameters' values put in
        unless `symbolic`, and why no further, as a sentence; empty where it is all there.

        Raises `BudgetError` where no order is within the budget.
        """
        try:
            return self.series(order, symbolic=symbolic), ""
        except BudgetError:
            last, why = (self._expansion if symbolic else self._expansion.numeric).end
            if last is None:
                raise
            return self.series(last, symbolic=symbolic), f"The series ends at order {last}: {why}."

    def run_series(self, order: int) -> SeriesManifold:
        """The series through `order` with the parameters' values in, as it is run: as straight-line programs where its
        polynomials have more than `LONGEST` terms, and more than the programs have steps.

        Raises `BudgetError` where neither is within its budget.
        """
        check_order(order)

        def make() -> SeriesManifold:
            return run_series(self._expansion, order, lambda k: self.series(k, symbolic=False))

        return self._once(("run series", order), make)

    def run_within_budget(self, order: int) -> tuple[SeriesManifold, str]:
        """`run_series` through `order` or as far as the budget goes, and why no further; see `series_within_budget`."""
        try:
            return self.run_series(order), ""
        except BudgetError:
            last, why = self._expansion.numeric.programs.end
            if last is None:
                raise
            return self.run_series(last), f"The series ends at order {last}: {why}."

    def why_shorter(self, order: int) -> str:
        """Why the series is not run through `order`, as a sentence; empty where it is."""
        short = self.short_series(order).order
        if short == order:
            return ""
        longer, ending = self.run_within_budget(short + 1)
        return ending or (
            f"The series is run through order {short} only: at order {short + 1} it has coefficients of "
            f"{length(longer)}, more than {LONGEST}."
        )

    def short_series(self, order: int, *, at_least: int = 0) -> SeriesManifold:
        """The series as it is run, through `order` or as far as its coefficients are short enough for that,
        `LONGEST` terms or steps each; `at_least` so far whatever their length.
        """
        series = self.run_series(at_least)
        for further in range(at_least + 1, order + 1):
            try:
                longer = self.run_series(further)
            except BudgetError:
                break
            if max(longer.sizes) > LONGEST:
                break
            series = longer
        return series

    def reduced(self, order: int, *, reconstructed: bool = True) -> ReducedFlow:
        """The reduced flow of `order`, with what the scene reconstructs unless told not to."""
        driven = self.scene.reconstruction if reconstructed else {}
        return self._once(
            ("reduced", order, bool(driven), self.is_stiff),
            lambda: replace(
                restrict(self.run_series(order), order=order, reconstruction=driven), is_stiff=self.is_stiff
            ),
        )

    def full(self, epsilon: float) -> Trajectory:
        """The full run from the scene's start over its span, reconstruction included, to the width of a line."""
        value = check_epsilon(epsilon)
        scene = self.scene
        return self._once(
            ("full", value),
            lambda: trajectory_of(
                scene.full_flow,
                start=scene.full_start,
                span=scene.span,
                epsilon=value,
                rtol=RTOL,
                atol=absolute_tolerance(RTOL, scene.region, scene.full_start),
            ),
        )

    def inner(self, order: int) -> InnerExpansion:
        """The initial layer from the start through `order`, its fast part through one order less."""

        def make() -> InnerExpansion:
            return expand_inner(
                self.branch,
                {**self.start, **self.scene.reconstruction_start},
                order=order,
                fast_order=max(order - 1, 0),
                reconstruction=self.scene.reconstruction,
            )

        return self._once(("inner", order), make)

    def base_point(self, order: int) -> BasePoint:
        """The base point through epsilon^order of the fast fibre through the start, at the scene's epsilon."""
        check_order(order)
        epsilon = self.scene.epsilon
        return self._once(
            ("base point", order, epsilon), lambda: base_point_of(self.inner(order + 2), epsilon, order)
        )

    def slow_start(self, order: int) -> dict[str, float]:
        """Where a reduced flow of `order` without reconstruction begins: the slow variables at `base_point`."""
        base = self.base_point(order)
        return {x.name: base[x.name] for x in self.system.x}

    def spent(self, *key: Hashable) -> float:
        """Seconds that the stages took whose key begins so, without those they rest on."""
        return sum(s for k, s in self._kept.seconds.items() if k[: len(key)] == key)

    def asking(self, *, epsilon: float | None = None, tolerance: float | None = None) -> Study:
        """The study of the same scene at another epsilon or tolerance; what does not depend on them is shared."""
        scene = self.scene
        if epsilon is None and tolerance is None:
            return self
        settings = {
            "epsilon": scene.epsilon if epsilon is None else epsilon,
            "tolerance": scene.tolerance if tolerance is None else tolerance,
        }
        given = None if self.given is None else replace(self.given, **settings)
        asked = replace(scene, **settings) if given is None else in_slow_time(given)
        return replace(self, scene=asked, given=given, measured=self.measured if epsilon is None else {})

    def __repr__(self) -> str:
        return f"Study({self.scene.name or self.scene.system.name or 'unnamed'}: {self._made()})"

    def __str__(self) -> str:
        lines = [repr(self)]
        for key, value in self._kept.values.items():
            name = " ".join(map(str, key[:2] if key[0] != "hyperbolicity" else key[:1]))
            if value is not None and key[0] not in ("start", "region", "expansion"):
                lines.append(f"  {name:<18} {value!r}")
        return "\n".join(lines)

    def _made(self) -> str:
        stages = dict.fromkeys(str(key[0]) for key in self._kept.values if key[0] != "expansion")
        return ", ".join(stages) if stages else "nothing computed yet"

    @property
    def _expansion(self) -> Expansion:
        return self._once(("expansion",), lambda: Expansion(self.branch))

    # What is not finite is looked at by every stage, and not warned of.
    @np.errstate(all="ignore")
    def _once(self, key: tuple[Hashable, ...], make: Callable[[], T]) -> T:
        return self._kept.once(key, make)

    def _split(self) -> Splitting | None:
        scene = self.scene
        if isinstance(scene.system, SlowFastSystem):
            return None
        if not scene.has_small:
            raise no_small_parameter(scene, "to split it takes one")
        splitting = replace(split(scene.system), switches=self.switches, scaling=self.scaling)
        if splitting.system is None:
            raise SplittingError(
                f"the field of {scene.name or 'this scene'} has no standard form. {NON_STANDARD}.",
                "Declare it in slow and fast variables, or use split(field).reduced_field for the leading order.",
            )
        return splitting

    def _start(self) -> Mapping[str, float]:
        splitting, start = self.splitting, self.scene.start
        return MappingProxyType(dict(start) if splitting is None else splitting.to_new(start))

    def _region(self) -> Mapping[str, Interval]:
        scene, splitting = self.scene, self.splitting
        return (
            MappingProxyType(dict(scene.region))
            if splitting is None
            else image_of(scene, splitting, self.system)
        )


def study(scene: Scene) -> Study:
    """The scene made ready: every stage is computed when it is first needed, and kept.

    Raises `DeclarationError` for anything but a `Scene`, and `SplittingError` for one without a small parameter; a
    study is handed back as it is.
    """
    return study_of(scene, verb="study")


def study_of(scene: Scene | Study, *, verb: str = "study") -> Study:
    """What a verb works with: the study it was given, or a new one of the scene it was given.

    Raises `SplittingError` for a scene without a small parameter.
    """
    if isinstance(scene, Study):
        return scene
    check_noun(scene, Scene, verb=verb)
    if not scene.has_small:
        raise no_small_parameter(scene, f"{verb} needs one")
    if isinstance(scene.system, VectorField) and has_switches(scene.system):
        return Study(*in_fast_variables(scene))
    if isinstance(scene.system, VectorField) and has_higher_pole(scene.system):
        scaling = split(scene.system).scaling
        assert scaling is not None
        return Study(take_scaling(scene, scaling=scaling), scaling=scaling)
    if has_slow_time(scene.system):
        return Study(in_slow_time(scene), given=scene)
    return Study(scene)
