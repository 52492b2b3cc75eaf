"""A proof as a file: JSON, every number a hexadecimal double, so that nothing is rounded on the way.

`names` are the slow variables and the parameters of the box, then the fast variables; in the expressions they are z0,
z1, ..., and their grammar is that of `checker`. `region` is the box. `tree` lists the parts in the order root, lower
half, upper half: a cut {"axis", "at", "glue"} or a piece {"box", "middle", "centre", "slope", "radius", "inverse",
"basis", "signs"}, matrices row by row; the glue is a tube over the one point `middle`. `claim` says what is claimed
of all of it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from gsp.algebra.precision import precision
from gsp.errors import GspError
from gsp.proofs import balls, checker, intervals, untrusted
from gsp.proofs.covering import Part, glue, refine
from gsp.proofs.tubes import RootTube
from gsp.proofs.verdict import require_proved
from gsp.results.bounds import shown_sides
from gsp.results.files import write_file

if TYPE_CHECKING:
    from gsp.proofs.certificate import Certificate

# Shares of the gap that are claimed, round by round; between rounds the boxes that the checker refuses are cut, with
# such room for their tubes. Where a matrix is constant its bound is met with equality, and where the checker encloses
# less sharply it needs more boxes.
SHARES = (1.0 - 2.0**-40, 1.0 - 2.0**-40, 0.999, 0.99, 0.99, 0.9, 0.9, 0.9, 0.5, 0.5)
ROOMS = (2.0, 4.0, 8.0, 8.0, 16.0, 16.0, 32.0, 32.0, 64.0, 64.0)


def write(certificate: Certificate, path: Path) -> None:
    """Write the proof; raises `GspError` when there is none, `OutputError` when the file cannot be written."""
    require_proved(certificate.verdict, certificate.reason, "Shrink the region or raise most_boxes.")
    text = json.dumps(_accepted(certificate), indent=None, separators=(",", ":"), allow_nan=False)
    if len(text) >= untrusted.MOST_BYTES:
        raise GspError(
            f"a proof file has at most {untrusted.MOST_BYTES} bytes.",
            "Shrink the region.",
            got=f"{len(text)} bytes",
        )
    write_file((text + "\n").encode(), path)


def _accepted(certificate: Certificate) -> dict:
    """The proof as plain values; parts that the checker's own derivatives enclose less sharply are cut until they
    pass.
    """
    covering, equations = certificate._covering, certificate._equations
    with precision(balls.PRECISION):
        for share, margin in zip(SHARES, ROOMS):
            written = as_json(certificate, share)
            try:
                places = checker.refused(written)
            except checker.Rejected as error:
                raise GspError(
                    f"the checker does not follow this proof: {error}.", "It cannot be saved."
                ) from None
            if not places:
                return written
            parts = list(covering.root.nodes())
            if not all(refine(equations, parts[place], margin=margin) for place in places) or glue(
                equations, covering
            ):
                break
    first = min(places)
    box = shown_sides(dict(zip(certificate.region, parts[first].box)))
    raise GspError(
        f"the checker does not follow this proof: of the parts that its boxes were cut into it refuses {len(places)}. "
        f"Of the first, over {box}, it says: {places[first]}.",
        f"Take a region without this place, or larger units: the checker rounds to 2^-{intervals.SHIFT}, about "
        f"{2.0**-intervals.SHIFT:.2g}.",
    )


def as_json(certificate: Certificate, share: float) -> dict:
    """The proof as plain values, of a `share` of the gap."""
    equations = certificate._equations
    plain = {s: sp.Symbol(f"z{i}") for i, s in enumerate(equations.arguments)}
    return {
        "format": checker.FORMAT,
        "names": [s.name for s in equations.arguments],
        "over": equations.n,
        "equations": [_text(e, plain) for e in equations.equations],
        "region": [_numbers(side) for side in certificate.region.values()],
        "through": _numbers(certificate.through.values()),
        "claim": {
            "stable": certificate.stable,
            "unstable": certificate.unstable,
            "gap": float(share * certificate._covering.gap).hex(),
        },
        "tree": _nodes(certificate._covering.root),
    }


def _text(expression: sp.Expr, plain: dict[sp.Symbol, sp.Symbol]) -> str:
    return sp.sstr(expression.xreplace(plain), full_prec=False)


def _numbers(values) -> list[str]:
    return [float(v).hex() for v in np.ravel(list(values))]


def _nodes(root: Part) -> list[dict]:
    nodes = []
    for part in root.nodes():
        if part.halves is not None:
            assert part.glue is not None
            nodes.append({"axis": part.axis, "at": float(part.at).hex(), "glue": _tube(part.glue)})
        else:
            assert part.piece is not None
            assert part.piece.spectrum is not None
            nodes.append(
                {
                    "box": _numbers(part.box),
                    **_tube(part.piece.tube),
                    "basis": _numbers(part.piece.spectrum.basis),
                    "signs": [int(s) for s in part.piece.spectrum.signs],
                }
            )
    return nodes


def _tube(tube: RootTube) -> dict[str, list[str]]:
    keys = ("middle", "centre", "slope", "radius", "inverse")
    return {key: _numbers(getattr(tube, key)) for key in keys}
