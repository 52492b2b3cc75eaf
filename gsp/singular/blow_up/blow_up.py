"""`blow_up`: weights, charts and powers of epsilon of a nilpotent point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import sympy as sp

from gsp.algebra.algebraic_numbers import AlgebraicPoint
from gsp.algebra.local_series import DIGITS
from gsp.critical.continuation.special_points import SpecialPoint
from gsp.critical.layer_problem import find_symbol
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, HyperbolicityError
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.results.card import Card
from gsp.singular.blow_up.chart import BlowUpChart, LeadingField, charts_of
from gsp.singular.blow_up.expansion import block_of, expanded
from gsp.singular.blow_up.local_form import BlowUpError, LocalForm, fibre_order, straightened
from gsp.singular.blow_up.nilpotent_points import ExactPoint, nilpotent_point
from gsp.singular.blow_up.weights import Exponents, Weights, diagram, least_weights
from gsp.singular.singularities.folded_singularities import FoldedSingularity
from gsp.systems.arguments import check_each, check_noun
from gsp.systems.flow import Point, complete, values_by_name
from gsp.systems.system import SlowFastSystem

# Taylor polynomials begin with the third degree, enough for cusps and pitchforks; a fibre of order 8 is not decided.
DEGREE, HIGHEST = 3, 8


class PassageScaling(NamedTuple):
    """Powers of epsilon, called `small`, in the rescaling chart: `exponents` of variables by name, of `slow_time` and
    of `fast_time`.
    """

    exponents: Mapping[str, sp.Rational]
    slow_time: sp.Rational
    fast_time: sp.Rational
    small: str = "epsilon"

    def __str__(self) -> str:
        sizes = {**self.exponents, "slow time": self.slow_time}
        return ", ".join(f"{name} ~ {_power(self.small, e)}" for name, e in sizes.items())


@dataclass(frozen=True, eq=False, repr=False)
class BlowUp(Card):
    """The blow-up z_i = r^(w_i) Z_i of a nilpotent point, of which r^k is divided out.

    - `point` by name, exact where `is_exact`;
    - `coordinates`: the local variables that are blown up, by the name of the one whose place each takes: their
      linear parts in the states less the point's and the parameters less their values;
    - `weights` by name, fast variables first, then slow ones, epsilon, and parameters that unfold the point; those
      that are `held` have weight 0, so that the point is one of a family along them;
    - `degree`, k; `leading`, the kept rates in fast time, by name; `charts`, the rescaling chart first.
    """

    system: SlowFastSystem
    point: Mapping[str, sp.Expr]
    is_exact: bool
    coordinates: Mapping[str, sp.Expr]
    weights: Mapping[str, int]
    held: tuple[str, ...]
    degree: int
    field: LeadingField

    @property
    def leading(self) -> Mapping[str, sp.Expr]:
        """The kept rates in fast time, by name."""
        return MappingProxyType({z.name: rate for z, rate in self.field.rates.items() if rate != 0})

    @cached_property
    def charts(self) -> tuple[BlowUpChart, ...]:
        """The rescaling chart, then those of both signs of the slow and of the fast variables."""
        return charts_of(self.field)

    @property
    def scaling(self) -> PassageScaling:
        """With r = epsilon^(1/w_epsilon), which the rescaling chart says: z_i ~ r^(w_i), fast time ~ r^(-k)."""
        small = self.system.epsilon.name
        unit = self.weights[small]
        exponents = {name: sp.Rational(w, unit) for name, w in self.weights.items() if name != small}
        fast_time = -sp.Rational(self.degree, unit)
        return PassageScaling(MappingProxyType(exponents), 1 + fast_time, fast_time, small)

    @property
    def line(self) -> str:
        """Weights and scaling in one line."""
        shown = ", ".join(f"{name} {w}" for name, w in self.weights.items())
        return f"weights {shown}; degree {self.degree}; so {self.scaling}"

    def as_dict(self) -> dict[str, object]:
        """Weights, exponents and charts in plain values: whole numbers, and expressions as text."""
        scaling = self.scaling
        return {
            "weights": dict(self.weights),
            "degree": self.degree,
            "exponents": {name: str(e) for name, e in scaling.exponents.items()},
            "slow_time": str(scaling.slow_time),
            "leading": {name: str(rate) for name, rate in self.leading.items()},
            "charts": {
                chart.title: {str(Z): str(rate) for Z, rate in chart.rates.items()} for chart in self.charts
            },
        }

    def __repr__(self) -> str:
        weights = ", ".join(f"{name}: {w}" for name, w in self.weights.items())
        return f"BlowUp({weights}; degree {self.degree})"

    def __str__(self) -> str:
        place = ", ".join(f"{n} = {v if v.is_Rational else sp.N(v, 10)}" for n, v in self.point.items())
        lines = [f"blow-up of the nilpotent point {place}"]
        names = [name for name, form in self.coordinates.items() if str(form) != name]
        lines += [
            f"  {name} stands for {self.coordinates[name]} to first order, from the point on" for name in names
        ]
        weights = ", ".join(f"{name} {w}" for name, w in self.weights.items())
        lines.append(f"  weights  {weights}; degree {self.degree}")
        if self.held:
            lines.append(f"  held     {', '.join(self.held)}: the point is one of a family along them")
        lines += [f"  leading  {name}' = {rate}" for name, rate in self.leading.items()]
        lines.append(f"  scaling  {self.scaling}")
        return "\n".join([*lines, *map(str, self.charts)])


def blow_up(
    of: SlowFastSystem | FoldedSingularity,
    *,
    near: Point | SpecialPoint | Loss | None = None,
    parameters: Sequence[sp.Symbol | str] | None = None,
) -> BlowUp:
    """The blow-up of the nilpotent point of a system next to `near`, or of a folded singularity that was found.

    `near` names every state, and parameters that have another value there; or it is a special point or a loss.
    `parameters` are those that may unfold the point, all by default. The weights are the least for which no term is of
    a lower quasi-degree than its equation, read from Taylor polynomials in coordinates that hide none: in
    `gsp.singular.blow_up`, `weights` says which are least, and `local_form` which coordinates. They are exact; at
    points that have no formula, numbers below 1e-38 count as zero.

    Raises `BlowUpError` where g_y is regular, as at a Hopf point; where it has several null vectors, or an imaginary
    pair beside its zero; where the field is not smooth; where no power below the ninth decides the fast fibre; and
    where no weights exist.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> found = blow_up(SlowFastSystem(slow={y: 1}, fast={x: x**2 + y}, epsilon=eps), near={"x": 0, "y": 0})
    >>> dict(found.weights), found.degree, found.scaling.slow_time
    ({'x': 1, 'y': 2, 'epsilon': 3}, 1, 2/3)
    """
    check_noun(of, (SlowFastSystem, FoldedSingularity), verb="blow_up")
    system, kind = (of, getattr(near, "kind", None)) if isinstance(of, SlowFastSystem) else (of.system, None)
    if isinstance(of, FoldedSingularity):
        near, kind = {name: float(v) for name, v in of.point.items()}, LossKind.FOLDED_SINGULARITY
    elif isinstance(near, (SpecialPoint, Loss)):
        near = dict(near.point)
    if near is None:
        raise DeclarationError(
            "blow_up of a system takes the point.", "Pass near={...} with every state, or a loss of classify."
        )
    if kind is LossKind.HOPF:
        raise BlowUpError(
            "a Hopf point is not nilpotent: its two eigenvalues are imaginary and not zero.",
            "Nothing has to be blown up there; entry_exit gives the delay.",
        )
    given = values_by_name(near, what="near")
    names = {p.name for p in system.parameters}
    moved = {name: value for name, value in given.items() if name in names}
    if moved:
        system = system.with_parameters(**moved)
    rest = {name: value for name, value in given.items() if name not in names}
    complete(rest, system.states, what="near")
    unfolding = _unfolding(system, parameters)
    point = nilpotent_point(system, rest, kind)
    form, weights = _weighted(system, point, unfolding)
    return _blown_up(system, point, form, weights)


def _unfolding(system: SlowFastSystem, parameters: Sequence[sp.Symbol | str] | None) -> tuple[sp.Symbol, ...]:
    known = tuple(system.parameters)
    if parameters is None:
        return known
    return check_each(
        parameters,
        lambda p: find_symbol(system, p, known, "a parameter"),
        what="parameters",
        be="a list of names",
    )


def _weighted(
    system: SlowFastSystem, point: ExactPoint, unfolding: Sequence[sp.Symbol]
) -> tuple[LocalForm, Weights]:
    """The local form, of a degree that holds every monomial that may be kept, and its weights."""
    held: list[int] | None = None
    for degree in range(DEGREE, HIGHEST + 1):
        found = _weighted_at(system, point, unfolding, degree)
        if found is None:
            continue
        form, weights = found
        least = min(w for w in weights.of if w)
        if (degree + 1) * least < weights.degree + max(weights.of[i] for i in range(len(form.fast))):
            continue
        # A power of a slow variable without a weight is too low whatever its degree.
        if (own := _held(form, weights)) and held is None and degree < HIGHEST:
            highest = _weighted_at(system, point, (), HIGHEST)
            held = own if highest is None else _held(*highest)
        if own == (held or []) or degree == HIGHEST:
            return form, weights
    raise BlowUpError(
        f"no power below the {HIGHEST + 1}th is there along the fast fibre of the point.",
        "Where the fibre consists of rest points, as at a rank change, entry_exit follows the branch through.",
        limit=HIGHEST,
    )


def _weighted_at(
    system: SlowFastSystem, point: ExactPoint, unfolding: Sequence[sp.Symbol], degree: int
) -> tuple[LocalForm, Weights] | None:
    """The local form of that degree and its weights; None where the fast fibre holds no power as low as that."""
    try:
        form = straightened(block_of(expanded(system, point, unfolding, degree)))
    except HyperbolicityError as error:
        raise BlowUpError(f"there is no Taylor polynomial at the point: {error.fact}.") from None
    if fibre_order(form) is None:
        return None
    points = diagram(_monomials(form))
    weights = least_weights(points, (range(len(form.fast)), form.slow_at, (form.small,)))
    if weights is None or weights.of[form.small] == 0:
        raise BlowUpError(
            "no weights make the point's field quasi-homogeneous: epsilon moves nothing here.",
            "Look at the layer problem, or let another parameter be small.",
        )
    return form, weights


def _held(form: LocalForm, weights: Weights) -> list[int]:
    """The slow variables without a weight."""
    return [i for i in form.slow_at if not weights.of[i]]


def _monomials(form: LocalForm) -> list[tuple[int, list[Exponents]]]:
    """The exponents in every rate in fast time."""
    rates = [(i, [m for m, _ in g.terms()]) for i, g in enumerate(form.fast)]
    small = form.small
    for i, f in zip(form.slow_at, form.slow):
        rates.append((i, [(*m[:small], m[small] + 1) for m, _ in f.terms()]))
    return rates


def _blown_up(system: SlowFastSystem, point: ExactPoint, form: LocalForm, weights: Weights) -> BlowUp:
    slow_at, small, ring = form.slow_at, form.small, form.ring
    fast = [i for i in range(len(form.fast)) if weights.of[i]]
    slow = [i for i in slow_at if weights.of[i]]
    order = [*fast, *slow, small, *(i for i in range(slow_at.stop, small) if weights.of[i])]
    symbols = {i: sp.Symbol(form.names[i].name, real=True) for i in order}
    rates: dict[sp.Symbol, sp.Expr] = {}
    for i in order:
        series = form.fast[i] if i < len(form.fast) else form.slow[i - len(form.fast)] if i in slow_at else None
        lead = weights.of[small] if i in slow_at else 0
        terms = []
        for m, c in series.terms() if series is not None else ():
            if lead + weights.order(m) == weights.of[i] + weights.degree and all(
                j in symbols for j, k in enumerate(m) if k
            ):
                factor = symbols[small] if i in slow_at else sp.Integer(1)
                terms.append(
                    sp.Mul(ring.expression(c), factor, *(symbols[j] ** k for j, k in enumerate(m) if k))
                )
        rates[symbols[i]] = sp.Add(*terms)
    own = {symbols[i]: weights.of[i] for i in order}
    blown, moved = (tuple(symbols[i] for i in group) for group in (fast, slow))
    leading = LeadingField(rates, own, weights.degree, blown, moved, symbols[small])
    values = (
        point.expressions()
        if isinstance(point, AlgebraicPoint)
        else {s: sp.Float(v, DIGITS) for s, v in point.items()}
    )
    held = [form.names[i].name for i in (*range(len(form.fast)), *slow_at) if not weights.of[i]]
    return BlowUp(
        system=system,
        point=MappingProxyType({s.name: values[s] for s in system.states}),
        is_exact=ring.is_exact,
        coordinates=MappingProxyType({form.names[i].name: form.linear[i] for i in order if i != small}),
        weights=MappingProxyType({form.names[i].name: weights.of[i] for i in order}),
        held=tuple(held),
        degree=weights.degree,
        field=leading,
    )


def _power(small: str, exponent: sp.Rational) -> str:
    return small if exponent == 1 else f"{small}^({exponent})" if exponent != 0 else "1"
