"""What a sweep does at a point: a verb of the package, or a function of somebody else; and what that records."""

from __future__ import annotations

import hashlib
import importlib
import inspect
from collections.abc import Callable, Mapping
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from gsp.errors import DeclarationError
from gsp.results.point_verbs import Record, point_verbs
from gsp.sweeps.plan import Variable
from gsp.systems.arguments import check_among, shown

if TYPE_CHECKING:
    from gsp.scenes.study import Study


def is_verb(name: str) -> bool:
    """Whether a task's name is that of a verb, not "module:function"."""
    return ":" not in name


def name_of(task: object) -> str:
    """The name by which every process finds a task: that of a verb, or "module:function".

    Raises `DeclarationError` for what is neither.
    """
    if isinstance(task, str):
        if not is_verb(task) or task in point_verbs():
            return task
        raise DeclarationError(
            f"no sweep does {shown(task)}.",
            f"The verbs are {', '.join(point_verbs())}; a function is given as it is.",
            value=task,
            known=tuple(point_verbs()),
        )
    module, name = getattr(task, "__module__", None), getattr(task, "__qualname__", None)
    if callable(task) and module and name:
        if module.partition(".")[0] == "gsp" and name in point_verbs():
            return name
        if module != "__main__" and name.isidentifier():
            return f"{module}:{name}"
    raise DeclarationError(
        f"a task is a verb ({', '.join(point_verbs())}) or a function at the top of a module that other processes "
        "can import.",
        "Put the function into a module.",
        got=shown(task),
        value=task,
    )


def check_options(name: str, options: Mapping[str, object]) -> None:
    """Raises `DeclarationError` for an option that a verb does not have."""
    if not is_verb(name):
        return
    parameters = inspect.signature(point_verbs()[name].record).parameters.values()
    known = [p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
    for option in options:
        check_among(option, known, f"{shown(option)} is no option of {name}.", "Its options are")


def function_of(name: str) -> Callable[..., Any]:
    """The function of "module:function"; raises `DeclarationError` when it cannot be imported."""
    module, _, function = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise DeclarationError(
            f"the task {name} cannot be imported ({error}).", "Put its module where Python finds it."
        ) from None
    if not callable(found):
        raise DeclarationError(f"the task {name} is no function.", got=shown(found), value=found)
    return found


def source_of(name: str) -> str:
    """What tells whether a task has changed: the digest of the function's text; a verb changes with the version."""
    if is_verb(name):
        return name
    try:
        return hashlib.sha256(inspect.getsource(function_of(name)).encode()).hexdigest()
    except (OSError, TypeError):
        return "no source"


def variables_of(
    task: str, record: Record, study: Study | None, options: Mapping[str, Any]
) -> dict[str, Variable]:
    """What a task records, told by a `record` that it gave.

    Arrays of a function get one axis each, numbered. Raises `DeclarationError` for a record that is no mapping of names
    to numbers.
    """
    if not isinstance(record, Mapping) or not record:
        raise DeclarationError(
            "a task gives a mapping of names to numbers, one at least.",
            got=f"{shown(record)} from {task}",
            value=record,
        )
    verb = point_verbs()[task] if is_verb(task) else None
    labels = {} if verb is None else verb.labels(study, **options)
    codes = {} if verb is None else verb.codes
    found = {}
    for name, value in record.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise DeclarationError(
                "a task names what it records with plain words.", got=f"{shown(name)} from {task}", value=name
            )
        axes = labels.get(name)
        if axes is None:
            shape = () if name in codes else as_numbers(name, value).shape
            axes = {f"{name}_{k}": tuple(range(n)) for k, n in enumerate(shape)}
        found[name] = Variable(name, axes, codes.get(name, ()))
    return found


def as_numbers(name: str, value: object) -> np.ndarray:
    """A recorded value as doubles; raises `DeclarationError` when it is not made of real numbers."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise DeclarationError("a task records numbers.", f"It gave {shown(value)} for {name}.") from None


def meaning_of(value: object, variable: Variable) -> Any:
    """The word that a code stands for, an enumeration's name or its text, whichever the variable has; of many, each."""
    if isinstance(value, (list, tuple)):
        return [meaning_of(one, variable) for one in value]
    return value.name if isinstance(value, Enum) and value.name in variable.meanings else str(value)


def encoded(record: Record, variable: Variable) -> np.ndarray:
    """What a record says of a variable, as it is kept.

    Raises `DeclarationError` when it is not of the first record's shape.
    """
    name = variable.recorded
    if name not in record:
        raise DeclarationError(f"the task recorded no {name} here, as it did at the first point.")
    value = record[name]
    if variable.meanings:
        words = np.array(meaning_of(value, variable), dtype=object)
        codes = [variable.meanings.index(word) for word in words.ravel()]
        numbers = np.array(codes, dtype=np.int8).reshape(words.shape)
    else:
        numbers = as_numbers(name, value)
    if numbers.shape != variable.shape:
        raise DeclarationError(
            "a task records the same shape at every point.",
            got=f"the shape {numbers.shape} of {name}, and {variable.shape} at the first point",
        )
    return numbers
