"""Results as tables: labelled arrays for xarray and pandas, and plain JSON (`table_of`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gsp.choice.choice import Choice
from gsp.choice.simulation import Simulation
from gsp.comparison.comparison import Comparison
from gsp.comparison.failure_map import FailureMap
from gsp.comparison.method_table import MethodTable
from gsp.comparison.work_precision import WorkPrecision
from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.critical.continuation.fold_curve import FoldCurve
from gsp.fibres.composite_solution import CompositeSolution
from gsp.integration.ensemble import Ensemble
from gsp.integration.trajectory import Trajectory
from gsp.orbits.canard_orbits.folded_canards import CanardOrbits
from gsp.orbits.periodic.family import OrbitFamily
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.singular.mixed_modes import MixedMode
from gsp.singular.passage.fold_passage import FoldPassage
from gsp.singular.singular_orbit import SingularOrbit
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.slow_points import SlowPoints
from gsp.tables import comparisons, manifolds, passages, runs
from gsp.tables.table import Column, Table

__all__ = ["Column", "Table", "table_of"]

_TABLES: Mapping[type, Callable[[Any], Table]] = {
    CanardOrbits: runs.canard_orbits,
    Choice: comparisons.choice,
    Comparison: comparisons.comparison,
    CompositeSolution: runs.composite_solution,
    CriticalCurve: manifolds.curve,
    CriticalSheet: manifolds.sheet,
    Ensemble: runs.ensemble,
    FailureMap: comparisons.failure_map,
    FoldCurve: manifolds.curve,
    FoldPassage: passages.fold_passage,
    MethodTable: comparisons.method_table,
    MixedMode: passages.mixed_mode,
    OrbitFamily: runs.orbit_family,
    PeriodicOrbit: runs.periodic_orbit,
    SampledManifold: manifolds.sampled_manifold,
    Simulation: runs.simulation,
    SingularOrbit: passages.singular_orbit,
    SlowPoints: manifolds.slow_points,
    Trajectory: runs.trajectory,
    WorkPrecision: comparisons.work_precision,
}


def table_of(result: Any) -> Table:
    """The table of a result that has one, which every `Tabular` has."""
    return _TABLES[type(result)](result)
