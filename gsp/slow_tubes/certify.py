"""`certify`: of a branch its normal hyperbolicity, of a series or a solved manifold a tube about a slow manifold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import overload

from gsp.critical.branch import Branch
from gsp.errors import DeclarationError
from gsp.proofs.certificate import Certificate
from gsp.proofs.certification import MOST_BOXES, certify_branch
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
) -> SlowTube: ...
@overload
def certify(
    branch: SampledManifold,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
) -> SolvedTube: ...
def certify(
    branch: Branch | SeriesManifold | SampledManifold,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> Certificate | SlowTube | SolvedTube:
    """Prove or refute in ball arithmetic that `branch` is normally hyperbolic over `region`.

    For a series, or a manifold that `solve_manifold` has solved for, it is proved that a slow manifold lies in a
    tube about it; see `certify_tube` and `certify_solved`.

    `region` gives every slow variable an interval, and parameters too, which then stand for all their values; other
    parameters keep the values of the system. Bounds on fast variables choose a sheet. Ends that are no doubles, such
    as Fraction(1, 3), are rounded outwards. With `epsilon` the condition of r-normal hyperbolicity is asked for as
    well. Ctrl-C returns what is proved by then.

    Raises `DeclarationError` for a region that is not one, `BranchError` when the branch has no point in it,
    `UnsupportedFunctionError` for a function without an enclosure.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - 2*x}, epsilon=eps)
    >>> certify(solve_critical(system).branches[0], region={"y": (0, 1)}).verdict.name
    'PROVED'
    """
    if isinstance(branch, (SeriesManifold, SampledManifold)) and progress is not None:
        raise DeclarationError(
            "the proof of a tube reports no progress.",
            "Leave progress out.",
            got=shown(progress),
            value=progress,
        )
    if isinstance(branch, SeriesManifold):
        return certify_tube(branch, region=region, epsilon=epsilon, most_boxes=most_boxes)
    if isinstance(branch, SampledManifold):
        return certify_solved(branch, region=region, epsilon=epsilon, most_boxes=most_boxes)
    check_noun(branch, (Branch, SeriesManifold, SampledManifold), verb="certify")
    return certify_branch(branch, region=region, epsilon=epsilon, most_boxes=most_boxes, progress=progress)
