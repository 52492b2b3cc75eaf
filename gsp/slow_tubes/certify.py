"""`certify`: of a branch its normal hyperbolicity, of a series or a solved manifold a tube about a slow manifold, of a
singular orbit a relaxation cycle, of a loss of hyperbolicity how orbits pass it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import overload

from gsp.critical.branch import Branch
from gsp.cycles.cycle_certificate import CycleCertificate, certify_cycle
from gsp.cycles.passage_certificate import PassageCertificate, certify_passage
from gsp.errors import DeclarationError
from gsp.proofs.certificate import Certificate
from gsp.proofs.certification import MOST_BOXES, certify_branch
from gsp.singular.passage.delayed_exit import DelayedExit
from gsp.singular.passage.fold_passage import FoldPassage
from gsp.singular.singular_orbit import SingularOrbit
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import SeriesManifold
from gsp.slow_tubes.slow_tube import SlowTube, certify_tube
from gsp.slow_tubes.solved_tube import SolvedTube, certify_solved
from gsp.systems.arguments import check_noun, shown


@overload
def certify(
    branch: Branch,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> Certificate: ...
@overload
def certify(
    branch: SeriesManifold,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> SlowTube: ...
@overload
def certify(
    branch: SampledManifold,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> SolvedTube: ...
@overload
def certify(
    branch: SingularOrbit,
    *,
    epsilon: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> CycleCertificate: ...
@overload
def certify(
    branch: DelayedExit,
    *,
    epsilon: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> PassageCertificate: ...
@overload
def certify(
    branch: FoldPassage,
    *,
    start: Mapping[str, float],
    epsilon: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> PassageCertificate: ...
def certify(
    branch: Branch | SeriesManifold | SampledManifold | SingularOrbit | FoldPassage | DelayedExit,
    *,
    region: Mapping[str, object] | None = None,
    start: Mapping[str, float] | None = None,
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> Certificate | SlowTube | SolvedTube | CycleCertificate | PassageCertificate:
    """Prove or refute in ball arithmetic that `branch` is normally hyperbolic over `region`.

    For a series, or a manifold that `solve_manifold` has solved for, it is proved that a slow manifold lies in a
    tube about it; see `certify_tube` and `certify_solved`. For a `singular_orbit` that closes it is proved that a
    relaxation cycle exists, and is unique, for every epsilon up to a bound; see `certify_cycle`. For a `fold_passage`,
    from the slow variable of `start` on, and for what `entry_exit` returns it is proved how orbits pass the loss, see
    `certify_passage`. None of the three has a region.

    `region` gives every slow variable an interval, and parameters too, which then stand for all their values; other
    parameters keep the values of the system. Bounds on fast variables choose a sheet. Ends that are no doubles, such
    as Fraction(1, 3), are rounded outwards. With `epsilon` the condition of r-normal hyperbolicity is asked for as
    well. `progress` is called with the share that is done. Ctrl-C returns what is proved of a sheet or a tube by then.

    Raises `DeclarationError` for a region that is not one, `BranchError` when the branch has no point in it,
    `UnsupportedFunctionError` for a function without an enclosure.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - 2*x}, epsilon=eps)
    >>> certify(solve_critical(system).branches[0], region={"y": (0, 1)}).verdict.name
    'PROVED'
    """
    passes = isinstance(branch, (SingularOrbit, FoldPassage, DelayedExit))
    if passes and region is not None:
        raise DeclarationError(
            "the proof of a cycle or of a passage finds its own region.",
            "Leave region out.",
            got=shown(region),
            value=region,
        )
    if start is not None and not isinstance(branch, FoldPassage):
        raise DeclarationError(
            "only the proof of a passage through a fold has a start of its own.",
            "Leave start out.",
            got=shown(start),
            value=start,
        )
    if isinstance(branch, SingularOrbit):
        return certify_cycle(branch, epsilon=epsilon, progress=progress)
    if isinstance(branch, (FoldPassage, DelayedExit)):
        return certify_passage(branch, start=start, epsilon=epsilon, progress=progress)
    if region is None:
        raise DeclarationError("a proof about a sheet needs a region.", 'Give one, as region={"x": (0, 1)}.')
    if isinstance(branch, SeriesManifold):
        return certify_tube(branch, region=region, epsilon=epsilon, most_boxes=most_boxes, progress=progress)
    if isinstance(branch, SampledManifold):
        return certify_solved(branch, region=region, epsilon=epsilon, most_boxes=most_boxes, progress=progress)
    nouns = (Branch, SeriesManifold, SampledManifold, SingularOrbit, FoldPassage, DelayedExit)
    check_noun(branch, nouns, verb="certify")
    return certify_branch(branch, region=region, epsilon=epsilon, most_boxes=most_boxes, progress=progress)
