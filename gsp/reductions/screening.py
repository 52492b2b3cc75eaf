"""How near a run stays to where a part of the field is at rest: which candidates are worth a measurement."""

from __future__ import annotations

import numpy as np

from gsp.algebra.differentiation import jacobian
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_function
from gsp.reductions.fast_parts import FastPart
from gsp.systems.system import VectorField


def defect(field: VectorField, part: FastPart, run: Trajectory, times: np.ndarray) -> float:
    """The middle one of the distances from the run at `times` to f = 0 along N, relative to the sizes of the states.

    A place counts as infinitely far where f = 0 is not reached along N, as at a start at which its rates are singular,
    or does not attract.
    """
    states = field.states
    values = dict(field.parameters)
    N = np.array([[float(d[s].xreplace(values)) if s in d else 0.0 for d in part.directions] for s in states])
    outputs = (*part.rates, *jacobian(part.rates, states))
    function = compile_function(outputs, arguments=states, epsilon=None, parameters=tuple(field.parameters))
    constants = compile_flow(field).constants
    places = np.ascontiguousarray(run.at(times).T)
    size = np.abs(places).max(axis=0)
    r = len(part.rates)
    moved, alive = places.copy(), np.ones(len(places), dtype=bool)
    with np.errstate(all="ignore"):
        # Newton's steps from a place of the run.
        for _ in range(12):
            values = function(moved, constants)
            inner = values[:, r:].reshape(-1, r, len(states)) @ N
            alive &= np.isfinite(values).all(axis=1)
            # A rank would be that in the states' units, which may be decades apart.
            alive[alive] &= np.linalg.slogdet(inner[alive])[0] != 0.0
            step = np.zeros((len(places), r))
            step[alive] = np.linalg.solve(inner[alive], -values[alive, :r, None])[..., 0]
            moved += step @ N.T
        values = function(moved, constants)
        inner = values[:, r:].reshape(-1, r, len(states)) @ N
        alive &= np.isfinite(values).all(axis=1)
        inner[~alive] = 0.0
        attracts = (np.linalg.eigvals(inner).real < 0.0).all(axis=1)
        distance = (np.abs(moved - places) / np.where(size > 0.0, size, 1.0)).max(axis=1)
    return float(np.median(np.where(attracts, distance, np.inf)))
