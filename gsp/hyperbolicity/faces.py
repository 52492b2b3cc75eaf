"""What a sweep records of the verbs of this package."""

from __future__ import annotations

from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.results.point_verbs import Record, records
from gsp.scenes.study import Study


@records("classify", codes={"kind": tuple(Kind)})
def _record_of_classify(study: Study, epsilon: float, tolerance: float) -> Record:
    verdict = classify(study.branch, region=study.region, epsilon=epsilon)
    return {"kind": verdict.kind, "gap": verdict.gap, "holds": verdict.holds, "losses": len(verdict.losses)}
