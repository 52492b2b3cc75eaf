"""`certify` of a singular orbit: a relaxation cycle for every epsilon in (0, epsilon_0], by an annulus.

The theorems and their proofs are in docs/proofs.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gsp.algebra.precision import precision
from gsp.cycles.annulus import Annulus
from gsp.cycles.axis_cycle import CircuitSearch, ProvedCircuit
from gsp.cycles.band_search import RESOLUTION, BandSearch, EpsilonSearch
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.outline import Frame, NoOutline, Outliner, frames_of
from gsp.cycles.proof_up_to import ProofUpTo
from gsp.cycles.sectors import Turn
from gsp.errors import DeclarationError
from gsp.proofs import balls
from gsp.proofs.search_progress import SearchProgress
from gsp.proofs.sides import written
from gsp.proofs.verdict import ProofVerdict
from gsp.results.bounds import at_least, at_most, outside
from gsp.singular.singular_orbit import SingularOrbit
from gsp.systems.arguments import check_progress
from gsp.systems.flow import check_epsilon


@dataclass(frozen=True, eq=False, repr=False)
class ProvedAnnulus:
    """An annulus about a cycle for every epsilon in (0, `epsilon`], and what is proved of closed orbits in it."""

    annulus: Annulus
    epsilon: float
    turn: Turn
    fineness: int

    @property
    def is_unique(self) -> bool:
        """Whether there is one closed orbit in it only, which attracts."""
        return self.turn.contraction < 0.0

    @property
    def where(self) -> str:
        """What the closed orbit lies in."""
        return f"an annulus, of {len(self.annulus.outer)} and {len(self.annulus.inner)} vertices"

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON."""
        return {"vertices": [len(self.annulus.outer), len(self.annulus.inner)]}

    @property
    def amplitude(self) -> tuple[tuple[tuple[float, float], tuple[float, float]], ...]:
        """For the slow variable and for the fast one: in which intervals its least and its largest value lie."""
        outer, inner = self.annulus.outer, self.annulus.inner
        ends = zip(outer.min(axis=0), inner.min(axis=0), inner.max(axis=0), outer.max(axis=0))
        return tuple(((float(a), float(b)), (float(c), float(d))) for a, b, c, d in ends)


