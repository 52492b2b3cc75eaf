"""gsp: geometric singular perturbation, from a system with two time scales to a measured reduction.

The pipeline, each verb taking the frozen noun of the one before:

    SlowFastSystem, VectorField   declare
    split                         find the slow and the fast variables
    solve_critical                the critical manifold, branch by branch
    continue_critical             one curve of it through its folds, with its special points
    classify                      where it is normally hyperbolic, and how strongly
    expand                        the slow manifold h_epsilon and the reduced field, as exact series
    canard_value                  the parameter of the maximal canard, as an exact series in epsilon
    folded_singularities          folded nodes, saddles, foci and saddle-nodes on a fold curve
    folded_canards, follow_canard the canards of a folded node as orbits, and each over epsilon
    zero_derivative               the slow manifold at points, to machine precision
    solve_manifold                the slow manifold over a region, attracting, repelling or of saddle type
    restrict                      the reduced flow
    integrate                     trajectories of any of these
    project                       where a start off the manifold lands: its fast fibre's base point
    composite                     the initial layer and the slow flow in one approximation
    method_table                  the classical methods side by side
    compare                       the reduced flow against full trajectories
    analyse, write_report         all of it for one scene
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING

__version__ = "0.1.0"

# Nothing heavy is imported before it is used: SymPy, numba and SciPy cost most of a second together.
_HOME = {
    "GspError": "errors",
    "Status": "errors",
    "SlowFastSystem": "system",
    "VectorField": "system",
    "split": "splitting",
    "Splitting": "splitting",
    "solve_critical": "critical",
    "CriticalManifold": "critical",
    "Branch": "critical",
    "continue_critical": "continuation",
    "switch_branch": "continuation",
    "continue_folds": "continuation",
    "critical_sheet": "continuation",
    "CriticalCurve": "continuation",
    "FoldCurve": "continuation",
    "CriticalSheet": "continuation",
    "SpecialPoint": "continuation",
    "SpecialKind": "continuation",
    "Ending": "continuation",
    "classify": "hyperbolicity",
    "Hyperbolicity": "hyperbolicity",
    "canard_value": "singularities",
    "CanardValue": "singularities",
    "match_canard": "singularities",
    "folded_singularities": "singularities",
    "FoldedSingularity": "singularities",
    "zero_derivative": "slow_points",
    "SlowPoints": "slow_points",
    "solve_manifold": "manifold",
    "SampledManifold": "manifold",
    "expand": "series",
    "SeriesManifold": "series",
    "restrict": "reduced",
    "ReducedFlow": "reduced",
    "integrate": "trajectory",
    "Trajectory": "trajectory",
    "Method": "integrators",
    "folded_canards": "canard_orbits",
    "CanardOrbits": "canard_orbits",
    "follow_canard": "canard_orbits",
    "CanardFamily": "canard_orbits",
    "project": "fibres",
    "BasePoint": "fibres",
    "composite": "layers",
    "CompositeSolution": "layers",
    "method_table": "methods",
    "MethodTable": "methods",
    "Scene": "scene",
    "compare": "comparison",
    "Comparison": "comparison",
    "load": "readers",
    "analyse": "analysis",
    "Analysis": "analysis",
    "write_report": "report",
}
_SUBMODULES = ("charts", "mechanics", "models", "readers")

__all__ = ["__version__", *_HOME, "models"]  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from gsp import models as models
    from gsp.analysis import Analysis as Analysis
    from gsp.analysis import analyse as analyse
    from gsp.canard_orbits import CanardFamily as CanardFamily
    from gsp.canard_orbits import CanardOrbits as CanardOrbits
    from gsp.canard_orbits import folded_canards as folded_canards
    from gsp.canard_orbits import follow_canard as follow_canard
    from gsp.comparison import Comparison as Comparison
    from gsp.comparison import compare as compare
    from gsp.continuation import CriticalCurve as CriticalCurve
    from gsp.continuation import CriticalSheet as CriticalSheet
    from gsp.continuation import Ending as Ending
    from gsp.continuation import FoldCurve as FoldCurve
    from gsp.continuation import SpecialKind as SpecialKind
    from gsp.continuation import SpecialPoint as SpecialPoint
    from gsp.continuation import continue_critical as continue_critical
    from gsp.continuation import continue_folds as continue_folds
    from gsp.continuation import critical_sheet as critical_sheet
    from gsp.continuation import switch_branch as switch_branch
    from gsp.critical import Branch as Branch
    from gsp.critical import CriticalManifold as CriticalManifold
    from gsp.critical import solve_critical as solve_critical
    from gsp.errors import GspError as GspError
    from gsp.errors import Status as Status
    from gsp.fibres import BasePoint as BasePoint
    from gsp.fibres import project as project
    from gsp.hyperbolicity import Hyperbolicity as Hyperbolicity
    from gsp.hyperbolicity import classify as classify
    from gsp.integrators import Method as Method
    from gsp.layers import CompositeSolution as CompositeSolution
    from gsp.layers import composite as composite
    from gsp.manifold import SampledManifold as SampledManifold
    from gsp.manifold import solve_manifold as solve_manifold
    from gsp.methods import MethodTable as MethodTable
    from gsp.methods import method_table as method_table
    from gsp.readers import load as load
    from gsp.reduced import ReducedFlow as ReducedFlow
    from gsp.reduced import restrict as restrict
    from gsp.report import write_report as write_report
    from gsp.scene import Scene as Scene
    from gsp.series import SeriesManifold as SeriesManifold
    from gsp.series import expand as expand
    from gsp.singularities import CanardValue as CanardValue
    from gsp.singularities import FoldedSingularity as FoldedSingularity
    from gsp.singularities import canard_value as canard_value
    from gsp.singularities import folded_singularities as folded_singularities
    from gsp.singularities import match_canard as match_canard
    from gsp.slow_points import SlowPoints as SlowPoints
    from gsp.slow_points import zero_derivative as zero_derivative
    from gsp.splitting import Splitting as Splitting
    from gsp.splitting import split as split
    from gsp.system import SlowFastSystem as SlowFastSystem
    from gsp.system import VectorField as VectorField
    from gsp.trajectory import Trajectory as Trajectory
    from gsp.trajectory import integrate as integrate


def __getattr__(name: str) -> object:
    if name in _HOME:
        value = getattr(importlib.import_module(f"gsp.{_HOME[name]}"), name)
    elif name in _SUBMODULES:
        value = importlib.import_module(f"gsp.{name}")
    else:
        raise AttributeError(f"module 'gsp' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if os.environ.get("GSP_EAGER"):
    # CI sets this switch, so that a module that no longer imports is found at once.
    for _name in __all__:
        globals()[_name] if _name in globals() else __getattr__(_name)
