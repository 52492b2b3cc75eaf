"""How a run on a reduced flow ends where the reduction does: at a fold, at another loss of normal hyperbolicity, or,
above order 0, where the series in epsilon stops being asymptotic on the way there.

The test functions of `validity` are watched at every step. Where the eigenvalue passes through zero at order 0 the run
goes on in the desingularised flow: when that crosses the zero it is a fold, in general a singularity of the reduced
field, and its time and place are those of the desingularised run; otherwise the reduced field is regular there and the
crossing is located on the run itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsp.algebra.brevity import LISTED, listed
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, HyperbolicityError, Status
from gsp.integration.crossings import Search
from gsp.integration.loop import standing
from gsp.integration.methods import Method
from gsp.integration.pieces import RunPiece
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.reduction_end.jumps import just_before, leaps, sides_at_start
from gsp.integration.reduction_end.losses import HORIZON, LONG_HORIZON, MAX_STEPS, DeterminantZero, loss_ahead
from gsp.integration.reduction_end.validity import TESTS, Validity, eigenvalues, validity_of
from gsp.integration.run_array import Record, RunRecord
from gsp.integration.watched import LOOK, Settled, Stepper, Watched
from gsp.kernels.scan import ON_LOSS, clear_of_zero

# A pair with a real part below this share of its modulus is imaginary.
IMAGINARY = 1e-6
# A det g_y that begins below this could fall below the least double without a zero.
LEAST = 1e-200
# A sign change of det g_y is a zero when it is below this share of its largest value just before.
SMALL = 1e-3
ACROSS = "the reduction ends here; integrate the full system across"
# At a pole g_y or g_x grows threefold when it is approached from the first to the second share of a step; at a zero
# that the numerator has too it does not.
APPROACH = (1e-3, 1e-6)
FOLDED = "the reduction ends here; canards may pass through it, folded_singularities() tells its kind"


def on_loss(validity: Validity, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether det g_y is 0 to rounding at points with these `tests` (..., outputs), and whether H is."""
    zero, pair, _, rounding, size = np.abs(np.moveaxis(rows, -1, 0)[: len(TESTS)])
    return zero <= ON_LOSS * rounding, (pair <= ON_LOSS * size) & validity.watches_pairs


def begins(validity: Validity, rows: np.ndarray) -> np.ndarray:
    """Whether a run begins at starts with these `tests` (..., outputs): a series that is watched must hold there."""
    return (rows[..., 2] > 0.0) | (not validity.watches_series)


