"""The slow manifold point by point: the zero-derivative principle.

h_epsilon(x) is approximated by the y for which d^(m+1) y/dt^(m+1) = 0 along the full flow through (x, y); order m
has error O(epsilon^(m+1)) (C. W. Gear, T. J. Kaper, I. G. Kevrekidis and A. Zagaris, SIAM Journal on Applied
Dynamical Systems 4 (2005) 711-732; A. Zagaris and others, ESAIM: M2AN 43 (2009) 757-784). Nothing is expanded
symbolically, and the type of normal hyperbolicity does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.common_units import common_units, sized
from gsp.errors import DeclarationError, Status
from gsp.kernels import slow_points as kernel
from gsp.kernels.addresses import JET
from gsp.kernels.compilation import address_of
from gsp.kernels.jets import flow_jet_with_tangents
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.tape import write_tape
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.systems.arguments import check_noun, check_positive, check_whole
from gsp.systems.flow import as_points, check_epsilon

LARGEST_ORDER = 40
_STATUS = {
    kernel.NOT_CONVERGED: Status.NOT_CONVERGED,
    kernel.NON_FINITE: Status.NON_FINITE,
    kernel.ILL_CONDITIONED: Status.SINGULAR_JACOBIAN,
}


@dataclass(frozen=True, eq=False, repr=False)
class SlowPoints(Card, Tabular):
    """Points of the slow manifold over `x` (m, n_slow): `y` (m, n_fast), NaN where there is none.

    `order` (m,) is the order used, -1 where it failed, and `error` (m,) the estimated error of y: the change from
    this order to the following ones. One point in, the leading axis is missing in all four. `status` is that of
    the first point that failed, else SUCCESS; an error above the tolerance is no failure: more is not to be had
    from this principle at this epsilon (optimal truncation), and `message` says so. `jets` counts the Taylor jets
    of the final orders, the work done.
    """

    branch: Branch
    epsilon: float
    tolerance: float
    x: np.ndarray
    y: np.ndarray
    order: np.ndarray
    error: np.ndarray
    status: Status
    jets: int
    _codes: np.ndarray = field(repr=False)
    _unit: float = field(repr=False)

    @property
    def message(self) -> str:
        """One line: how many points there are, the worst error and where it is, or where it failed."""
        x = np.atleast_2d(self.x)
        failed = np.flatnonzero(self._codes != kernel.CONVERGED)
        if failed.size:
            place, why = self._place(x[failed[0]]), str(self.status)
            if self._codes[failed[0]] == kernel.ILL_CONDITIONED:
                why = "the fast rates are too far apart for this order; take a lower one"
            return f"{failed.size} of {len(x)} points failed, the first at {place}: {why}"
        error = np.atleast_1d(self.error)
        worst = int(np.argmax(error))
        text = f"{len(x)} points, largest estimated error {error[worst]:.2g} at {self._place(x[worst])}"
        scale = self._unit + np.linalg.norm(np.atleast_2d(self.y), axis=1)
        short = int((error > 10 * self.tolerance * scale).sum())
        if short:
            verb = "does" if short == 1 else "do"
            text += f"; {short} {verb} not meet the tolerance {self.tolerance:g}: solve_manifold goes further"
        return text

    def _place(self, x: np.ndarray) -> str:
        return self.branch.system.place(zip(self.branch.system.x, x))

    def __repr__(self) -> str:
        return f"SlowPoints({self.message})"


def zero_derivative(
    branch: Branch, x, *, epsilon: float, order: int | None = None, tolerance: float = 1e-13, near=None
) -> SlowPoints:
    """The slow manifold of `branch` over the points `x`, by the zero-derivative principle, as `SlowPoints`.

    `x` is as for `Branch.points`: a mapping by name, (m, n_slow), or one point; `near` starts Newton's method on an
    implicit branch. With `order` that order is used; without it the lowest whose estimated error is below
    `tolerance` (1 + |y|), or, where the estimate starts to grow before that, the order where it is least. If a state's
    numbers are tiny or huge, y is measured in units in which the largest number of each state is near 1, and from the
    `centres` of a system that is far from its origin.

    Raises `DeclarationError` for arguments that are not well formed, `BranchError` where the branch has no point
    over `x`, and `UnsupportedFunctionError` for a field with floor and the like, which have no jets.

    The points belong to the formal slow manifold: where its series converges, as at a node of the slow flow, that
    may be another invariant curve than the one followed from upstream (see `solve_manifold`).

    >>> from gsp.slow.slow_points import zero_derivative
    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=eps)
    >>> zero_derivative(solve_critical(system).branches[0], [1.0, 2.0], epsilon=0.1).y.round(12)
    array([[1.11111111],
           [2.22222222]])
    """
    check_noun(branch, Branch, verb="zero_derivative")
    value = check_epsilon(epsilon)
    tolerance = check_positive(tolerance, what="tolerance", remedy="The default serves most uses.")
    if order is not None:
        be = f"an integer from 0 to {LARGEST_ORDER}, or None to choose it by the tolerance"
        check_whole(order, what="order", most=LARGEST_ORDER, be=be)
    system = branch.system
    # A field without jets is refused by name, before anything of it is compiled.
    write_tape(system)
    array, single = as_points(system.x, x, what="x")
    if not array.size:
        raise DeclarationError("x has no point.", "Give one or more.")
    start = np.atleast_2d(branch.points(array, near=near))
    own, centre = branch.about_centres, branch.system.centre
    x_centre, y_centre = np.split(centre, [len(system.x)])
    from_centre = array - x_centre, start - y_centre
    units = common_units(own.system, np.hstack([from_centre[0], sized(own, from_centre[1])]))
    own, (x_units, y_units) = own.moved_into(units), np.split(units, [len(system.x)])
    y, orders, errors, codes, jets = climb(
        write_tape(own.system),
        own,
        from_centre[0] / x_units,
        from_centre[1] / y_units,
        value,
        order=order,
        tolerance=float(tolerance),
    )
    y, errors = y * y_units + y_centre, errors * y_units.max()
    errors = errors + np.finfo(float).eps * np.linalg.norm(centre)
    failed = codes[codes != kernel.CONVERGED]
    status = _STATUS[int(failed[0])] if failed.size else Status.SUCCESS
    for part in (array, y, orders, errors):
        part.setflags(write=False)
    rows = 0 if single else slice(None)
    return SlowPoints(
        branch=branch,
        epsilon=value,
        tolerance=float(tolerance),
        x=array[rows],
        y=y[rows],
        order=orders[rows],
        error=errors[rows],
        status=status,
        jets=jets,
        _codes=codes,
        _unit=float(y_units.max()),
    )


def climb(
    tape,
    branch: Branch,
    x: np.ndarray,
    start: np.ndarray,
    epsilon: float,
    *,
    order: int | None,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """(y, orders, errors, codes, jets) of `zero_derivative` from `start` (m, n_fast), everything checked."""
    system = branch.system
    p = parameter_vector(system, epsilon)
    constants = tape.constants(p)
    m = len(x)
    xs = np.array(x, dtype=float, order="C")
    ys = np.array(start, dtype=float, order="C")
    errors = np.empty(m)
    codes = np.zeros(m, dtype=np.int64)
    jet = address_of(flow_jet_with_tangents, JET)
    flow = (jet, tape.instructions, constants, tape.rates, epsilon, len(system.x))
    if order is None:
        orders = np.empty(m, dtype=np.int64)
        # Up to order 24: at epsilon = 0.01 rounding is met near order 7.
        jets = kernel.to_tolerance(flow, xs, ys, tolerance, 24, orders, errors, codes)
    else:
        jets = sum(kernel.at_order(flow, xs, ys, int(order), errors, codes))
        orders = np.where(codes == kernel.CONVERGED, int(order), -1)
    return ys, orders, errors, codes, int(jets)
