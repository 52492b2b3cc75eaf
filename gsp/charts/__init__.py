"""Every figure of the package: a result and an optional Axes in, Axes out.

The only place that imports matplotlib, and nothing is computed here but pictures. `save` and `png` write the
figure that an Axes belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from gsp.analysis.analysis import Analysis
from gsp.analysis.ramp_answers import drawn_ramp
from gsp.charts.accuracy import error_against_epsilon
from gsp.charts.averaging import averaging
from gsp.charts.canard_orbits import canard_orbits, canard_section
from gsp.charts.contacts import no_slip
from gsp.charts.continuation import critical_curve, critical_sheet
from gsp.charts.explosion import canard_cycles, canard_explosion
from gsp.charts.failures import failure_map, failures_along, failures_by_tolerance
from gsp.charts.manifolds import approaches, distance, manifold
from gsp.charts.methods import composite, method_errors
from gsp.charts.nested import nesting
from gsp.charts.orbits import convergence, path, phase_portrait, time_series
from gsp.charts.passage import delayed_exit, fold_passage, passage_strip
from gsp.charts.proofs import has_boxes, proof
from gsp.charts.ramps import critical_rate, rate_diagram
from gsp.charts.relaxation import cycle_annulus, mixed_mode, relaxation, singular_orbit
from gsp.charts.runs import periodic_orbit, spread, trajectory
from gsp.charts.sampling import heading_of, shape, slow_ends
from gsp.charts.spectrum import eigenvalues, has_constant_eigenvalues
from gsp.charts.style import add_units, check_chart_name, drawn, png, save
from gsp.charts.switching import switches
from gsp.charts.time_scales import time_scales
from gsp.charts.views import view
from gsp.charts.work_curves import work_precision
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.cycles.passage_certificate import PassageCertificate
from gsp.errors import DeclarationError
from gsp.results.attempts import attempt
from gsp.results.registry import draw
from gsp.singular.mixed_modes import MixedMode
from gsp.systems.arguments import check_noun

__all__ = [
    "applicable",
    "averaging",
    "canard_cycles",
    "canard_explosion",
    "canard_orbits",
    "canard_section",
    "check_chart_name",
    "composite",
    "convergence",
    "critical_curve",
    "critical_rate",
    "critical_sheet",
    "cycle_annulus",
    "delayed_exit",
    "distance",
    "draw",
    "drawn",
    "eigenvalues",
    "error_against_epsilon",
    "failure_map",
    "failures_along",
    "failures_by_tolerance",
    "fold_passage",
    "has_constant_eigenvalues",
    "heading_of",
    "manifold",
    "method_errors",
    "mixed_mode",
    "nesting",
    "no_slip",
    "passage_strip",
    "path",
    "periodic_orbit",
    "phase_portrait",
    "png",
    "proof",
    "rate_diagram",
    "relaxation",
    "save",
    "shape",
    "singular_orbit",
    "slow_ends",
    "spread",
    "surroundings",
    "switches",
    "time_scales",
    "time_series",
    "trajectory",
    "view",
    "work_precision",
]


def surroundings(analysis: Analysis) -> Axes:
    """The critical manifold around the scene's region, through its folds: a curve or a sheet."""
    check_noun(analysis, Analysis, verb="charts.surroundings")
    found = analysis.surroundings
    if found is None:
        raise DeclarationError(
            "the critical manifold of this analysis is an explicit graph, or over more than two slow "
            "variables.",
            "Draw `manifold` instead.",
            got="no curve and no sheet",
        )
    drawn = critical_sheet(found) if isinstance(found, CriticalSheet) else critical_curve(found)
    return _with_units(analysis, drawn)


def _with_units(analysis: Analysis, axes: Axes) -> Axes:
    """The axes of a result that knows no scene, with the scene's units."""
    add_units(axes, analysis.scene.units)
    return axes


def _failures(analysis: Analysis) -> Axes:
    assert analysis.failures is not None
    return failure_map(analysis.failures, stacked=True)


def _phenomenon(analysis: Analysis) -> Axes:
    found = analysis.phenomenon
    return _with_units(analysis, mixed_mode(found)) if isinstance(found, MixedMode) else relaxation(analysis)


def applicable(analysis: Analysis) -> Mapping[str, Callable[[Analysis], Axes]]:
    """The charts that say something about this analysis, by name, in the order of a report.

    One that needs what the analysis has lost is among them: drawing it raises the reason.
    """
    check_noun(analysis, Analysis, verb="charts.applicable")
    charts: dict[str, Callable[[Analysis], Axes]] = {}
    # The whole phenomenon first.
    if analysis.scene.path is not None:
        charts["path"] = path
    for name in analysis.scene.views:
        charts[f"view_{name}"] = partial(view, name=name)
    if "phenomenon" in analysis.lost or analysis.phenomenon is not None:
        charts["phenomenon"] = _phenomenon
    if "no_slip" in analysis.lost or analysis.no_slip is not None:
        charts["no_slip"] = lambda result: no_slip(result.no_slip)
    if attempt("the ramps", lambda: drawn_ramp(analysis.scene)) is not None:
        charts["ramp"] = lambda result: critical_rate(drawn_ramp(result.scene))
    charts["phase_portrait"] = phase_portrait
    if (
        analysis.hyperbolicity.failing
        or attempt("the eigenvalues", lambda: has_constant_eigenvalues(analysis)) is not True
    ):
        charts["eigenvalues"] = eigenvalues
    if has_boxes(analysis):
        charts["proof"] = proof
    if "boundary" in analysis.lost or analysis.surroundings is not None:
        charts["critical_manifold"] = surroundings
    # In higher dimensions `manifold` is the distance already, and nothing when no run lands.
    seen = shape(analysis) in ((1, 1), (2, 1))
    # Where runs start the manifold may not be known.
    lands = "landing" in analysis.lost or bool(attempt("the distances", lambda: approaches(analysis)))
    if seen or lands:
        charts["manifold"] = manifold
    if seen and lands:
        charts["distance"] = distance
    if "comparison" in analysis.lost or np.isfinite([*analysis.comparison.errors.values()]).any():
        charts["error_against_epsilon"] = lambda result: error_against_epsilon(result.comparison)
    charts["time_series"] = time_series
    charts["convergence"] = convergence
    if analysis.failures is not None:
        charts["failure_map"] = _failures
    proved = attempt("the passage", lambda: analysis.boundary.passage)
    if isinstance(proved, PassageCertificate) and proved.epsilon_0 > 0.0:
        charts["passage"] = lambda result: _with_units(result, passage_strip(result.boundary.passage))
    return charts
