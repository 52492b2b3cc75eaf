"""What a text of a reduced flow is made of: its equations, and the facts that it names about itself."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.algebra.factorisation import lowest_terms
from gsp.algebra.sharing import is_shared, plus, replaced, times
from gsp.comparison.comparison import compare
from gsp.errors import BranchError, BudgetError, GspError, printable
from gsp.scenes.study import Study
from gsp.slow.coordinates import set_apart
from gsp.slow.series import READABLE, SeriesManifold
from gsp.systems.flow import check_order
from gsp.systems.region import shown_ends, shown_region
from gsp.systems.tolerances import RTOL, absolute_tolerance

# Of 1800 terms a text has 200 kB and is made in 10 s, of 9500 terms 850 kB in a minute.
LONGEST = 4000


@dataclass(frozen=True)
class ReducedModel:
    """s' = sum_k epsilon^k f_k and z = sum_k epsilon^k z_k: `rate_terms[k]` and `manifold_terms[k]`.

    The `states` s are coordinates of the slow manifold: the slow variables or, on an implicit branch, fast variables of
    the point of M0 in place of slow ones or beside them. `observed` z are the other slow variables and the fast ones.
    `tolerance` is the absolute one of a run, as `integrate` has it.
    """

    facts: tuple[str, ...]
    states: tuple[sp.Symbol, ...]
    observed: tuple[sp.Symbol, ...]
    epsilon: sp.Symbol
    value: float
    parameters: Mapping[sp.Symbol, sp.Expr]
    start: tuple[float, ...]
    span: tuple[float, float]
    tolerance: float
    rate_terms: tuple[tuple[sp.Expr, ...], ...]
    manifold_terms: tuple[tuple[sp.Expr, ...], ...]

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """Every symbol that the text names."""
        return (*self.states, *self.observed, self.epsilon, *self.parameters)

    @property
    def rates(self) -> list[sp.Expr]:
        """The rates in the order of `states`."""
        return self._summed(self.rate_terms)

    @property
    def manifold(self) -> list[sp.Expr]:
        """The slow manifold in the order of `observed`."""
        return self._summed(self.manifold_terms)

    def _summed(self, rows: Sequence[Sequence[sp.Expr]]) -> list[sp.Expr]:
        return [_sum([(term, self.epsilon**k) for k, term in enumerate(terms)]) for terms in zip(*rows)]

    def comment(self, names: Mapping[sp.Symbol, str]) -> list[str]:
        """Lines that say what the text is, with what `names` renames; nothing in them acts in any language."""
        return [line for fact in self.said(names) for line in textwrap.wrap(inert(fact), 96)]

    def said(self, names: Mapping[sp.Symbol, str]) -> list[str]:
        """What the text is, a sentence or two each, with what `names` renames."""
        changed = [f"{symbol.name} to {name}" for symbol, name in names.items() if symbol.name != name]
        return [*self.facts, *([f"Renamed: {', '.join(changed)}."] if changed else [])]


def _sum(terms: Sequence[tuple[sp.Expr, sp.Expr]]) -> sp.Expr:
    if any(is_shared(term) for term, _ in terms):
        return plus([times(term, power) for term, power in terms])
    return sp.Add(*(power * term for term, power in terms))


def inert(text: str) -> str:
    """`text` on one line, without control characters, ends of comments, or what continues a line."""
    plain = printable(" ".join(text.split())).replace("\\", "/")
    while "*/" in plain or "/*" in plain:
        plain = plain.replace("*/", "* /").replace("/*", "/ *")
    return plain


def reduced_model(study: Study, order: int) -> ReducedModel:
    """The reduced flow of `order` with what is known about it, its error measured.

    Raises `BranchError` on an implicit branch of which no sheet is chosen, `BudgetError` for coefficients of more than
    `LONGEST` terms, and what the stages before raise.
    """
    check_order(order)
    scene, system = study.scene, study.system
    start = _start(study)
    series, fixed = _series(study, order)
    apart = set_apart(series.chart)
    ring, elements = series.chart.ring, series.chart.elements
    graph = {s: ring.to_sympy(elements[s]) for s in system.states if s not in series.coordinates}
    given = [s for s in system.x if s in graph]
    kept = {} if fixed else dict(system.parameters)
    facts = [
        f"Reduced flow of order {order} in {system.epsilon.name}: {scene.name or system.name or 'unnamed'}"
        + (f", {scene.title}." if scene.title else "."),
        *([f"Source: {scene.source}"] if scene.source else []),
        f"Region: {shown_region(study.region)}.",
        *(
            [f"Units: {', '.join(f'{name} in {unit}' for name, unit in scene.units.items())}."]
            if scene.units
            else []
        ),
        _measured(study, order),
        *_on_the_branch(study, apart, values={**graph, **(system.parameters if fixed else {})}),
    ]
    if fixed and system.parameters:
        values = ", ".join(f"{s.name} = {v}" for s, v in system.parameters.items())
        facts.append(f"The values of the parameters are put in, as symbols take too many terms: {values}.")
    if scene.reconstruction:
        names = ", ".join(s.name for s in scene.reconstruction)
        facts.append(f"Not in this text, for they are driven by the flow: {names}.")
    coefficients, field = series.nested if fixed else (series.coefficients, series.coordinate_field)
    manifold = [
        (*(graph[s] if k == 0 else sp.Integer(0) for s in given), *h) for k, h in enumerate(coefficients)
    ]
    return ReducedModel(
        facts=tuple(facts),
        states=tuple(apart.get(s, s) for s in series.coordinates),
        observed=(*given, *system.y),
        epsilon=system.epsilon,
        value=scene.epsilon,
        parameters=kept,
        start=start,
        span=scene.span,
        tolerance=absolute_tolerance(RTOL, study.region, study.start),
        rate_terms=tuple(tuple(replaced(e, apart) for e in row) for row in field),
        manifold_terms=tuple(tuple(replaced(e, apart) for e in row) for row in manifold),
    )


def _start(study: Study) -> tuple[float, ...]:
    """The scene's start in the states of the text, moved to M0 over its slow variables."""
    branch = study.branch
    if not branch.is_explicit and branch.seed is None:
        raise BranchError(
            f"{branch} is implicit, and no sheet of it is chosen, on which the reduced flow could start.",
            "Give the scene a start on one sheet.",
        )
    slow = {s.name: study.start[s.name] for s in study.system.x}
    return study.reduced(0, reconstructed=False).initial(slow)