class Ending:
    """Watches one run of a reduced flow, whose steps end on the `stops` (s,).

    Raises `HyperbolicityError` when the start lies on a loss of normal hyperbolicity.
    """

    def __init__(
        self,
        flow: ReducedFlow,
        stepper: Stepper,
        span: tuple[float, float],
        y: np.ndarray,
        stops: np.ndarray | None = None,
    ) -> None:
        self.flow = flow
        self.stepper = stepper
        self.span = span
        self.stops = np.array(span[1:]) if stops is None else stops
        self._system = flow.manifold.branch.system
        self.validity = validity_of(flow)
        row = self.validity.tests(self.validity.lift(y, stepper.p), stepper.p)
        self._refuse_underflow(y, row)
        self._refuse_loss(y, row)
        self._begins = begins(self.validity, row)
        self._columns, signs = self.validity.watched(row[np.newaxis])
        self._orientation = signs[0]
        settles = (self._zero, self._pair, self._series)
        self.watched = [
            Watched(TESTS[i], -1, 1, settles[i], touches=i < 2)
            if i < len(TESTS)
            else Watched("border", -1, 1, self._border)
            for i in self._columns
        ]
        self.signs = np.ones(len(self._columns))
        surfaces = len(self.validity.surfaces)
        if surfaces:
            # The first that leads nowhere else, as where a jump has no height, is not the last.
            self.watched[-surfaces:] = [Watched("jump", 0, 1, self._jump)] * surfaces
            z = self.validity.point(y, stepper.p)
            self.signs[-surfaces:] = self._orientation[-surfaces:] * sides_at_start(
                self.validity, z, row[-surfaces:], stepper
            )

    def values(self, t: np.ndarray, states: np.ndarray) -> np.ndarray:
        """The test functions (m, w), positive where the reduction holds; -inf where M0 has no point."""
        points = self.validity.lift(states, self.stepper.p)
        tests = self.validity.tests(points, self.stepper.p)[:, self._columns] * self._orientation
        return np.where(np.isnan(tests), -np.inf, tests)

    def quiet(
        self, time: float, state: np.ndarray, times: np.ndarray, states: np.ndarray, dense: np.ndarray
    ) -> bool:
        """Whether all test functions surely stay positive over these steps."""
        signs = self._orientation[list(self.validity.varying)]
        return clear_of_zero(
            self.validity.functions, self.stepper.p, signs, (time, state), (times, states, dense)
        )

    def stuck(self, time: float, times: np.ndarray, states: np.ndarray) -> Settled | None:
        """The ending of a run that has made these steps since `time` and gets nowhere.

        So it is where the reduced field points from both sides to where it jumps, at a kink of M0 as of dry friction.
        Steps that the `stops` have cut say nothing.
        """
        steps = np.abs(np.diff(times, prepend=time))
        half = len(steps) // 2
        # A run is stuck when as many steps as are looked at together take less than this share of the time so far,
        # and grow no smaller: into a fold and other ends they do. Steps that are all alike take so little after 64
        # million of them.
        if (
            len(steps) < LOOK
            or np.isin(times, self.stops).any()
            or steps.sum() > 1e-6 * abs(times[-1] - self.span[0])
            or steps[half:].max() < 0.5 * steps[:half].max()
        ):
            return None
        t, y = float(times[-1]), states[-1]
        note = (
            f"{LOOK} steps took no more than {steps.sum():.2g} of time at {self._shown(y)}, as where the reduced field "
            "jumps and points there from both sides, or where it has a fast time of its own"
        )
        return Settled(t, y, None, Status.STEP_TOO_SMALL, note, ACROSS)

    def at_start(self, t: float, y: np.ndarray) -> Settled | None:
        """The ending of a run that cannot begin: the series is none at the start."""
        if self._begins:
            return None
        return self._without_series(Settled(t, y, None))

    def after_failure(self, record: RunRecord) -> tuple[RunRecord, str, str]:
        """`record`, if it stopped early continued into the loss that stopped it; a note and a remedy then."""
        if self.flow.order or record.status not in (Status.STEP_TOO_SMALL, Status.NON_FINITE):
            return record, "", ""
        loss, j = self._loss(record.times, record.states)
        if loss is None or self._beyond(loss.t):
            sizes = np.abs(self.values(record.times, record.states)[:, 0])
            # A run that fails with |det g_y| below this share of its largest value has failed at its zero: as
            # the root of the time that is left, det g_y falls no lower than the root of rounding.
            if not sizes[-1] <= 1e-6 * sizes.max():
                return record, "", ""
            return (
                record._replace(status=Status.HYPERBOLICITY_LOST), self._zero_note(record.states[-1]), ACROSS
            )  # fmt: skip
        tail = self._into(loss, float(record.times[j]), record.states[j])
        status, note, remedy = self._named(loss)
        times, dense = np.concatenate([record.times[: j + 1], tail.times[1:]]), record.dense[:j]
        joined = Record(
            times,
            np.concatenate([record.states[: j + 1], tail.states[1:]]),
            np.concatenate([dense, tail.dense]) if len(tail.dense) else dense,
            status,
            record.method,
            [len(times) - 1, *record.counters[1:]],
        )
        return joined, note, remedy

    def fold_ahead(self, t: float, y: np.ndarray) -> DeterminantZero | None:
        """The fold that the reduced flow of order 0 reaches from the state `y` at `t`, if it is near; else None."""
        loss = self._ahead(t, y)
        return loss if loss is not None and loss.is_fold else None

    def _ahead(self, t: float, y: np.ndarray, *, horizon: float = HORIZON) -> DeterminantZero | None:
        return loss_ahead(self.flow, self.validity, self.stepper, self.span, t, y, horizon)

    # -- what a crossing means ---------------------------------------------------------------------

    def _zero(self, search: Search, column: int, t: float, piece: RunPiece) -> Settled | None:
        k = piece.step(t)
        start, y = float(piece.times[k]), piece.states[k]
        if (column, t) in search.touched:
            settled = _run_to(search, t, piece)
            return replace(
                settled, status=Status.HYPERBOLICITY_LOST, note=self._zero_note(settled.y), remedy=ACROSS
            )
        loss, j = (None, k) if self.flow.order else self._loss(*search.history(k, piece))
        if loss is not None and self._beyond(loss.t):
            tail = search.run(start, y, self.span[1])
            return Settled(float(tail.times[-1]), tail.states[-1], tail, tail.status)
        if loss is not None:
            times, states = search.history(k, piece)
            tail = self._into(loss, float(times[j]), states[j])
            return Settled(loss.t, loss.state, tail, *self._named(loss), row=j)
        settled = search.refined(column, t, piece)
        sides = settled.t + 1e-9 * (piece.times[k + 1] - start) * np.array([-1.0, 1.0])
        beside = np.abs(self.values(sides, piece.at(sides))[:, 0])
        sizes = np.abs(self.values(*search.history(k, piece))[:, 0])
        if not np.isfinite(beside[0]) or beside[0] > SMALL * sizes.max():
            if not np.isfinite(beside).all() or self._grows(settled, piece):
                return self._beyond_domain(settled)
            note = f"an eigenvalue of the fast Jacobian jumps through zero at {self._shown(settled.y)}"
            return replace(settled, status=Status.HYPERBOLICITY_LOST, note=note, remedy=ACROSS)
        return replace(
            settled, status=Status.HYPERBOLICITY_LOST, note=self._zero_note(settled.y), remedy=ACROSS
        )

    def _loss(self, times: np.ndarray, states: np.ndarray) -> tuple[DeterminantZero | None, int]:
        """The zero of det g_y that the order-0 run with these steps runs into, and the step from which it is joined.

        What it is, is told from a step that is not yet lost in the errors beside it. A fold is located from the last
        step: there the run is the most sensitive, and its own end is where its last step leads.
        """
        sizes = np.abs(self.values(times, states)[:, 0])
        # What a loss is, is told from where |det g_y| was last this share of its largest value.
        j = int(np.flatnonzero(sizes >= 1e-2 * sizes.max())[-1])
        last = len(times) - 1
        loss = self._ahead(float(times[j]), states[j], horizon=LONG_HORIZON)
        if loss is not None and loss.is_fold:
            nearer = self._ahead(float(times[last]), states[last])
            if nearer is not None and nearer.is_fold:
                # A step that has come to the fold's own time leaves no time in which to come to its place.
                return nearer, last - (last > 0 and float(times[last]) == nearer.t)
        return loss, j

    def _named(self, loss: DeterminantZero) -> tuple[Status, str, str]:
        """Status, note and remedy of a zero eigenvalue that the desingularised flow has found."""
        if loss.is_fold:
            return Status.FOLD_REACHED, self._fold_note(loss), ""
        if loss.kind is LossKind.BRANCH_POLE:
            coordinates = loss.state[: len(self.flow.manifold.coordinates)]
            place = self._system.place(zip(self.flow.states, coordinates))
            return Status.NON_FINITE, f"the critical manifold goes to infinity at {place}", ""
        if loss.kind is LossKind.BRANCH_POINT:
            note = (
                f"an eigenvalue of the fast Jacobian reaches zero at a branch point, {self._point(loss.point)}"
            )
            return Status.HYPERBOLICITY_LOST, note, ACROSS
        note = f"a folded singularity of the critical manifold at {self._point(loss.point)}"
        return Status.FOLD_REACHED, note, FOLDED

    def _pair(self, search: Search, column: int, t: float, piece: RunPiece) -> Settled | None:
        touches = (column, t) in search.touched
        settled = _run_to(search, t, piece) if touches else search.refined(column, t, piece)
        values = self._eigenvalues(settled.y)
        n = len(values)
        i, _ = min(
            ((i, j) for i in range(n) for j in range(i)), key=lambda ij: abs(values[ij[0]] + values[ij[1]])
        )
        if not abs(values[i].imag) > IMAGINARY * abs(values[i]):
            # l and -l, real: a neutral saddle, where nothing is lost.
            return None
        note = (
            f"the eigenvalues {abs(values[i].imag):.6g} i and its conjugate are imaginary at {self._shown(settled.y)}, "
            "a Hopf point of the layer problem; the full system leaves the manifold some time after"
        )
        return replace(settled, status=Status.HYPERBOLICITY_LOST, note=note, remedy=ACROSS)

    def _border(self, search: Search, column: int, t: float, piece: RunPiece) -> Settled | None:
        settled = search.refined(column, t, piece)
        return self._beyond_domain(settled) if self._grows(settled, piece) else None

    def _grows(self, settled: Settled, piece: RunPiece) -> bool:
        """Whether g_y or g_x grow towards the place as to a pole."""
        k = piece.step(settled.t)
        length = piece.times[k + 1] - piece.times[k]
        before = np.array([settled.t - share * length for share in APPROACH])
        before = before[(before - piece.times[k]) * length >= 0.0]
        points = self.validity.lift(piece.at(before), self.stepper.p)[:, :-1]
        sizes = np.linalg.norm(self.validity.derivatives(points, self.stepper.p), axis=1)
        return len(sizes) < len(APPROACH) or not sizes[1] <= 3.0 * sizes[0]

    def _jump(self, search: Search, column: int, t: float, piece: RunPiece) -> Settled | None:
        settled = search.refined(column, t, piece)
        k = column - len(search.watched) + len(self.validity.surfaces)
        if not leaps(self.validity, self.validity.point(settled.y, self.stepper.p), self.stepper)[k, 2]:
            return None
        settled = just_before(search, column, settled, piece, self.stops)
        place = f"{self.validity.surfaces[k]} = 0, at {self._shown(settled.y)}"
        note = f"the critical manifold jumps where {place}; the fast variables leave it there"
        return replace(settled, status=Status.JUMP_REACHED, note=note, remedy=ACROSS)

    def _beyond_domain(self, settled: Settled) -> Settled:
        # A pole of the fast field, or the border of the functions that M0 is made of.
        note = f"the critical manifold, or the fast Jacobian on it, ends at {self._shown(settled.y)}"
        return replace(settled, status=Status.NON_FINITE, note=note)

    def _series(self, search: Search, column: int, t: float, piece: RunPiece) -> Settled | None:
        return self._without_series(search.refined(column, t, piece))

    def _without_series(self, settled: Settled) -> Settled:
        if not np.isfinite(self.validity.lift(settled.y[None], self.stepper.p)).all():
            return self._beyond_domain(settled)
        values = self._eigenvalues(settled.y)
        least = values[np.argmin(np.abs(values))]
        shown = f"{least.real:.3g}" if abs(least.imag) <= IMAGINARY * abs(least) else f"{least:.3g}"
        epsilon = self.flow.epsilon.name
        fact = f"the terms of the series in {epsilon} fall no further, fast eigenvalue {shown}"
        fold = self.fold_ahead(settled.t, settled.y)
        if fold is None:
            return replace(
                settled,
                status=Status.SERIES_ENDS,
                note=f"{fact} at {self._shown(settled.y)}",
                remedy=f"lower {epsilon}, or take the reduced flow of order 0, which holds up to the loss itself",
            )
        ahead = f"from here the flow of order 0 reaches it at t = {fold.t:.6g}"
        return replace(
            settled, status=Status.FOLD_REACHED, note=f"{fact}; {self._fold_note(fold)} is near, {ahead}"
        )

    # -- parts -------------------------------------------------------------------------------------

    def _into(self, fold: DeterminantZero, t: float, y: np.ndarray) -> Record:
        """The run from `y` at `t` to the fold: what the method makes of it, and a last step that ends there."""
        stepper = self.stepper
        record = None
        if t != fold.t:
            record = stepper.through(
                y, t, np.append(self._between(t, fold.t), fold.t), max_steps=MAX_STEPS,
                watch=lambda times, states, dense: not self._holds(states).all(), first_step=fold.t - t,
            )  # fmt: skip
        if record is None:
            return standing(t, y, Status.FOLD_REACHED, Method.DOP853)
        times, states, dense = record.times, record.states, record.dense
        keep = len(times)
        if times[-1] == fold.t:
            scale = stepper.atol + stepper.rtol * np.abs(fold.state)
            # The last step of a run into a fold is kept when it meets the fold to so many times the tolerance.
            if not (np.abs(states[-1] - fold.state) <= 100.0 * scale).all():
                keep -= 1
            inside = keep - 1 if keep == len(times) else keep
        else:
            inside = keep
        bad = np.flatnonzero(~self._holds(states[:inside]))
        bad = bad[bad > 0]
        if bad.size:
            keep = int(bad[0])
        times, states, dense = times[:keep].copy(), states[:keep].copy(), dense[: keep - 1]
        if times[-1] == fold.t:
            states[-1] = fold.state
        else:
            # A straight line: what the method makes of the rest is lost in its errors.
            new = np.append(self._between(times[-1], fold.t), fold.t)
            shares = ((new - times[-1]) / (fold.t - times[-1]))[:, None]
            line = states[-1] + shares * (fold.state - states[-1])
            line[-1] = fold.state
            times, states = np.append(times, new), np.vstack([states, line])
            dense = np.concatenate([dense, np.zeros((len(new), *record.dense.shape[1:]))])
        return record._replace(times=times, states=states, dense=dense, status=Status.FOLD_REACHED)

    def _between(self, first: float, last: float) -> np.ndarray:
        """The stops strictly between two times."""
        return self.stops[(self.stops - first) * (self.stops - last) < 0.0]

    def _holds(self, states: np.ndarray) -> np.ndarray:
        return self.values(np.zeros(len(states)), states)[:, 0] > 0.0

    def _beyond(self, t: float) -> bool:
        first, last = self.span
        return (t - last) * (last - first) > 0.0

    def _eigenvalues(self, y: np.ndarray) -> np.ndarray:
        return eigenvalues(self.validity, self.validity.point(y, self.stepper.p))

    def _refuse_underflow(self, y: np.ndarray, row: np.ndarray) -> None:
        if not abs(row[0]) < LEAST:
            return
        values = np.abs(eigenvalues(self.validity, self.validity.point(y, self.stepper.p)))
        # Below this share of the largest an eigenvalue is rounding.
        if values.min() > 1e-12 * values.max():
            raise DeclarationError(
                f"the determinant of the fast Jacobian of {len(values)} fast variables is too small for a double, "
                "so that its zeros cannot be watched for.",
                "Integrate the full system.",
                got=f"{row[0]:.3g}",
                value=float(row[0]),
                limit=LEAST,
            )

    def _refuse_loss(self, y: np.ndarray, row: np.ndarray) -> None:
        on_zero, on_pair = on_loss(self.validity, row)
        if not (on_zero or on_pair):
            return
        z = self.validity.point(y, self.stepper.p)
        values = eigenvalues(self.validity, z)
        if not on_zero and not (np.abs(np.real(values)) <= IMAGINARY * np.abs(values)).any():
            # A neutral saddle.
            return
        what = "a zero eigenvalue" if on_zero else "an imaginary pair of eigenvalues"
        nearest = values if len(values) <= LISTED else values[np.argsort(np.abs(np.real(values)))]
        raise HyperbolicityError(
            "the start lies where normal hyperbolicity is lost.",
            "Start on one side of it, or integrate the full system.",
            got=f"{self._point(z)}, with {what} of the fast Jacobian ({listed(f'{v:.3g}' for v in nearest)})",
        )

    def _shown(self, y: np.ndarray) -> str:
        z = self.validity.point(y, self.stepper.p)
        if np.isfinite(z).all():
            return self._point(z)
        return self._system.place(zip(self.flow.states, y))

    def _point(self, z: np.ndarray) -> str:
        # What the tolerance cannot tell from 0 is 0.
        rounded = np.where(np.abs(z) <= self.stepper.atol, 0.0, z)
        return self._system.place(zip(self.validity.states, rounded))

    def _zero_note(self, y: np.ndarray) -> str:
        return f"an eigenvalue of the fast Jacobian reaches zero at {self._shown(y)}"

    def _fold_note(self, fold: DeterminantZero) -> str:
        return f"the fold of the critical manifold at {self._point(fold.point)}"


def _run_to(search: Search, t: float, piece: RunPiece) -> Settled:
    """The method's own run from the start of its step to `t`."""
    k = piece.step(t)
    start, y = float(piece.times[k]), piece.states[k]
    if t == start:
        return Settled(start, y, None)
    record = search.run(start, y, t)
    return Settled(float(record.times[-1]), record.states[-1], record)
