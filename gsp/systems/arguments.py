"""Arguments of a call: one checker for each kind, used by every verb, which refuses a wrong value by its name.

A checker gives the value back as the verb works with it, or raises `DeclarationError`: *fact, value got, remedy*.
What is made of several names (a start, a region) is checked in `flow` and `region`.
"""

from __future__ import annotations

import numbers
import operator
import re
import reprlib
from collections import deque
from collections.abc import Callable, Collection, Iterable
from math import inf, isnan
from typing import Any

import numpy as np

from gsp.errors import DeclarationError

PLAIN_WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")

# How each noun is made of another, in words to be filled in: what to do first when a verb is given the wrong one.
_STEPS = {
    "VectorField": {"Splitting": "split({})"},
    "Splitting": {"SlowFastSystem": "{}.system"},
    "SlowFastSystem": {
        "CriticalManifold": "solve_critical({})",
        "CriticalCurve": "continue_critical({}, start=...)",
        "CanardValue": "canard_value({}, parameter=...)",
        "FoldPassage": "fold_passage({}, fold)",
        "FoldedSingularity": "folded_singularities({}, region=...)[0]",
    },
    "CriticalManifold": {"Branch": "{}.branches[0]"},
    "Branch": {"SeriesManifold": "expand({})", "DelayedExit": "entry_exit({}, start=...)"},
    "SeriesManifold": {"ReducedFlow": "restrict({})", "Branch": "{}.branch"},
    "SampledManifold": {"Branch": "{}.branch"},
    "ReducedFlow": {"SeriesManifold": "{}.manifold"},
    "Flow": {"PeriodicOrbit": "periodic_orbit({}, start=...)"},
    "FoldedSingularity": {"CanardOrbits": "folded_canards({}, epsilon=...)"},
    "CanardOrbits": {"Canard": "{}.canards[0]"},
    "Scene": {"SlowFastSystem": "{}.system", "VectorField": "{}.system", "Analysis": "analyse({})"},
    "Choice": {"Scene": "{}.scene"},
    "Comparison": {"Scene": "{}.scene"},
}
_WORDS = {
    "SlowFastSystem": "system",
    "VectorField": "field",
    "CriticalManifold": "critical",
    "Flow": "flow",
    "SeriesManifold": "series",
}
_KINDS = {"Flow": ("SlowFastSystem", "VectorField", "ReducedFlow")}
# Where each comes from, for who holds none of our nouns.
_SOURCES = {
    "SlowFastSystem": "Declare one, or use split(field).system.",
    "Branch": "Use solve_critical(system).branches[0], or .nearest(start).",
    "SeriesManifold": "Use expand(branch).",
    "Scene": "Use gsp.models.load(name) or gsp.load(path).",
    "CriticalCurve": "Use continue_critical(system, start=...).",
    "CanardValue": "Use canard_value(system, parameter=...).",
    "FoldedSingularity": "Find them with folded_singularities(system, region=...).",
    "Canard": "Take one of folded_canards(singularity, epsilon=...).canards.",
    "PeriodicOrbit": "Use periodic_orbit(flow, start=...).",
    "HopfPoint": "Use hopf_points(flow, start=..., parameter=...).",
    "FoldPassage": "Use fold_passage(system, fold).",
    "DelayedExit": "Use entry_exit(branch, start=...).",
    "Analysis": "Use analyse(scene).",
}


