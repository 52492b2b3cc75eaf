"""Charts, tables and equations of the nouns of this package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import sympy as sp

from gsp.averaging.averaging import Averaging
from gsp.results.equations import Equation
from gsp.results.registry import Makers, charts, equations, tables
from gsp.results.table import Column, Table, texts


@tables.of(Averaging)
def _table_of_averaging(found: Averaging) -> Table:
    """A row for each variable and power of epsilon: the coefficient in its rate, and in the transformation.

    The rate of the phase is that times epsilon; what is not known, or not there, is empty.
    """
    powers = range(found.order + 2)
    symbols = [*found.form.rates, found.form.phase]
    rates = {s: [row[s] for row in found.averaged_field] for s in found.form.rates}
    rates[found.form.phase] = list(found.frequency)
    shifts = {s: [row[s] for row in found.transformation] for s in symbols}
    both = ("variable", "power")

    def column(terms: Mapping[sp.Symbol, Sequence[sp.Expr]], first: int) -> Column:
        rows = [
            [str(terms[s][k - first]) if 0 <= k - first < len(terms[s]) else "" for k in powers]
            for s in symbols
        ]
        return Column(both, np.array([texts(row) for row in rows]))

    coordinates = {
        "variable": Column(("variable",), texts(s.name for s in symbols)),
        "power": Column(("power",), np.array(powers)),
    }
    variables = {"rate": column(rates, 0), "shift": column(shifts, 1)}
    return Table(
        "Averaging", coordinates, variables, {"phase": found.form.phase.name, "order": found.order}, both
    )


@equations.of(Averaging)
def _equations_of_averaging(found: Averaging) -> list[Equation]:
    """The averaged field, then the rate of the phase."""
    slow = [
        Equation(s, tuple(row[s] for row in found.averaged_field), dotted=True, epsilon=found.epsilon)
        for s in found.form.rates
    ]
    return [
        *slow,
        Equation(found.form.phase, found.frequency, dotted=True, factor=found.epsilon, epsilon=found.epsilon),
    ]


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {Averaging: drawn.averaging}
