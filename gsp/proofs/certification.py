"""Normal hyperbolicity of a branch over a box: proved, refuted or left undecided."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.precision import precision
from gsp.critical.branch import Branch
from gsp.critical.sampling import Sampler
from gsp.errors import BranchError
from gsp.proofs import balls
from gsp.proofs.anchors import ball_at, point_over
from gsp.proofs.ball_functions import undefined_within
from gsp.proofs.certificate import Certificate
from gsp.proofs.covering import Covering, cover, glue, share_of, sharpen
from gsp.proofs.equations import EnclosedEquations, limit_equations, without_decimals
from gsp.proofs.refutation import Witness, refute
from gsp.proofs.sides import rounded_sides
from gsp.proofs.tubes import Box, middle_of
from gsp.proofs.verdict import ProofVerdict
from gsp.results.bounds import as_given, at_least
from gsp.systems.arguments import check_progress, check_whole
from gsp.systems.flow import check_epsilon
from gsp.systems.region import ImageBox, Interval, check_region, shown_region

# Boxes that are tried unless told otherwise: seconds.
MOST_BOXES = 20_000
# Undecided boxes towards which a witness is looked for.
SUSPECTS = 8


def certify_branch(
    branch: Branch,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> Certificate:
    """Prove or refute in ball arithmetic that `branch` is normally hyperbolic over `region`: `certify` of a branch.

    The method is that of `tubes`, `spectrum`, `covering` and `refutation`.
    """
    most_boxes = check_whole(most_boxes, what="most_boxes", least=1)
    check_progress(progress)
    small = None if epsilon is None else check_epsilon(epsilon)
    system = branch.system
    parameters = [p.name for p in system.parameters]
    checked = check_region(
        region, [*(s.name for s in system.states), *parameters], required=[s.name for s in system.x]
    )
    names = [s.name for s in system.x] + [p for p in parameters if p in checked]
    by_name = rounded_sides(region, checked)
    sides = [by_name[name] for name in names]
    box: Box = tuple(outer for outer, _ in sides)
    fast = {s.name: checked[s.name] for s in system.y if s.name in checked}
    branch = _in_units(branch, checked)
    with precision(balls.PRECISION):
        equations, slow = limit_equations(branch, names)
        start = point_over(branch, equations, box, fast)
        covering = _covered(equations, box, start, most_boxes, progress)
        problem = _BoxProblem(
            branch,
            equations,
            slow,
            _graph(branch, equations),
            box,
            tuple(inner for _, inner in sides),
            start,
            small,
            checked,
            most_boxes,
        )
        return _judged(problem, covering)


def _in_units(branch: Branch, region: Mapping[str, Interval]) -> Branch:
    """The branch in units of its states' sizes in the region, by its seed or else a point over the middle."""
    middle = np.array([sum(region[s.name]) / 2.0 for s in branch.system.x])
    try:
        point = np.concatenate(branch.seed or (middle, branch.points(middle[None])[0]))
    except BranchError:
        return branch
    bounds = {s.name: region[s.name] for s in branch.system.states if s.name in region}
    return branch.in_own_units(point, bounds) if np.isfinite(point).all() else branch


@dataclass(frozen=True, eq=False)
class _BoxProblem:
    """What is asked: over `box`, rounded outwards; `within` is the region rounded inwards, for witnesses."""

    branch: Branch
    equations: EnclosedEquations
    slow: list[sp.Expr]
    graph: tuple[sp.Expr, ...] | None
    box: Box
    within: Box
    start: tuple[np.ndarray, np.ndarray]
    epsilon: float | None
    region: Mapping[str, Interval]
    most_boxes: int


def _graph(branch: Branch, equations: EnclosedEquations) -> tuple[sp.Expr, ...] | None:
    if branch.graph is None:
        return None
    values = {p: v for p, v in branch.system.parameters.items() if p not in equations.x}
    return tuple(
        without_decimals(sp.sympify(branch.graph[y], strict=True).xreplace(values)) for y in equations.y
    )


