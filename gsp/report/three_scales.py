"""The nested reduction of a scene that names two small parameters, as its section of the page sets it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import sympy as sp

from gsp.comparison.comparison import Comparison
from gsp.comparison.nested import compare_each
from gsp.nested.nesting import Nesting, nest
from gsp.report.wording import fitted
from gsp.results.equations import OPERATIONS
from gsp.scenes.scene import Scene

if TYPE_CHECKING:
    from gsp.report.sections import Page


@dataclass(frozen=True)
class ThreeScales:
    """A nested reduction with its errors, in both parameters and in each."""

    found: Nesting
    measured: Mapping[str, Comparison]

    @classmethod
    def of(cls, scene: Scene) -> ThreeScales | None:
        """That of a scene; None where it does not name a second small parameter."""
        if not scene.second:
            return None
        # First order in both small parameters: the series through their product.
        found = nest(scene, order=2)
        return cls(found, compare_each(found, orders=(0, 1)))

    def as_dict(self) -> dict[str, Any]:
        """What `gsp nest` says, as plain values."""
        comparisons = {name: each.as_json() for name, each in self.measured.items()}
        return {**self.found.as_dict(), "gaps": dict(self.found.gaps), "comparisons": comparisons}


def three_scales(page: Page, three: ThreeScales) -> dict[str, Any]:
    """Both critical manifolds with their verdicts, the double series, and the slopes in both parameters and in each."""
    found = three.found
    titles = [page.names(found.small), *(page.inline(symbol) for symbol in found.small)]
    manifolds = [
        {
            "name": name,
            "branch": str(study.branch),
            "kind": str(study.hyperbolicity.kind),
            "gap": found.gaps[name],
            "fast": page.names(study.system.y),
        }
        for name, study in (("C1", found.first), ("C2", found.second))
    ]

    def term(powers: tuple[int, int]) -> sp.Expr:
        return sp.Mul(*[symbol**k for symbol, k in zip(found.small, powers)])

    return {
        "small": page.names(found.small),
        "slow": page.names(found.second.system.x),
        "manifolds": manifolds,
        "rows": [
            {
                "power": page.inline(term(powers)),
                "symbol": page.inline(symbol),
                "is_rate": is_rate,
                "coefficient": page.inline(e) if sp.count_ops(e) <= OPERATIONS else "too long to be set here",
            }
            for is_rate, part in ((False, found.manifold), (True, found.reduced_field))
            for powers, row in part.items()
            for symbol, e in row.items()
        ],
        "orders": (0, 1),
        "slopes": [
            {"name": name, "slopes": [fitted(each.slopes[n]) for n in (0, 1)]}
            for name, each in zip(titles, three.measured.values())
        ],
    }
