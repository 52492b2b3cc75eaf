"""The charts of proofs about relaxation cycles and passages."""

from __future__ import annotations

from gsp.cycles.cycle_certificate import CycleCertificate
from gsp.cycles.passage_certificate import PassageCertificate
from gsp.results.registry import Makers, charts


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {CycleCertificate: drawn.cycle_annulus, PassageCertificate: drawn.passage_strip}
