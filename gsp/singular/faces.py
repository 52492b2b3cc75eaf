"""Charts, tables and equations of the nouns of this package."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import sympy as sp

from gsp.results.equations import Equation
from gsp.results.registry import Makers, charts, equations, tables
from gsp.results.table import Column, Table, names_of, texts
from gsp.singular.mixed_modes import MixedMode
from gsp.singular.passage.fold_passage import FoldPassage
from gsp.singular.singular_orbit import SingularOrbit
from gsp.singular.singularities.canard_value import CanardValue


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


def _values(each: tuple[str, ...], places: Iterable[Mapping[str, float]], name: str) -> Column:
    return Column(each, np.array([place.get(name, np.nan) for place in places], dtype=float))


@equations.of(CanardValue)
def _equations_of_canard_value(value: CanardValue) -> list[Equation]:
    parameter = sp.Symbol(str(value.parameter))
    return [Equation(parameter, tuple(value.coefficients), epsilon=value.system.epsilon)]


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {MixedMode: drawn.mixed_mode, SingularOrbit: drawn.singular_orbit}
