"""Fast fibres: the point of the slow manifold that a start shadows.

Every start near an attracting slow manifold lies on one fast fibre; its base point b is the point of M_epsilon whose
slow motion the solution approaches exponentially (N. Fenichel, Journal of Differential Equations 31 (1979) 53-98).
To first order b_1 = int_0^inf [f(x0, Y_0(tau), 0) - f(x0, h_0(x0), 0)] dtau, Y_0 the layer solution. Two routes, which
check one another: the series in epsilon, and backward shadowing (the full flow forward until the layer is over, the
slow flow back).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.common_units import common_units
from gsp.errors import BranchError, DeclarationError, Status
from gsp.fibres.inner_expansion import InnerExpansion, expand_inner
from gsp.fibres.shadowing import shadow
from gsp.results.card import Card
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import SeriesManifold
from gsp.systems.arguments import check_flag, check_noun
from gsp.systems.declaration import reconstruction_of
from gsp.systems.flow import Point, check_epsilon, check_order


@dataclass(frozen=True, eq=False, repr=False)
class BasePoint(Mapping[str, float], Card):
    """Base point of the fast fibre through `start`: a mapping of slow (and reconstruction) names to values.

    It can be passed as the start of a reduced flow. `coefficients[name]` are those of the powers of epsilon through
    `order`, exact where the layer allows; they are empty, and `order` None, from backward shadowing. `errors[name]`
    are estimates: the first two terms left out, or the disagreement of two shadowing times; not a number where
    the series ends with a term that vanishes. `route` says how it was found.
    """

    branch: Branch
    start: Mapping[str, float]
    epsilon: float
    order: int | None
    coefficients: Mapping[str, tuple]
    errors: Mapping[str, float]
    status: Status
    route: str
    _values: Mapping[str, float]

    @property
    def error(self) -> float:
        """The largest of `errors`."""
        return float(np.max(list(self.errors.values())))

    def how_known(self, name: str) -> str:
        """How far a value is known, in words about {}, its error."""
        is_known = self.errors[name] < abs(self[name])
        return "known to about {}" if is_known else "not known: it may be off by about {}"

    def __getitem__(self, name: str) -> float:
        return self._values[name.name if isinstance(name, sp.Symbol) else name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def at_order(self, order: int) -> dict[str, float]:
        """The values with the series cut at a lower order; raises `DeclarationError` when it is not known so far."""
        if not self.coefficients or self.order is None or not 0 <= order <= self.order:
            raise DeclarationError(
                f"this base point was found by {self.route}, through order {self.order}.",
                "Project again with the order wanted.",
                got=f"order {order!r}",
                value=order,
            )
        return {
            n: sum(float(c[k]) * self.epsilon**k for k in range(order + 1))
            for n, c in self.coefficients.items()
        }

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={value:.10g}" for name, value in self._values.items())
        return f"BasePoint({shown}; epsilon={self.epsilon:g}, {self.route}, error {self.error:.1e})"

    def __str__(self) -> str:
        width = max(map(len, self._values))
        start = self.branch.system.place(self.start)
        lines = [
            f"base point of the fibre through {start} at {self.branch.system.epsilon} = {self.epsilon:g}",
            *(f"  {name:>{width}} = {value:.15g}" for name, value in self._values.items()),
        ]
        for name, terms in self.coefficients.items():
            lines.append(
                f"  {name:>{width}} : " + " + ".join(f"({float(c):.10g}) eps^{k}" for k, c in enumerate(terms))
            )
        error = "error not told" if np.isnan(self.error) else f"estimated error {self.error:.2g}"
        lines.append(f"  {self.route}, {error}, {self.status.name}")
        return "\n".join(lines)


def project(
    manifold,
    start: Point,
    *,
    epsilon: float,
    order: int | None = None,
    numeric: bool = False,
    reconstruction: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> BasePoint:
    """Base point of the fast fibre through `start` on `manifold`, a series, a solved manifold or a branch.

    `start` names every state of the system in standard form. The series route goes through `order`, by default the
    order of the smallest error among 0 to 4; its status is HYPERBOLICITY_LOST where the layer carries the start beyond
    the end of the branch's sheet. It is exact where g is linear in y at epsilon = 0 and the layer's rates are rational.
    With `numeric` backward shadowing is used instead, good to rounding plus the error of the slow
    manifold. On a repelling branch both run backward in time, along unstable fibres. Variables of `reconstruction`
    (name to rate, as for `restrict`) get base points too.

    Raises `BranchError` when the start is outside the basin of the branch, `HyperbolicityError` on a saddle-type branch
    (stable and unstable fibres differ) unless the start is on its stable side, `DeclarationError` for bad arguments.

    >>> from gsp.fibres.base_points import project
    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=eps)
    >>> project(solve_critical(system).branches[0], {"x": 1, "y": 3}, epsilon=0.01, order=2)
    BasePoint(x=0.9797; epsilon=0.01, exact series through order 2, error 8.0e-06)
    """
    check_noun(manifold, (SeriesManifold, SampledManifold, Branch), verb="project")
    value = check_epsilon(epsilon)
    branch = manifold if isinstance(manifold, Branch) else manifold.branch
    check_flag(numeric, what="numeric")
    reconstruction = reconstruction_of(branch.system, reconstruction)
    own = getattr(manifold, "epsilon", None)
    if own is not None and own != value:
        raise DeclarationError(
            f"the manifold was solved at {branch.system.epsilon} = {own:g}.",
            "Solve it at that value.",
            got=f"{branch.system.epsilon} = {value:g}",
            value=value,
        )
    if numeric:
        if order is not None:
            raise DeclarationError(
                "backward shadowing has no order.",
                "Leave one of them out.",
                got=f"order={order!r} with numeric=True",
                value=order,
            )
        surface = None if isinstance(manifold, (Branch, SeriesManifold)) else manifold
        return _shadowed(branch, start, value, reconstruction, surface)
    # Orders tried when none is asked for; the best of them is kept.
    deepest = 4 if order is None else check_order(order)
    inner = expand_inner(
        branch, start, order=deepest + 2, fast_order=deepest + 1, reconstruction=reconstruction
    )
    return base_point_of(inner, value, order)


def base_point_of(inner: InnerExpansion, epsilon: float, order: int | None) -> BasePoint:
    """The base point through epsilon^order, or the best order, from a series two orders longer, or one at its end."""
    if order is not None:
        inner.require(order + 1)
    base = inner.base
    powers = epsilon ** np.arange(inner.order + 1)
    sizes = {name: np.abs(np.array(c[: inner.order + 1], dtype=float)) * powers for name, c in base.items()}
    # The first term left out; one that happens to vanish says nothing, so the pair with its successor counts.
    ended = [0.0] if inner.ending else []
    left_out = {
        name: np.array([max(pair) for pair in pairwise([*own[1:], *ended])]) for name, own in sizes.items()
    }
    if order is None:
        states = [s.name for s in inner.branch.system.states]
        units = dict(
            zip(states, common_units(inner.branch.system, np.array([[inner.start[n] for n in states]])))
        )
        shares = [left_out[name] / units.get(name, own.max() or 1.0) for name, own in sizes.items()]
        order = int(np.argmin(np.max(shares, axis=0)))
    coefficients = {name: c[: order + 1] for name, c in base.items()}
    values = {n: sum(float(c[k]) * epsilon**k for k in range(order + 1)) for n, c in coefficients.items()}
    kind = "exact" if inner.is_exact else "sampled"
    rounding = 4e-16 if inner.is_exact else 1e-14
    # Behind the end of the series nothing but its last term tells the error.
    unknown = inner.ending and not any(own[order] for own in left_out.values())
    errors = {
        name: float("nan") if unknown else float(np.maximum(left_out[name][order], rounding * own.max()))
        for name, own in sizes.items()
    }
    return BasePoint(
        branch=inner.branch,
        start=inner.start,
        epsilon=epsilon,
        _values=MappingProxyType(values),
        order=order,
        coefficients=MappingProxyType(coefficients),
        errors=MappingProxyType(errors),
        status=Status.SUCCESS if _is_over_sheet(inner.branch, values) else Status.HYPERBOLICITY_LOST,
        route=f"{kind} series through order {order}",
    )


def _is_over_sheet(branch: Branch, values: Mapping[str, float]) -> bool:
    """Whether the branch has a point over the slow variables in `values`; an implicit sheet may have ended before."""
    if branch.is_explicit:
        return True
    try:
        branch.points(np.array([[values[s.name] for s in branch.system.x]]))
    except BranchError:
        return False
    return True


def _shadowed(branch: Branch, start, epsilon: float, reconstruction, surface) -> BasePoint:
    found = shadow(branch, start, epsilon=epsilon, reconstruction=reconstruction or {}, surface=surface)
    return BasePoint(
        branch=branch,
        start=MappingProxyType(found.start),
        epsilon=epsilon,
        _values=MappingProxyType(found.values),
        order=None,
        coefficients=MappingProxyType({}),
        errors=MappingProxyType(found.errors),
        status=found.status,
        route=f"backward shadowing over {found.time:.3g}",
    )