def _covered(
    equations: EnclosedEquations,
    box: Box,
    start: tuple[np.ndarray, np.ndarray],
    most_boxes: int,
    progress: Callable[[float], object] | None,
) -> Covering:
    middle = middle_of(box)
    reached = equations.followed(start[0], middle, start[1])
    near = start[1] if reached is None else reached[1]
    return cover(equations, box, near, most_boxes=most_boxes, progress=progress)


def _judged(problem: _BoxProblem, covering: Covering) -> Certificate:
    names = [s.name for s in problem.equations.arguments]
    pieces = covering.pieces
    certificate = Certificate(
        branch=problem.branch,
        region=dict(zip(names, problem.box)),
        through=dict(zip(names, np.concatenate(problem.start).tolist())),
        verdict=ProofVerdict.UNDECIDED,
        reason="interrupted; what was proved by then is kept",
        gap=covering.gap,
        stable=0,
        unstable=0,
        epsilon=problem.epsilon,
        witness=None,
        undecided=tuple(covering.undecided),
        undecided_volume=covering.undecided_volume,
        boxes=tuple(piece.tube.box for piece in pieces),
        tried=covering.tried,
        _equations=problem.equations,
        _slow=tuple(problem.slow),
        _covering=covering,
    )
    if not covering.interrupted:
        with suppress(KeyboardInterrupt):
            return _decided(problem, covering, certificate)
    return replace(certificate, is_interrupted=True)


def _decided(problem: _BoxProblem, covering: Covering, certificate: Certificate) -> Certificate:
    equations, epsilon = problem.equations, problem.epsilon
    left = covering.undecided
    if not left:
        sharpen(equations, covering, most_boxes=problem.most_boxes)
    failed = [] if left else glue(equations, covering)
    pieces = covering.pieces
    counts = {piece.spectrum.counts for piece in pieces if piece.spectrum is not None}
    anchor = ball_at(equations, problem.start, problem.graph)
    if anchor is None:
        return replace(certificate, reason="the point at which the branch was found is not proved to be one")
    if not left and not failed and len(counts) == 1 and _is_on(covering, problem.start[0], anchor):
        (stable, unstable) = counts.pop()
        proved = replace(
            certificate,
            **_sizes(covering),
            verdict=ProofVerdict.PROVED,
            reason="one smooth branch, normally hyperbolic throughout",
            stable=stable,
            unstable=unstable,
        )
        if epsilon is not None and not proved.rate_ratio >= 1.0:
            sharpen(equations, covering, gap=epsilon * proved.tangential, most_boxes=problem.most_boxes)
            if covering.tried > proved.tried and glue(equations, covering):
                return replace(certificate, reason="the parts in which the gap is large enough are not glued")
            proved = replace(proved, **_sizes(covering))
        if epsilon is not None and not proved.rate_ratio >= 1.0:
            return replace(
                proved,
                verdict=ProofVerdict.UNDECIDED,
                reason=f"normally hyperbolic throughout, but r >= 1 at {problem.branch.system.epsilon} = "
                f"{as_given(epsilon)} is not proved: only r >= {at_least(proved.rate_ratio, 3)}",
            )
        return proved
    outside = None
    for suspect in _suspects(covering, failed, problem.start[0]):
        witness = refute(equations, problem.within, (problem.start[0], anchor), [suspect], graph=problem.graph)
        if witness is not None and not _is_inside(problem, witness):
            outside = outside or witness
            witness = _as_end(problem, witness)
        if witness is not None:
            return replace(
                certificate,
                verdict=ProofVerdict.REFUTED,
                reason="normal hyperbolicity is lost",
                witness=witness,
            )
    if outside is not None:
        return replace(certificate, reason=_why_outside(outside))
    return replace(certificate, reason=_why(problem, covering, failed))


def _sizes(covering: Covering) -> dict[str, Any]:
    """What of a certificate depends on how its parts were cut."""
    boxes = tuple(piece.tube.box for piece in covering.pieces)
    return {"gap": covering.gap, "boxes": boxes, "tried": covering.tried}


