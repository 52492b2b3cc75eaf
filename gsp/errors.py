"""What can go wrong: exceptions for a wrong call, `Status` for how a computation ended.

There are two channels and they do not mix. A call that cannot be carried out as written raises a
`GspError`, which carries *fact, value got, remedy* and what a caller may decide on. A computation that started and
stopped early returns its result with a `Status`; each status carries its meaning and its remedy. Why a part of a result
is missing is a `Reason`. Text is made of these once and never taken apart again.
"""

from __future__ import annotations

import difflib
import pickle
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum
from typing import Never, Self

_NOTHING = object()


class GspError(ValueError):
    """A call that cannot be carried out as written; base of every exception this package raises.

    Beside its text it holds `fact`, what is the case (without a full stop), `value`, what was given instead (None where
    nothing was), `remedy`, what to do (empty where the fact says it), and what a caller decides on: `known`, the names
    or choices there are; `limit`, how much or how many are allowed, of which `value` is too much; `point`, a place by
    name. `got` is how `value` is shown.
    """

    def __init__(
        self,
        fact: str = "",
        remedy: str = "",
        *,
        got: object = _NOTHING,
        value: object = None,
        known: Iterable[object] = (),
        limit: float | None = None,
        point: Mapping[str, float] | None = None,
    ) -> None:
        self.known = tuple(str(name) for name in known)
        self.value = value if value is not None or got is _NOTHING else got
        self.limit, self.point = limit, point
        self.remedy = (remedy + nearest(getattr(value, "name", value), self.known)).lstrip()
        self.fact = fact.removesuffix(".")
        shown = "" if got is _NOTHING else f"Got {got}."
        super().__init__(" ".join(part for part in (fact, shown, self.remedy) if part))

    def __reduce__(self) -> tuple:
        """As it is, but for a `value` that no other process could read."""
        fields = dict(self.__dict__)
        try:
            pickle.dumps(self.value)
        except Exception:
            fields["value"] = None
        return type(self), self.args, fields

    @classmethod
    def none_of(cls, known: Iterable[object], value: object, fact: str, listing: str) -> Self:
        """The error for a `value` that is none of the `known`, which are told after the words of `listing`."""
        names = [str(name) for name in known]
        return cls(fact, f"{listing} {', '.join(names) or 'none'}.", value=value, known=names)

    @property
    def reason(self) -> Reason:
        """Why what was asked for is not there."""
        return Reason(str(self), fact=self.fact, remedy=self.remedy)

    def under(self, place: str) -> Self:
        """This error, with the `place` where it was met in front."""
        return self.of(self, place)

    @classmethod
    def of(cls, error: GspError, place: str) -> Self:
        """The `error` as one of this class, with the `place` where it was met in front, fit for a terminal."""
        found = cls(printable(f"{place}: {error}"))
        found.__dict__.update(error.__dict__, fact=printable(f"{place}: {error.fact}"))
        return found


@contextmanager
def met_at(place: str) -> Iterator[None]:
    """A `GspError` that is raised within has the `place` in front."""
    try:
        yield
    except GspError as error:
        raise error.under(place) from None


class Reason(str):
    """Why something is not there: a text, made once, with its `fact` (without a full stop) and its `remedy`.

    It is empty where nothing is missing.
    """

    __slots__ = ("fact", "remedy")

    def __new__(cls, text: str = "", *, fact: str | None = None, remedy: str = "") -> Self:
        """The reason that `text` tells; without a `fact` all of it is the fact."""
        made = super().__new__(cls, text)
        made.fact = text.removesuffix(".") if fact is None else fact
        made.remedy = remedy
        return made

    @classmethod
    def of(cls, fact: str, remedy: str) -> Self:
        """The reason of a `fact`, given without a full stop, and a `remedy`."""
        return cls(f"{fact}. {remedy}", fact=fact, remedy=remedy)


NO_REASON = Reason()
"""The reason where nothing is missing."""


class DeclarationError(GspError):
    """A system, field, scene or start that is not well formed."""


