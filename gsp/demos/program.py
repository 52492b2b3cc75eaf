"""A scene as a JavaScript program: full field, Jacobian, changes of coordinates, M0, the series and rival fields.

Every function takes arrays and fills one. z are the states as declared, then what is reconstructed; u = (x, y) the slow
and fast variables; c the coordinates on M0 in which the series is written; p epsilon, then the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from gsp.algebra.clocks import clocks
from gsp.algebra.differentiation import jacobian
from gsp.algebra.laurent import laurent
from gsp.demos.javascript import function, operations
from gsp.errors import BudgetError, GspError
from gsp.results.lettering import in_unicode
from gsp.scenes.small_parameter import no_small_parameter
from gsp.scenes.study import Study
from gsp.slow.series import SeriesManifold

# A coefficient with more terms is left out: with two hundred a page stays below its size, and a redraw below a frame.
TERMS = 200


@dataclass(frozen=True, eq=False)
class PageProgram:
    """JavaScript functions by name, and what a page must know of them as data.

    `parts["series"]` says through which order the reduction holds `anywhere`, with parameters as arguments, and through
    which at the `declared` values only; `reason` why there is none, or why it ends there.
    """

    functions: Mapping[str, str]
    parts: Mapping[str, Any] = field(repr=False)

    @property
    def code(self) -> str:
        """The functions, then `const program`, which holds them by name."""
        return "".join(self.functions.values()) + f"const program = {{{', '.join(self.functions)}}};\n"


def program_of(study: Study, more: Mapping[sp.Symbol, sp.Expr] | None = None) -> PageProgram:
    """The program of a scene, with `more` quantities; what cannot be made for it is told in `parts` instead.

    Raises `UnsupportedFunctionError` when the field itself has no counterpart in JavaScript.
    """
    scene = study.scene
    flow = scene.full_flow
    # The functions of the page take a first number always.
    epsilon = scene.system.epsilon
    p = (sp.Dummy("epsilon") if epsilon is None else epsilon, *scene.system.parameters)
    full = {"z": flow.states, "p": p}
    functions = {
        "field": function("field", list(flow.rates), full),
        "jacobian": function("jacobian", list(jacobian(flow.rates, flow.states)), full),
    }
    ticking = clocks(flow.states, flow.rates)
    numbers = [
        number for c in ticking for number in (c.rate, *(n for z in (*c.switches, *c.peaks) for n in z.numbers))
    ]
    functions["pulses"] = function("pulses", numbers, full)
    shown: dict[sp.Symbol, sp.Expr] = {s: s for s in flow.states}
    parts: dict[str, Any] = {
        "states": [s.name for s in scene.system.states],
        "driven": [s.name for s in scene.reconstruction],
        "epsilon": None if epsilon is None else epsilon.name,
        "parameters": [s.name for s in scene.system.parameters],
        "values": [float(value) for value in scene.system.parameters.values()],
        "pulses": [
            {
                "state": c.state,
                "zeros": [
                    {"jumps": jumps, "wave": z.is_wave, "numbers": len(z.numbers)}
                    for jumps, of in ((True, c.switches), (False, c.peaks))
                    for z in of
                ],
            }
            for c in ticking
        ],
    }
    claims = []
    for i, (name, rates) in enumerate(scene.claims.items()):
        functions[f"claim{i}"] = function(f"claim{i}", list(rates.values()), {"z": tuple(rates), "p": p})
        claims.append({"name": name, "states": [s.name for s in rates]})
    parts["claims"] = claims
    try:
        if epsilon is None:
            raise no_small_parameter(scene, "a reduced model needs one")
        reducing, parts["reduction"] = _reduction(study, p)
        functions |= reducing
        splitting = study.splitting
        if splitting is not None:
            shown |= {s: e for s, e in splitting.coordinates.items() if s not in shown}
    except (GspError, NotImplementedError) as error:
        parts["reduction"] = {"reason": in_unicode(str(error))}
    shown |= {s: e for s, e in {**scene.system.observables, **(more or {})}.items() if s not in shown}
    functions["quantities"] = function("quantities", list(shown.values()), full)
    parts["quantities"] = [s.name for s in shown]
    parts["operations"] = {name: operations(code) for name, code in functions.items()}
    return PageProgram(functions, parts)


def _reduction(study: Study, p: Sequence[sp.Symbol]) -> tuple[dict[str, str], dict[str, Any]]:
    """Functions of the splitting, of M0 and of the series, and what is known of them."""
    system, branch, splitting = study.system, study.branch, study.splitting
    u = system.states
    raw = study.scene.system.states
    to_new = u if splitting is None else [splitting.coordinates[s] for s in u]
    to_raw = raw if splitting is None else [splitting.inverse[s] for s in raw]
    leading = [laurent(g, system.epsilon, order=0).get(0, sp.Integer(0)) for g in system.g]
    functions = {
        "toNew": function("toNew", list(to_new), {"z": raw, "p": p}),
        "toRaw": function("toRaw", list(to_raw), {"u": u, "p": p}),
        "fastJacobian": function("fastJacobian", list(jacobian(leading, system.y)), {"u": u, "p": p}),
    }
    if branch.graph is None:
        functions |= {
            "sheet": function("sheet", list(branch.equations), {"u": u, "p": p}),
            "sheetJacobian": function(
                "sheetJacobian", list(jacobian(branch.equations, system.y)), {"u": u, "p": p}
            ),
        }
    else:
        functions["graph"] = function("graph", [branch.graph[y] for y in system.y], {"x": system.x, "p": p})
    anywhere, reason = _expanded(study, symbolic=True)
    declared, last_reason = _expanded(study, symbolic=False)
    facts: dict[str, Any] = {
        "reason": "",
        "slow": [s.name for s in system.x],
        "fast": [s.name for s in system.y],
        "explicit": branch.is_explicit,
        "sizes": branch.scales[1].tolist(),
        "anywhere": -1 if anywhere is None else anywhere.order,
        "declared": -1 if declared is None else declared.order,
        "ended": in_unicode(reason),
        "endedDeclared": in_unicode(last_reason),
    }
    for label, series in (("", anywhere), ("Declared", declared)):
        # Where the parameters may be anything, nothing is gained by their values.
        if series is None or (label and anywhere is not None and series.order <= anywhere.order):
            continue
        functions |= _coefficients(series, label, p)
        facts[f"coordinates{label}"] = [u.index(s) for s in series.coordinates]
    if anywhere is None and declared is None:
        raise BudgetError(reason)
    return functions, facts


def _expanded(study: Study, *, symbolic: bool) -> tuple[SeriesManifold | None, str]:
    """The series as far as its coefficients are short enough for a page, and why it ends there."""
    found, reason = None, ""
    try:
        # The highest order of the reduction on a page.
        for order in range(4):
            series = study.series(order, symbolic=symbolic)
            if series.sizes[order] > TERMS:
                reason = f"the coefficients of order {order} have {series.sizes[order]} terms, over {TERMS}"
                break
            found = series
    except BudgetError as error:
        reason = error.reason
    return found, reason


def _coefficients(series: SeriesManifold, label: str, p: Sequence[sp.Symbol]) -> dict[str, str]:
    """h_k and f_k, and the point of M0, as functions of the coordinates c on M0."""
    ring = series.chart.ring
    system = series.branch.system
    arguments = {"c": series.coordinates, "p": p}
    elements = [series.chart.elements[s] for s in system.states]
    functions = {f"base{label}": function(f"base{label}", [ring.horner(e) for e in elements], arguments)}
    for letter, rows in (("h", series._h), ("f", series._f)):
        for k in range(series.order + 1):
            name = f"{letter}{k}{label}"
            functions[name] = function(name, [ring.horner(row[k]) for row in rows], arguments)
    return functions
