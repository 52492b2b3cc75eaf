"""A proof about a slow manifold as a file: what `tube_checker` reads, every number a hexadecimal double.

The expressions are those of z0, z1, ...: the slow variables, the parameters of the region, the fast variables (in
`remainder`, which is Gamma, the tube's coordinates in their place) and epsilon.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from gsp.algebra.precision import precision
from gsp.errors import GspError
from gsp.proofs import balls, tube_checker
from gsp.proofs.equations import without_decimals
from gsp.proofs.programs import NotRational, Rejected
from gsp.proofs.verdict import require_proved
from gsp.results.files import write_file
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.isolation import Tally
from gsp.slow_tubes.tube_search import Cones, TubeSearch

if TYPE_CHECKING:
    from gsp.slow_tubes.slow_tube import SlowTube

# What is claimed, as shares of the widths, of epsilon and of the steepness of the collar: the checker encloses less
# sharply at the border.
CLAIMS = (
    (1.0, 1.0, 1.0),
    (1.01, 1.0, 1.0),
    (1.01, 1.0, 0.9),
    (1.05, 0.98, 0.8),
    (1.1, 0.95, 0.7),
    (1.25, 0.9, 0.6),
    (1.5, 0.75, 0.5),
    (1.5, 0.5, 0.5),
)


def write(tube: SlowTube, path: Path) -> None:
    """Write the proof; raises `GspError` when there is none or the checker does not follow it, `OutputError` when the
    file cannot be written.
    """
    require_proved(tube.verdict, tube.reason, "Shrink the region or lower epsilon.")
    with precision(balls.PRECISION):
        text = json.dumps(_accepted(tube), separators=(",", ":"), allow_nan=False)
    write_file((text + "\n").encode(), path)


def _accepted(tube: SlowTube) -> dict:
    """The proof as plain values, of the largest claim that the checker follows."""
    assert tube._proof is not None
    proof, series = tube._proof, tube.series
    system = series.branch.system
    parameters = [p for p in system.parameters if p.name in tube.region]
    values = {p: without_decimals(v) for p, v in system.parameters.items() if p not in parameters}
    invariance = Invariance(series, parameters=parameters, values=values, basis=proof.basis.matrix)
    search = TubeSearch(invariance, proof.basis, tuple(tube.region.values()), Tally(1))
    plain = _expressions(tube, invariance, values)
    refused = ""
    for wider, share, less in CLAIMS:
        cones = [replace(cone, collar=less * cone.collar) for cone in proof.cones]
        written = plain | _claim(search, wider * proof.widths, share * tube.epsilon_0, cones, tube)
        try:
            tube_checker.check(written)
        except NotRational as error:
            raise GspError(
                f"the checker does not follow this proof: {error}.",
                "A tube of such a system has no file; what is proved holds.",
            ) from None
        except Rejected as error:
            refused = str(error)
            continue
        return written
    raise GspError(
        f"the checker does not follow this proof: {refused}.",
        "It cannot be saved. Shrink the region or lower epsilon.",
    )


def _expressions(tube: SlowTube, invariance: Invariance, values: dict[sp.Symbol, sp.Expr]) -> dict:
    series, system = tube.series, tube.series.branch.system
    symbols = (*invariance.x, *system.y, system.epsilon)
    plain = {s: sp.Symbol(f"z{i}") for i, s in enumerate(symbols)}
    plain |= {s: plain[y] for s, y in zip(invariance.z, system.y)}

    def text(expression: sp.Expr) -> str:
        return sp.sstr(without_decimals(expression.xreplace(values)).xreplace(plain), full_prec=False)

    return {
        "format": tube_checker.FORMAT,
        "slow": [s.name for s in system.x],
        "parameters": [s.name for s in invariance.x[len(system.x) :]],
        "fast": [s.name for s in system.y],
        "epsilon_name": system.epsilon.name,
        "rates": [text(e) for e in system.f],
        "equations": [text(e) for e in system.g],
        "series": [[text(e) for e in row] for row in series.coefficients],
        "basis": [text(e) for e in invariance.basis],
        "remainder": [text(e) for e in invariance.gamma],
        "region": [[float(end).hex() for end in side] for side in tube.region.values()],
    }


def _claim(search: TubeSearch, widths: np.ndarray, epsilon: float, cones: list[Cones], tube: SlowTube) -> dict:
    steps = [replace(c, high=min(c.high, epsilon)) for c in cones if c.low < epsilon]
    collar = 0.0
    if not tube.is_unique:
        # A little wider than they need: the checker encloses the slow field in its own way.
        collar = 1.1 * max(search.fastest(search.over(c.low, c.high), widths) / c.collar for c in steps)
    return {
        "epsilon": epsilon.hex(),
        "blocks": [list(block) for block in search.basis.blocks],
        "signs": list(search.basis.signs),
        "widths": [float(v).hex() for v in widths],
        # A rounding more than the bound, which the checker rounds in its own way.
        "reach": [math.nextafter(v * (1.0 + 1e-12), math.inf).hex() for v in search.half_widths(widths)],
        "boundary": tube.boundary,
        "unique": tube.is_unique,
        "collar": collar.hex(),
        "cones": [{key: getattr(c, key).hex() for key in ("low", "high", "slope", "collar")} for c in steps],
    }