@dataclass(frozen=True, eq=False, repr=False)
class CycleCertificate(ProofUpTo):
    """What is proved about closed orbits near a singular `orbit`.

    - PROVED: for every epsilon in (0, `epsilon_0`] a closed orbit lies in the annulus of `existence`. For every
      epsilon in (0, `epsilon_1`] the annulus of `uniqueness` has only one, and it attracts all of that annulus;
      `epsilon_1` is 0, and `uniqueness` None, where this is not proved.
    - UNDECIDED: no annulus was found. `reason` says why; it does not say that there is no cycle.
    """

    orbit: SingularOrbit
    verdict: ProofVerdict
    reason: str
    existence: ProvedAnnulus | ProvedCircuit | None = None
    uniqueness: ProvedAnnulus | ProvedCircuit | None = None

    @property
    def epsilon_0(self) -> float:
        """A cycle exists for every epsilon up to this; 0 where nothing is proved."""
        return self.existence.epsilon if self.existence else 0.0

    @property
    def epsilon_1(self) -> float:
        """It is the only one in its annulus, and attracts, for every epsilon up to this; 0 where that is not proved."""
        return self.uniqueness.epsilon if self.uniqueness else 0.0

    @cached_property
    def _names(self) -> tuple[str, str]:
        (x,), (y,) = self.orbit.branch.system.x, self.orbit.branch.system.y
        return x.name, y.name

    @property
    def _annuli(self) -> dict[str, ProvedAnnulus | ProvedCircuit]:
        found = {"existence": self.existence, "uniqueness": self.uniqueness}
        return {name: one for name, one in found.items() if one is not None}

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON."""
        plain: dict[str, object] = {
            "verdict": self.verdict.value,
            "reason": self.reason,
            "epsilon_0": self.epsilon_0,
            "epsilon_1": self.epsilon_1,
        }
        for name, one in self._annuli.items():
            plain[name] = {
                "epsilon": one.epsilon,
                "period": list(one.turn.period),
                "amplitude": {n: [list(end) for end in ends] for n, ends in zip(self._names, one.amplitude)},
                **one.as_dict(),
            }
        if self.uniqueness is not None:
            plain["contraction"] = self.uniqueness.turn.contraction
        return plain

    def _plain(self) -> dict[str, Any]:
        from gsp.cycles.cycle_file import plain

        return plain(self)

    def __str__(self) -> str:
        small = self.orbit.branch.system.epsilon.name
        lines = [f"{self.verdict.value}: {self.reason}"]
        for name, one in self._annuli.items():
            up_to = f"for every {small} in (0, {at_least(one.epsilon)}]"
            if name == "existence":
                lines.append(f"  {up_to} a closed orbit lies in {one.where}")
            else:
                lines.append(f"  {up_to} only one lies in {one.where}, and attracts:")
                lines.append(
                    f"    in a turn small deviations shrink by exp({at_most(one.turn.contraction, 4)}/{small}) at least"
                )
            lines.append(f"    its period is from {' to '.join(outside(*one.turn.period))}")
            for variable, (low, high) in zip(self._names, one.amplitude):
                lines.append(
                    f"    {variable} goes down to between {' and '.join(outside(*low))}, "
                    f"up to between {' and '.join(outside(*high))}"
                )
        return "\n".join(lines)


def certify_cycle(
    orbit: SingularOrbit,
    *,
    epsilon: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> CycleCertificate:
    """Prove that a relaxation cycle exists, and that it is unique, near a singular `orbit` of a planar system.

    It is proved for every epsilon in (0, `epsilon`], or up to the largest ones that are found. `progress` is called
    with the share of the search that is done.

    Raises `DeclarationError` unless there are one slow and one fast variable, `UnsupportedFunctionError` for a
    function without an enclosure.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps)
    >>> orbit = singular_orbit(solve_critical(system).branches[0], {"x": 2, "y": 0.6})
    >>> found = certify_cycle(orbit)
    >>> found.verdict.name, found.epsilon_0 > 0.5, found.epsilon_1 > 0.1
    ('PROVED', True, True)
    """
    system = orbit.branch.system
    if len(system.x) != 1 or len(system.y) != 1:
        raise DeclarationError(
            "a cycle is proved in the plane of one slow and one fast variable.",
            "Bound periodic orbits of larger systems by runs.",
            got=f"{len(system.x)} slow and {len(system.y)} fast variables",
        )
    check_progress(progress)
    if epsilon is not None:
        _, epsilon = written(epsilon, check_epsilon(epsilon))
    try:
        search, frames = _search(orbit)
    except NoOutline as error:
        return CycleCertificate(orbit, ProofVerdict.UNDECIDED, f"no annulus was found: {error}")
    search.shown = SearchProgress(progress)
    with precision(balls.PRECISION):
        if epsilon is not None:
            found = search.within(epsilon)
            search.shown.reached(0.5)
            # What holds up to a larger epsilon holds up to this one: bounds of one band may be loose by chance.
            tried = (search.within(epsilon * RESOLUTION**k) for k in range(4 if found else 0))
            unique = next((one for one in tried if one is not None and one.is_unique), None)
        else:
            # Where the folds' delays are as long as the slow pieces.
            found, unique = _largest(search, float(min((f.sizes[0] / f.late) ** 1.5 for f in frames)))
    search.shown.reached(1.0)
    small = system.epsilon.name
    if found is None:
        reason = f"no annulus was found for {small} = {at_least(search.last)}: {search.why}"
        return CycleCertificate(orbit, ProofVerdict.UNDECIDED, reason)
    reason = f"a relaxation cycle for every {small} in (0, {at_least(found.epsilon)}]"
    return CycleCertificate(orbit, ProofVerdict.PROVED, reason, found, unique)


def _search(orbit: SingularOrbit) -> tuple[EpsilonSearch[Any], list[Frame]]:
    """Of annuli about an orbit that closes, or of circuits by an invariant sheet; raises `NoOutline`."""
    if orbit.closes:
        field, frames = EnclosedField.of(orbit.branch.system), frames_of(orbit)
        return BandSearch(field, lambda small: Outliner(field, frames, small).annulus(), ProvedAnnulus), frames
    search = CircuitSearch(orbit)
    return search, search.frames[:1]


def _largest(search: EpsilonSearch[Any], begin: float) -> tuple[Any, Any]:
    """The annuli for the largest epsilon of existence and of uniqueness that are found."""
    search.shown.part(0.0, 0.5)
    found = search.largest(begin, attracts=False)
    search.shown.part(0.5, 1.0)
    unique = search.largest(begin, attracts=True) if found else None
    # What is unique exists.
    return (unique if unique and found and unique.epsilon > found.epsilon else found), unique