def _on_the_branch(
    study: Study, apart: Mapping[sp.Symbol, sp.Symbol], *, values: Mapping[sp.Symbol, sp.Expr]
) -> list[str]:
    """What the states of an implicit branch are, and which equations hold between them; `values` of the others."""
    if not apart:
        return []
    slow = ", ".join(s.name for s in study.system.x)
    said = [
        f"{new.name} is {old.name} of the point of the critical manifold over {slow}."
        for old, new in apart.items()
    ]
    # An equation that gives a variable is nothing that holds between the states.
    left = [lowest_terms(equation.xreplace(values)) for equation in study.branch.equations]
    equations = "; ".join(f"0 = {equation.xreplace(apart)}" for equation in left if equation != 0)
    if equations:
        said.append(f"The states lie on the critical manifold, and so does a start: {equations}.")
    return said


def _series(study: Study, order: int) -> tuple[SeriesManifold, bool]:
    """The series, and whether the parameters' values are in it."""
    try:
        series = study.series(order)
        if max(series.sizes) <= READABLE:
            return series, False
    except BudgetError:
        pass
    series = study.series(order, symbolic=False)
    short = next((k for k, terms in enumerate(series.sizes) if terms > LONGEST), order + 1)
    if short <= order:
        raise BudgetError(
            f"the coefficients of order {short} have up to {series.sizes[short]} terms, and a text at most {LONGEST}.",
            f"Export at order {short - 1}, or run the reduced flow here: "
            f"integrate(study(scene).reduced({order}), ...)."
            if short
            else f"Run the reduced flow here: integrate(study(scene).reduced({order}), ...).",
            value=series.sizes[short],
            limit=LONGEST,
        )
    return series, True


def _measured(study: Study, order: int) -> str:
    scene = study.scene
    try:
        found = compare(study, orders=(order,), epsilons=(scene.epsilon,))
    except GspError as error:
        return f"Error not measured: {error}"
    error = found.errors[order][0]
    if not np.isfinite(error):
        return f"Error not measured: {found.statuses[order][0]}."
    begin, end = shown_ends(scene.span)
    time = scene.units.get("t", "")
    return (
        f"Measured error: {error:.2g}, the largest of a slow variable relative to its size, against the full system "
        f"from the slow manifold at {study.system.epsilon.name} = {scene.epsilon:g} over "
        f"{f't = {begin} to {end} {time}'.rstrip()}."
    )