def shown(value: object) -> str:
    """`value` as a message shows it: short, on one line, whatever it is."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**40:
        sign = "a negative integer" if value < 0 else "an integer"
        return f"{sign} of {value.bit_length()} bits"
    if value is np.ma.masked:
        return "a masked value"
    if isinstance(value, np.ndarray):
        if hides(value):
            return f"an array of the shape {value.shape} and type {value.dtype} with masked values"
        return f"an array of the shape {value.shape} and type {value.dtype}"
    if callable(value) and hasattr(value, "__qualname__"):
        return f"the function {value.__name__}"
    if type(value).__module__.startswith("gsp."):
        return f"a {type(value).__name__}"
    try:
        text = repr(value)
    except Exception:
        # Numbers too long for text inside a list, or an object of somebody else that cannot be shown.
        text = f"a {type(value).__name__}"
    text = " ".join(text.split())
    # The longest text of a value that a message shows.
    return text if len(text) <= 200 else reprlib.repr(text)[1:-1]


def counted(number: int, noun: str) -> str:
    """`number` and the noun in the singular or the plural.

    >>> counted(1, "state"), counted(2, "auxiliary quantity")
    ('1 state', '2 auxiliary quantities')
    """
    if number == 1 or noun == "species":
        return f"{number} {noun}"
    return f"{number} {noun[:-1]}ies" if noun.endswith("ty") else f"{number} {noun}s"


def check_noun(value: Any, kinds: type | tuple[type, ...], *, verb: str) -> None:
    """Raises `DeclarationError` unless `value` is an instance of `kinds`; says which verbs come first."""
    if isinstance(value, kinds):
        return
    expected = kinds if isinstance(kinds, tuple) else (kinds,)
    names = [name for kind in expected for name in _KINDS.get(kind.__name__, (kind.__name__,))]
    articles = [f"{'an' if name[0] in 'AEIOU' else 'a'} {name}" for name in names]
    listed = articles[0] if len(names) == 1 else f"{', '.join(articles[:-1])} or {articles[-1]}"
    got = shown(value)
    if isinstance(value, type):
        got += ", not an instance of it" if issubclass(value, expected) else ""
    raise DeclarationError(f"{verb} takes {listed}.", _remedy(value, names, verb), got=got, value=value)


def _remedy(value: object, expected: list[str], verb: str) -> str:
    """The verbs that lead from `value` to what is wanted, the fewest; else where such a noun comes from."""
    sources = (_SOURCES.get(name, "") for name in expected)
    source = next((text for text in sources if text and f"{verb}(" not in text), "")
    if isinstance(value, type) or not type(value).__module__.startswith("gsp."):
        return source
    kinds = [base.__name__ for base in type(value).__mro__]
    ahead = deque((kind, _WORDS.get(kind, kind.lower())) for kind in kinds)
    seen = set(kinds)
    while ahead:
        here, text = ahead.popleft()
        if here in expected:
            return f"Use {verb}({text}, ...)."
        for there, step in _STEPS.get(here, {}).items():
            if there not in seen:
                seen.add(there)
                ahead.append((there, step.format(text)))
    return source


def hides(values: object) -> bool:
    """Whether one of NumPy's masked arrays, alone or within lists, hides a value: it stands for no number then.

    NumPy itself turns it into NaN with a warning, SymPy into 0, and `asarray` into what lies beneath.
    """
    if isinstance(values, np.ma.MaskedArray):
        return bool(np.ma.is_masked(values))
    return isinstance(values, (list, tuple)) and any(map(hides, values))


def as_float(value: Any) -> float:
    """`value` as a float, NaN unless it is one real number: no truth value and no array; digits as text count."""
    kind = type(value)
    if kind is float:
        return value
    if kind is not int and isinstance(value, (bool, np.bool_, bytes, bytearray, complex)):
        return float("nan")
    if isinstance(value, np.ndarray) and (value.ndim or value.dtype.kind not in "iuf" or hides(value)):
        return float("nan")
    try:
        return float(value)
    except OverflowError:
        return inf if value > 0 else -inf
    except (TypeError, ValueError):
        return float("nan")


def check_number(
    value: Any,
    *,
    what: str,
    be: str = "a finite number",
    above: float = -inf,
    least: float = -inf,
    below: float = inf,
    remedy: str = "",
) -> float:
    """`value` as a finite float with above < value < below and value >= least; `be` says so in words."""
    number = as_float(value)
    if above < number < below and number >= least:
        return number
    raise _refused(what, be, value, remedy)


def check_positive(value: Any, *, what: str, remedy: str = "") -> float:
    """`value` as a finite positive float."""
    return check_number(value, what=what, be="a positive number", above=0.0, remedy=remedy)


def check_whole(
    value: Any, *, what: str, least: int = 0, most: int | None = None, be: str = "", remedy: str = ""
) -> int:
    """`value` as an integer of at least `least`, and at most `most` if given."""
    if not isinstance(value, (bool, np.bool_, np.ndarray)):
        try:
            number = operator.index(value)
        except TypeError:
            pass
        else:
            if number >= least and (most is None or number <= most):
                return number
    if not be:
        be = (
            f"a whole number from {least} to {most}" if most is not None else f"a whole number, {least} or more"
        )
    raise _refused(what, be, value, remedy)


def check_flag(value: Any, *, what: str) -> bool:
    """`value` as True or False; nothing else counts as either."""
    if value is True or value is False:
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    raise _refused(what, "True or False", value)


def check_one_of(value: Any, among: tuple[int, ...], *, what: str, be: str) -> int:
    """`value` as the integer of `among` that it is."""
    number = check_whole(value, what=what, least=min(among), most=max(among), be=be)
    if number in among:
        return number
    raise _refused(what, be, value)


def check_progress(value: Any) -> None:
    """Raises `DeclarationError` unless `value` is None or can be called."""
    if value is not None and not callable(value):
        raise DeclarationError(
            "progress is a function that is called with the fraction done.",
            "Leave it out, or give progress=print.",
            got=shown(value),
            value=value,
        )


def check_among(value: object, known: Collection[object], fact: str, listing: str) -> None:
    """Raises `DeclarationError` with the `fact` unless `value` is one of `known`, told after the words of `listing`."""
    if value not in known:
        raise DeclarationError.none_of(known, value, fact, listing)


def check_plain_word(value: Any, *, what: str) -> str:
    """`value` if it is letters, digits, _ and -, at most 64, which a file may be called by."""
    if not isinstance(value, str) or not PLAIN_WORD.fullmatch(value):
        raise _refused(what, "a plain word", value, "Use letters and digits.")
    return value


def check_text(value: Any, *, what: str) -> str:
    """`value` if it is text."""
    if isinstance(value, str):
        return value
    raise _refused(what, "text", value)


def check_each(
    values: Any, check: Callable[[Any], Any], *, what: str, be: str, remedy: str = "", length: int | None = None
) -> tuple:
    """Every one of the sequence `values` as `check` gives it, `length` of them if given."""
    if isinstance(values, (str, bytes, type)) or not isinstance(values, Iterable) or hasattr(values, "keys"):
        raise _refused(what, be, values, remedy)
    try:
        listed = list(values)
    except TypeError:
        # An array without dimensions says that it is iterable.
        raise _refused(what, be, values, remedy) from None
    if length is not None and len(listed) != length:
        raise _refused(what, be, values, remedy)
    return tuple(check(value) for value in listed)


def check_array(values: Any, *, what: str, be: str) -> np.ndarray:
    """`values` as an array of floats: numbers only, no text and no truth values, finite or not."""
    try:
        if isinstance(values, (list, tuple)) and any(isinstance(value, (bool, np.bool_)) for value in values):
            raise TypeError
        if hides(values):
            raise TypeError
        array = np.asarray(values)
        if array.dtype.kind in "iuf":
            return array.astype(float)
        if array.dtype.kind == "O":
            # SymPy's numbers, fractions, integers beyond 64 bits.
            flat = [as_float(value) for value in array.ravel()]
            wrong = [value for value, number in zip(array.ravel(), flat) if isnan(number)]
            if not any(not isinstance(value, numbers.Real) for value in wrong):
                return np.array(flat).reshape(array.shape)
    except (TypeError, ValueError):
        pass
    raise _refused(what, be, values)


def check_times(t: Any) -> np.ndarray:
    """`t` as an array of floats, a copy: times at which a result is read."""
    return check_array(t, what="t", be="a number or a one-dimensional array of times")


def _refused(what: str, be: str, value: object, remedy: str = "") -> DeclarationError:
    plural = what.endswith("s") and what[:-1] in ("order", "bound", "iterate", "refinement", "parameter")
    return DeclarationError(f"{what} {'are' if plural else 'is'} {be}.", remedy, got=shown(value), value=value)
