"""gsp: geometric singular perturbation, from a system with two time scales to a measured reduction.

The pipeline, each verb taking the frozen noun of the one before:

    SlowFastSystem, VectorField   declare
    split                         find the slow and the fast variables
    solve_critical                the critical manifold, branch by branch
    continue_critical             one curve of it through its folds, with its special points
    classify                      where it is normally hyperbolic, how strongly, and how it ceases to be
    expand                        the slow manifold h_epsilon and the reduced field, as exact series
    canard_value                  the parameter of the maximal canard, as an exact series in epsilon
    folded_singularities          folded nodes, saddles, foci and saddle-nodes on a fold curve
    folded_canards, follow_canard the canards of a folded node as orbits, and each over epsilon
    zero_derivative               the slow manifold at points, to machine precision
    solve_manifold                the slow manifold over a region, attracting, repelling or of saddle type
    restrict                      the reduced flow
    integrate                     trajectories of any of these
    integrate_many                thousands of them, over starts, epsilon and parameters, on all cores
    periodic_orbit                a closed orbit, stable or not, by collocation
    hopf_points, continue_orbits  families of them: from a Hopf point through a canard explosion
    project                       where a start off the manifold lands: its fast fibre's base point
    composite                     the initial layer and the slow flow in one approximation
    fold_passage                  through a fold: delay, drop and exit
    singular_orbit                relaxation in the limit, and its period through epsilon ln epsilon
    mixed_mode                    large and small swings of a run, counted
    entry_exit                    how long an orbit stays on a branch that has lost its stability
    method_table                  the classical methods side by side
    compare                       the reduced flow against full trajectories
    work_precision                error against seconds: every integrator, and reduced models of every order
    failure_map                   where each method holds, measured
    choose                        the cheapest model that meets a scene's tolerance, "no" among the answers
    simulate                      that model over the span, the full system where it does not hold
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
    "BeyondReachWarning": "errors",
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
    "Loss": "losses",
    "LossKind": "losses",
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
    "integrate_many": "ensemble",
    "Ensemble": "ensemble",
    "Event": "events",
    "Method": "solvers",
    "periodic_orbit": "periodic",
    "PeriodicOrbit": "periodic",
    "shoot": "periodic",
    "hopf_points": "periodic",
    "HopfPoint": "periodic",
    "continue_orbits": "periodic",
    "OrbitFamily": "periodic",
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
    "fold_passage": "passage",
    "FoldPassage": "passage",
    "fold_exit": "passage",
    "fit_omega0": "passage",
    "entry_exit": "passage",
    "DelayedExit": "passage",
    "measure_delay": "passage",
    "follow": "passage",
    "Scene": "scene",
    "compare": "comparison",
    "Comparison": "comparison",
    "work_precision": "work_curves",
    "WorkPrecision": "work_curves",
    "failure_map": "failures",
    "FailureMap": "failures",
    "choose": "choice",
    "Choice": "choice",
    "simulate": "simulation",
    "Simulation": "simulation",
    "singular_orbit": "relaxation",
    "SingularOrbit": "relaxation",
    "mixed_mode": "mixed_modes",
    "MixedMode": "mixed_modes",
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
    from gsp.choice import Choice as Choice
    from gsp.choice import choose as choose
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
    from gsp.ensemble import Ensemble as Ensemble
    from gsp.ensemble import integrate_many as integrate_many
    from gsp.errors import BeyondReachWarning as BeyondReachWarning
    from gsp.errors import GspError as GspError
    from gsp.errors import Status as Status
    from gsp.events import Event as Event
    from gsp.failures import FailureMap as FailureMap
    from gsp.failures import failure_map as failure_map
    from gsp.fibres import BasePoint as BasePoint
    from gsp.fibres import project as project
    from gsp.hyperbolicity import Hyperbolicity as Hyperbolicity
    from gsp.hyperbolicity import classify as classify
    from gsp.layers import CompositeSolution as CompositeSolution
    from gsp.layers import composite as composite
    from gsp.losses import Loss as Loss
    from gsp.losses import LossKind as LossKind
    from gsp.manifold import SampledManifold as SampledManifold
    from gsp.manifold import solve_manifold as solve_manifold
    from gsp.methods import MethodTable as MethodTable
    from gsp.methods import method_table as method_table
    from gsp.mixed_modes import MixedMode as MixedMode
    from gsp.mixed_modes import mixed_mode as mixed_mode
    from gsp.passage import DelayedExit as DelayedExit
    from gsp.passage import FoldPassage as FoldPassage
    from gsp.passage import entry_exit as entry_exit
    from gsp.passage import fit_omega0 as fit_omega0
    from gsp.passage import fold_exit as fold_exit
    from gsp.passage import fold_passage as fold_passage
    from gsp.passage import follow as follow
    from gsp.passage import measure_delay as measure_delay
    from gsp.periodic import HopfPoint as HopfPoint
    from gsp.periodic import OrbitFamily as OrbitFamily
    from gsp.periodic import PeriodicOrbit as PeriodicOrbit
    from gsp.periodic import continue_orbits as continue_orbits
    from gsp.periodic import hopf_points as hopf_points
    from gsp.periodic import periodic_orbit as periodic_orbit
    from gsp.periodic import shoot as shoot
    from gsp.readers import load as load
    from gsp.reduced import ReducedFlow as ReducedFlow
    from gsp.reduced import restrict as restrict
    from gsp.relaxation import SingularOrbit as SingularOrbit
    from gsp.relaxation import singular_orbit as singular_orbit
    from gsp.report import write_report as write_report
    from gsp.scene import Scene as Scene
    from gsp.series import SeriesManifold as SeriesManifold
    from gsp.series import expand as expand
    from gsp.simulation import Simulation as Simulation
    from gsp.simulation import simulate as simulate
    from gsp.singularities import CanardValue as CanardValue
    from gsp.singularities import FoldedSingularity as FoldedSingularity
    from gsp.singularities import canard_value as canard_value
    from gsp.singularities import folded_singularities as folded_singularities
    from gsp.singularities import match_canard as match_canard
    from gsp.slow_points import SlowPoints as SlowPoints
    from gsp.slow_points import zero_derivative as zero_derivative
    from gsp.solvers import Method as Method
    from gsp.splitting import Splitting as Splitting
    from gsp.splitting import split as split
    from gsp.system import SlowFastSystem as SlowFastSystem
    from gsp.system import VectorField as VectorField
    from gsp.trajectory import Trajectory as Trajectory
    from gsp.trajectory import integrate as integrate
    from gsp.work_curves import WorkPrecision as WorkPrecision
    from gsp.work_curves import work_precision as work_precision


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