class SplittingError(GspError):
    """A field that is not of the form z' = N f/epsilon + G."""


class DegenerateError(SplittingError):
    """A fast part that is nowhere hyperbolic on its zeros to leading order: higher orders decide what moves there."""


class BranchError(GspError):
    """A branch of the critical manifold that has vanished, is complex, or is ambiguous at a point."""


class HyperbolicityError(GspError):
    """The fast Jacobian is singular where a later stage has to invert it."""


class UnsupportedFunctionError(GspError):
    """A function for which the package has neither a power series rule nor machine code."""


class BudgetError(GspError):
    """An exact computation that would take more terms than it is allowed: `limit`, of which it would take `spent`."""

    @property
    def spent(self) -> object:
        """How much it would have taken; None where that is not known."""
        return self.value


class ModelFileError(GspError):
    """A model file that is missing, malformed, too large, or says something unknown."""


class OutputError(GspError):
    """A folder or file that cannot be written."""


class MissingPartError(GspError):
    """A part of an analysis that could not be made; the message is the reason."""


class DefectWarning(UserWarning):
    """A part that could not be made because of a defect in this package, not of the model."""


class BeyondReachWarning(UserWarning):
    """A series was evaluated where its terms no longer fall, so that its sum is not the slow manifold."""


class UnknownNameError(GspError, KeyError):
    """A name that a result does not have: `name`, and what there is, `known`."""

    __str__ = Exception.__str__

    @property
    def name(self) -> object:
        """The name that is not there."""
        return self.value


class EndKind(Enum):
    """What an ending says, whatever was computed."""

    REACHED = "all that was asked for was reached"
    STOPPED = "it stopped where it was asked to"
    ENDS = "the mathematics ends here"
    FAILED = "the computation failed"


class Status(Enum):
    """How a run, a continuation or a family ended. The value is (kind, meaning, remedy); all are shown to the user."""

    SUCCESS = (EndKind.REACHED, "reached the end", "")
    BOUND_REACHED = (EndKind.REACHED, "a bound was reached", "")
    CLOSED = (EndKind.REACHED, "the curve closed on itself", "")
    COMPLETE = (EndKind.REACHED, "the whole connected piece within the bounds was found", "")
    EVENT_REACHED = (
        EndKind.STOPPED,
        "a terminal event was reached",
        "the run was asked to end there; start again from its end to go on",
    )
    REGION_LEFT = (EndKind.STOPPED, "the trajectory left the region", "enlarge the region or shorten the span")
    INTERRUPTED = (
        EndKind.STOPPED,
        "interrupted by the user",
        "what was computed before is kept; call again to go on",
    )
    EQUILIBRIUM_REACHED = (EndKind.ENDS, "the cycles shrink to an equilibrium", "")
    FOLD_REACHED = (
        EndKind.ENDS,
        "a fold of the critical manifold was reached",
        "the reduction ends here; integrate the full system across the fold",
    )
    JUMP_REACHED = (
        EndKind.ENDS,
        "a jump of the critical manifold was reached",
        "the reduction ends here; integrate the full system across the jump, and start behind it",
    )
    HYPERBOLICITY_LOST = (
        EndKind.ENDS,
        "normal hyperbolicity is lost",
        "take a shorter span, a smaller region, or a start further from there; no epsilon is small enough across it",
    )
    SERIES_ENDS = (
        EndKind.ENDS,
        "the terms of the series fall no further",
        "lower epsilon, or take the reduced flow of a lower order",
    )
    HISTORY_ENDS = (
        EndKind.ENDS,
        "the orbits that fix the slow manifold begin too near to where it ends",
        "move the region downstream, or lower epsilon; the error estimate counts what is missing",
    )
    RUNS_AWAY = (
        EndKind.ENDS,
        "the curve leaves for infinity",
        "this may be all of it; bound the variables to stop sooner",
    )
    PERIOD_GROWS = (
        EndKind.ENDS,
        "the period exceeds the largest one allowed",
        "a homoclinic orbit is near, or an equilibrium on the orbit; raise max_period to come nearer",
    )
    NON_FINITE = (
        EndKind.FAILED,
        "the field is not finite beyond the last point",
        "the solution blows up or leaves the domain of the field; shorten the span or move the start",
    )
    STEP_TOO_SMALL = (
        EndKind.FAILED,
        "the steps became too small",
        "loosen rtol, or look for a singularity or a fold near the last point",
    )
    TOO_MANY_STEPS = (
        EndKind.FAILED,
        "the allowed number of steps was used up",
        "raise max_steps or loosen rtol",
    )
    TOO_MANY_POINTS = (
        EndKind.FAILED,
        "the allowed number of points was used up",
        "raise max_points, take larger steps, or bound the variables",
    )
    SINGULAR_JACOBIAN = (
        EndKind.FAILED,
        "the Jacobian is singular",
        "two solutions meet here: look for a fold or a branch point",
    )
    NOT_CONVERGED = (
        EndKind.FAILED,
        "Newton's method did not converge",
        "start nearer to the solution, or check that one exists",
    )
    MESH_LIMIT = (
        EndKind.FAILED,
        "the allowed number of mesh intervals does not reach the tolerance",
        "raise max_intervals, or loosen tolerance",
    )

    @property
    def kind(self) -> EndKind:
        """What the ending says, whatever was computed."""
        return self.value[0]

    @property
    def meaning(self) -> str:
        """One clause that says what happened."""
        return self.value[1]

    @property
    def remedy(self) -> str:
        """One clause that says what to do; empty where there is nothing to mend."""
        return self.value[2]

    @property
    def ok(self) -> bool:
        """Whether all that was asked for is there: the span, or all there is within the bounds."""
        return self.kind is EndKind.REACHED or self is Status.EQUILIBRIUM_REACHED

    def __str__(self) -> str:
        return f"{self.name}: {self.meaning}" + (f"; {self.remedy}" if self.remedy else "")


