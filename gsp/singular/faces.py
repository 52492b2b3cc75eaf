"""Charts, tables and equations of the nouns of this package, and what a sweep records of its verbs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import sympy as sp

from gsp.results.equations import Equation, rates_of
from gsp.results.point_verbs import Labels, Record, records
from gsp.results.registry import Makers, charts, equations, tables
from gsp.results.table import Column, Table, names_of, texts
from gsp.scenes.study import Study
from gsp.singular.blow_up.blow_up import BlowUp
from gsp.singular.blow_up.chart import BlowUpChart
from gsp.singular.mixed_modes import MixedMode
from gsp.singular.passage.fold_passage import FoldPassage
from gsp.singular.ramps.critical_rate import CriticalRate
from gsp.singular.ramps.ramp_run import RampRun
from gsp.singular.ramps.rate_diagram import RateDiagram
from gsp.singular.singular_orbit import SingularOrbit
from gsp.singular.singularities.canard_value import CanardValue, canard_value


@tables.of(SingularOrbit)
def _table_of_singular_orbit(orbit: SingularOrbit) -> Table:
    """A row for each point of the slow pieces; for each piece how long it is, its fold and where the drop leads."""
    system = orbit.branch.system
    states = [s.name for s in system.states]
    names = names_of(system)
    point, piece = names("point"), names("piece")
    time, number = names("t"), names("number")
    runs = [p.run for p in orbit.pieces]
    begins = np.concatenate([[0.0], np.cumsum([p.duration for p in orbit.pieces])])
    over, each = (point,), (piece,)
    coordinates = {
        point: Column(over, np.arange(sum(run.t.size for run in runs))),
        number: Column(over, np.repeat(np.arange(len(runs)), [run.t.size for run in runs])),
        time: Column(
            over, np.concatenate([run.t - run.t[0] + begin for run, begin in zip(runs, begins, strict=False)])
        ),
        piece: Column(each, np.arange(len(runs))),
    }
    variables = {name: Column(over, np.concatenate([run[name] for run in runs])) for name in states}
    folds = [p.fold for p in orbit.pieces]
    variables[names("duration")] = Column(each, np.array([p.duration for p in orbit.pieces]))
    variables[names("status")] = Column(each, texts(run.status.name for run in runs))
    variables[names("drop")] = Column(each, texts("" if f is None else f.drop.kind.name for f in folds))
    for name in states:
        places = ({} if f is None else f.point for f in folds)
        variables[names(f"fold_{name}")] = _values(each, places, name)
        places = ({} if f is None else {**f.point, **f.drop.point} for f in folds)
        variables[names(f"landing_{name}")] = _values(each, places, name)
    attributes = {"message": orbit.message, "period_pieces": orbit.period_pieces}
    if orbit.coefficients is not None:
        attributes |= {f"T_{k}": value for k, value in enumerate(orbit.coefficients)}
    return Table("SingularOrbit", coordinates, variables, attributes, over)


@tables.of(MixedMode)
def _table_of_mixed_mode(mode: MixedMode) -> Table:
    """A row for each swing: when it ends, its size, and whether it is a large one."""
    over = ("swing",)
    coordinates = {"swing": Column(over, np.arange(mode.sizes.size)), "t": Column(over, mode.times)}
    variables = {"size": Column(over, mode.sizes), "is_large": Column(over, mode.is_large)}
    attributes = {
        "name": mode.name, "signature": mode.signature, "repeats": mode.repeats, "status": mode.run.status.name,
        "message": mode.run.message,
    }  # fmt: skip
    return Table("MixedMode", coordinates, variables, attributes, over)


@tables.of(FoldPassage)
def _table_of_fold_passage(passage: FoldPassage) -> Table:
    """A row for each slow variable: the fold, its rates there, and what multiplies the powers of epsilon."""
    slow, fast = ("slow",), ("fast",)
    landing = [passage.drop.point.get(s.name, np.nan) for s in passage.system.y]
    coordinates = {
        "slow": Column(slow, texts(s.name for s in passage.system.x)),
        "fast": Column(fast, texts(s.name for s in passage.system.y)),
    }
    variables = {
        "fold": Column(slow, passage.x0),
        "slow_rate": Column(slow, passage.slow_rate),
        "along": Column(slow, passage.along),
        "leading": Column(slow, passage.leading),
        "logarithmic": Column(slow, passage.logarithmic),
        "fast_fold": Column(fast, passage.y0),
        "right": Column(fast, passage.right),
        "left": Column(fast, passage.left),
        "landing": Column(fast, np.array(landing, dtype=float)),
    }
    attributes = {
        "a": passage.a,
        "b": passage.b,
        "c": passage.c,
        "d": passage.d,
        "drop": passage.drop.kind.name,
    }
    return Table("FoldPassage", coordinates, variables, attributes, slow)


@tables.of(CriticalRate)
def _table_of_critical_rate(found: CriticalRate) -> Table:
    """A row for each critical rate."""
    over = ("threshold",)
    coordinates = {"threshold": Column(over, np.arange(len(found.rates)))}
    variables = {
        "rate": Column(over, np.array(found.rates, dtype=float)),
        "error": Column(over, np.array(found.errors, dtype=float)),
    }
    attributes = {"verdict": str(found.verdict), "message": found.message, "ramp": str(found.ramped.ramp)}
    for what, point in (("start", found.start), ("edge", found.edge or {})):
        attributes |= {f"{what}_{name}": value for name, value in point.items()}
    return Table("CriticalRate", coordinates, variables, attributes, over)


@tables.of(RateDiagram)
def _table_of_rate_diagram(found: RateDiagram) -> Table:
    """A row for each threshold of each amplitude."""
    over, both = ("amplitude",), ("amplitude", "threshold")
    rates = found.rates
    coordinates = {
        "amplitude": Column(over, found.amplitudes),
        "threshold": Column(("threshold",), np.arange(rates.shape[1])),
    }
    variables = {
        "rate": Column(both, rates),
        "verdict": Column(over, texts(str(each.verdict) for each in found.found)),
    }
    return Table("RateDiagram", coordinates, variables, {"ramp": str(found.ramp)}, both)


@tables.of(RampRun)
def _table_of_ramp_run(run: RampRun) -> Table:
    """A row for each time: the phase, the states and the parameters that move."""
    names = names_of(run.ramped.field)
    time = names("t")
    over = (time,)
    states = {x.name: run.x[:, i] for i, x in enumerate(run.ramped.field.states)}
    moved = {name: values for name, values in run.ramped.moved(run.phase).items() if name not in states}
    variables = {name: Column(over, values) for name, values in (states | moved).items()}
    variables.setdefault(run.ramped.ramp.phase.name, Column(over, run.phase))
    attributes = {"rate": run.rate, "status": run.status.name}
    return Table("RampRun", {time: Column(over, run.t)}, variables, attributes, over)


def _values(each: tuple[str, ...], places: Iterable[Mapping[str, float]], name: str) -> Column:
    return Column(each, np.array([place.get(name, np.nan) for place in places], dtype=float))


@equations.of(CanardValue)
def _equations_of_canard_value(value: CanardValue) -> list[Equation]:
    parameter = sp.Symbol(str(value.parameter))
    return [Equation(parameter, tuple(value.coefficients), epsilon=value.system.epsilon)]


@equations.of(BlowUp)
def _equations_of_blow_up(found: BlowUp) -> list[Equation]:
    """The leading field, then all charts."""
    leading = rates_of((z, rate) for z, rate in found.field.rates.items() if rate != 0)
    return [*leading, *(equation for chart in found.charts for equation in _equations_of_chart(chart))]


@equations.of(BlowUpChart)
def _equations_of_chart(chart: BlowUpChart) -> list[Equation]:
    """The change of variables and the rates, of r too where it moves."""
    changes = [Equation(z, (image,)) for z, image in chart.substitution.items()]
    return [*changes, *rates_of((Z, rate) for Z, rate in chart.rates.items() if rate != 0)]


def _each_power(study: Study, *, order: int = 4, **_: object) -> Labels:
    return {"coefficients": {"power": tuple(range(order + 1))}}


@records("canard_value", labels=_each_power)
def _record_of_canard_value(
    study: Study, epsilon: float, tolerance: float, *, parameter: str, order: int = 4, digits: int = 10
) -> Record:
    found = canard_value(study.system, parameter=parameter, order=order)
    return {
        "value": found.value(epsilon, digits=digits),
        "coefficients": found.coefficients,
        "is_exact": found.is_exact,
    }


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {
        CriticalRate: drawn.critical_rate,
        MixedMode: drawn.mixed_mode,
        RateDiagram: drawn.rate_diagram,
        SingularOrbit: drawn.singular_orbit,
    }