def _is_inside(problem: _BoxProblem, witness: Witness) -> bool:
    """Whether the region's bounds on fast variables, and its states, leave the witness in it."""
    equations = problem.equations
    sides = np.array([witness.box[s.name] for s in equations.x])
    x = sides.mean(axis=1)
    if all(s.name in witness.box for s in equations.y):
        y = np.array([np.mean(witness.box[s.name]) for s in equations.y])
    else:
        reached = equations.followed(problem.start[0], x, problem.start[1])
        if reached is None:
            return True
        y = reached[1]
    nx = len(problem.branch.system.x)
    return bool(Sampler(problem.branch).inside(np.concatenate([x[:nx], y])[None, :], problem.region)[0])


def _as_end(problem: _BoxProblem, witness: Witness) -> Witness | None:
    """What a witness outside the region says of it: the sheet ends at a fold, and is no graph over the slow variables.

    A change of type out there says nothing; nor does a fold that no state of the region goes to.
    """
    if witness.kind != "fold" or isinstance(problem.region, ImageBox):
        return None
    return replace(
        witness,
        statement=f"{witness.statement}, outside the bounds on the fast variables: over slow values beyond it the "
        "sheet has no point",
    )


def _why_outside(witness: Witness) -> str:
    where = ", ".join(f"{name} = {np.mean(side):.6g}" for name, side in witness.box.items())
    return f"the branch is lost at {where} only, which is not in the region; keep the slow variables away from there"


def _is_on(covering: Covering, x: np.ndarray, anchor: list[arb]) -> bool:
    """Whether the point that the branch was known at is on what was proved."""
    piece = covering.root.holding(x, upper=False).piece
    return piece is not None and piece.tube.holds([balls.exact(float(v)) for v in x], anchor)


def _suspects(covering: Covering, failed: list[Box], start: np.ndarray) -> list[np.ndarray]:
    """Places where the branch may be lost: of the undecided parts and of faces that are not glued, the furthest
    first.
    """
    found = [part.suspect for part in covering.root.leaves() if part.piece is None and part.suspect is not None]
    found += [middle_of(face) for face in failed]
    found += [middle_of(part.box) for part in covering.root.leaves() if part.piece is None]
    # Where no part is undecided the branch ends somewhere on the way to one of these.
    if failed or not found:
        found += [np.array(corner) for corner in np.array(covering.root.box).T]
    found.sort(key=lambda x: -float(np.abs(x - start).max()))
    step = max(1, len(found) // SUSPECTS)
    return found[::step][:SUSPECTS]


def _why(problem: _BoxProblem, covering: Covering, failed: list[Box]) -> str:
    undefined = _undefined(problem, covering)
    if undefined:
        return undefined
    if covering.exhausted:
        return f"the budget of {covering.tried} boxes is spent"
    if failed:
        return f"{len(failed)} common faces of boxes are not glued: the boxes may hold different branches"
    if covering.undecided:
        return "the boxes that are left hold a loss, or come too near one to be told"
    names = [s.name for s in problem.equations.arguments]
    where = ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, np.concatenate(problem.start)))
    return (
        f"the boxes are proved, but on another sheet than that through {where}, which ends on the way or was lost "
        "from sight; a smaller region would help"
    )


def _undefined(problem: _BoxProblem, covering: Covering) -> str:
    """Which part of the field or of the graph is not defined all over a small box that is left, and where."""
    equations, whole = problem.equations, covering.root.box
    left = sorted(
        (part for part in covering.root.leaves() if part.piece is None), key=lambda p: share_of(p.box, whole)
    )
    for part in left[:SUSPECTS]:
        share = max((high - low) / (last - first or 1.0) for (low, high), (first, last) in zip(part.box, whole))
        margin = share * (equations.sizes + np.abs(part.near))
        x = [balls.hull(low, high) for low, high in part.box]
        y = [balls.hull(float(v - r), float(v + r)) for v, r in zip(part.near, margin)]
        found = undefined_within(equations.equations, equations.arguments, [*x, *y]) or (
            undefined_within(problem.graph, equations.x, x) if problem.graph else None
        )
        if found is not None:
            where = shown_region(dict(zip([s.name for s in equations.x], part.box)))
            return f"{found} has a pole or a branch point, or comes near one, over {where}"
    return ""