class Named(dict):
    """Results by name; a name that is not there raises `UnknownNameError`, which says what is."""

    def __missing__(self, name: object) -> Never:
        raise unknown_name(name, self)


def unknown_name(name: object, names: Iterable[str]) -> UnknownNameError:
    """The error for a `name` that is none of `names`."""
    known = list(names)
    if not known:
        return UnknownNameError(
            f"there is no {name!r} here, and no other name: nothing was asked for.", value=name
        )
    return UnknownNameError.none_of(known, name, f"there is no {name!r} here.", "The names are")


def one_line(error: BaseException | Warning | str, most: int | None = None) -> str:
    """What an exception says, to be shown: on one line, of `most` characters at most.

    An exception that is none of this package's has its kind in front.
    """
    is_ours = isinstance(error, (GspError, Warning, str))
    text = " ".join((str(error) if is_ours else f"{type(error).__name__}: {error}").split())
    return text if most is None else text[:most]


def printable(text: str) -> str:
    """`text` with every character that a terminal would act on, or that turns the order of the others, written out."""
    return "".join(c if c == "\n" or not is_hidden(c) else c.encode("unicode_escape").decode() for c in text)


def is_hidden(character: str) -> bool:
    """Whether a character is a control character, half of a pair, or a mark of the direction of writing."""
    return unicodedata.category(character) in ("Cc", "Cs") or character in _DIRECTIONS


# The marks, embeddings, overrides and isolates of the Unicode bidirectional algorithm (UAX 9), and line separators.
_DIRECTIONS = frozenset("\u061c\u200e\u200f\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")


def nearest(word: object, words: Iterable[str]) -> str:
    """' Did you mean "x"?' for the word of `words` nearest to `word`; empty when none is near, or it is no text."""
    if not isinstance(word, str):
        return ""
    found = difflib.get_close_matches(word, list(words), n=1, cutoff=0.6)
    return f' Did you mean "{found[0]}"?' if found else ""
