"""What a sweep records of the verbs of this package."""

from __future__ import annotations

from gsp.proofs.verdict import ProofVerdict
from gsp.results.point_verbs import Record, records
from gsp.scenes.study import Study
from gsp.slow_tubes.certify import certify


@records("certify", codes={"verdict": tuple(ProofVerdict)})
def _record_of_certify(study: Study, epsilon: float, tolerance: float, *, most_boxes: int = 20_000) -> Record:
    proof = certify(study.branch, region=study.region, epsilon=epsilon, most_boxes=most_boxes)
    if proof.is_interrupted:
        raise KeyboardInterrupt
    return {
        "verdict": proof.verdict,
        "gap": proof.gap,
        "boxes": proof.tried,
        "undecided_volume": proof.undecided_volume,
    }
