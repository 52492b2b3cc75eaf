"""What a text of a reduced flow is made of: its equations, and the facts that it names about itself."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.comparison.comparison import compare
from gsp.errors import BranchError, BudgetError, GspError, printable
from gsp.scenes.study import Study
from gsp.slow.series import SeriesManifold
from gsp.systems.flow import check_order
from gsp.systems.region import shown_region

# Terms in the longest coefficient up to which parameters stay symbols.
READABLE = 300
WIDTH = 96


@dataclass(frozen=True)
class Sheet:
    """An implicit branch: its `equations`, as many as fast variables, vanish at (x, y) = (`slow`, `fast`)."""

    equations: tuple[sp.Expr, ...]
    slow: tuple[float, ...]
    fast: tuple[float, ...]


@dataclass(frozen=True)
class ReducedModel:
    """x' = sum_k epsilon^k f_k and y = sum_k epsilon^k h_k: `rate_terms[k]` and `manifold_terms[k]`.

    With a `sheet` the branch is implicit, and fast symbols in the terms stand for the point of M0 over x.
    """

    facts: tuple[str, ...]
    slow: tuple[sp.Symbol, ...]
    fast: tuple[sp.Symbol, ...]
    epsilon: sp.Symbol
    value: float
    parameters: Mapping[sp.Symbol, sp.Expr]
    start: Mapping[str, float]
    span: tuple[float, float]
    rate_terms: tuple[tuple[sp.Expr, ...], ...]
    manifold_terms: tuple[tuple[sp.Expr, ...], ...]
    sheet: Sheet | None = None

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """Every symbol that the text names."""
        return (*self.slow, *self.fast, self.epsilon, *self.parameters)

    @property
    def rates(self) -> list[sp.Expr]:
        """x' in the order of `slow`."""
        return self._summed(self.rate_terms)

    @property
    def manifold(self) -> list[sp.Expr]:
        """y in the order of `fast`."""
        return self._summed(self.manifold_terms)

    def _summed(self, rows: Sequence[Sequence[sp.Expr]]) -> list[sp.Expr]:
        return [sp.Add(*(self.epsilon**k * term for k, term in enumerate(terms))) for terms in zip(*rows)]

    def comment(self, names: Mapping[sp.Symbol, str]) -> list[str]:
        """Lines that say what the text is, with what `names` renames; nothing in them acts in any language."""
        return [line for fact in self.said(names) for line in textwrap.wrap(inert(fact), WIDTH)]

    def said(self, names: Mapping[sp.Symbol, str]) -> list[str]:
        """What the text is, a sentence or two each, with what `names` renames."""
        changed = [f"{symbol.name} to {name}" for symbol, name in names.items() if symbol.name != name]
        return [*self.facts, *([f"Renamed: {', '.join(changed)}."] if changed else [])]


def inert(text: str) -> str:
    """`text` on one line, without control characters, ends of comments, or what continues a line."""
    plain = printable(" ".join(text.split())).replace("\\", "/")
    while "*/" in plain or "/*" in plain:
        plain = plain.replace("*/", "* /").replace("/*", "/ *")
    return plain


def reduced_model(study: Study, order: int, *, to: str, implicit: bool) -> ReducedModel:
    """The reduced flow of `order` with what is known about it, its error measured.

    Raises `BranchError` on an implicit branch unless the format `to` can be `implicit`, and what the stages before
    raise.
    """
    check_order(order)
    scene, system = study.scene, study.system
    if not study.branch.is_explicit and not implicit:
        raise BranchError(
            f"{to} has fast variables as expressions, and the branch of {scene.name or 'this scene'} gives "
            f"{', '.join(s.name for s in system.y)} only implicitly.",
            "Export to c, which solves for them, choose a slow variable along the branch in which it is a "
            "graph, or run the reduced flow here: integrate(study(scene).reduced(order), ...).",
        )
    sheet = None if study.branch.is_explicit else _sheet(study)
    series, fixed = _series(study, order)
    kept = {} if fixed else dict(system.parameters)
    facts = [
        f"Reduced flow of order {order} in {system.epsilon.name}: {scene.name or system.name or 'unnamed'}"
        + (f", {scene.title}." if scene.title else "."),
        *([f"Source: {scene.source}"] if scene.source else []),
        f"Region: {shown_region(study.region)}.",
        _measured(study, order),
    ]
    if fixed and system.parameters:
        values = ", ".join(f"{s.name} = {v}" for s, v in system.parameters.items())
        facts.append(f"The values of the parameters are put in, as symbols take too many terms: {values}.")
    if scene.reconstruction:
        names = ", ".join(s.name for s in scene.reconstruction)
        facts.append(f"Not in this text, for they are driven by the flow: {names}.")
    return ReducedModel(
        facts=tuple(facts),
        slow=system.x,
        fast=system.y,
        epsilon=system.epsilon,
        value=scene.epsilon,
        parameters=kept,
        start={s.name: study.start[s.name] for s in system.x},
        span=scene.span,
        rate_terms=tuple(tuple(row) for row in series.reduced_field),
        manifold_terms=tuple(tuple(row) for row in series.coefficients),
        sheet=sheet
        if sheet is None or not fixed
        else replace(sheet, equations=_numbers_in(sheet, system.parameters)),
    )


def _sheet(study: Study) -> Sheet:
    branch = study.branch
    if branch.seed is None:
        raise BranchError(
            f"{branch} is implicit, and no sheet of it is chosen, from which its points could be followed.",
            "Give the scene a start on one sheet.",
        )
    return Sheet(tuple(branch.equations), tuple(map(float, branch.seed[0])), tuple(map(float, branch.seed[1])))


def _numbers_in(sheet: Sheet, parameters: Mapping[sp.Symbol, sp.Expr]) -> tuple[sp.Expr, ...]:
    return tuple(equation.xreplace(dict(parameters)) for equation in sheet.equations)


def _series(study: Study, order: int) -> tuple[SeriesManifold, bool]:
    """The series, and whether the parameters' values are in it."""
    try:
        series = study.series(order)
        if max(series.sizes) <= READABLE:
            return series, False
    except BudgetError:
        pass
    return study.series(order, symbolic=False), True


def _measured(study: Study, order: int) -> str:
    scene = study.scene
    try:
        found = compare(study, orders=(order,), epsilons=(scene.epsilon,))
    except GspError as error:
        return f"Error not measured: {error}"
    error = found.errors[order][0]
    if not np.isfinite(error):
        return f"Error not measured: {found.statuses[order][0]}."
    return (
        f"Measured error: {error:.2g}, the largest of a slow variable relative to its size, against the full system "
        f"from the slow manifold at {study.system.epsilon.name} = {scene.epsilon:g} over t = {scene.span[0]:g} to "
        f"{scene.span[1]:g}."
    )
