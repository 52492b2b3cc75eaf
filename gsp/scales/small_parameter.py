"""`SmallParameter`: parameters that may be small together, the critical manifold that they leave, and the reduction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import sympy as sp

from gsp.algebra.brevity import brief
from gsp.algebra.centres import centres
from gsp.errors import BudgetError, DeclarationError, Status
from gsp.results.card import Card
from gsp.results.table import Names
from gsp.scales.attraction import attracts, has_positive_points
from gsp.scales.critical_piece import CriticalPiece
from gsp.systems.flow import Portable
from gsp.systems.system import VectorField

# Of the exact algebra's budget for one verdict or reduction, of which there are thousands: half a second.
SHARE = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class SmallParameter(Portable, Card):
    """Parameters `vanishing` that go to 0 in proportion while those of `kept` stay, and one critical manifold then.

    `error` is that of the reduction at the field's own values once it has been measured, and None before.
    """

    original: VectorField
    vanishing: tuple[str, ...]
    kept: tuple[str, ...]
    critical: CriticalPiece
    error: float | None = None

    @classmethod
    def of(cls, original: VectorField, critical: CriticalPiece, chosen: Iterable[sp.Symbol]) -> SmallParameter:
        """The small parameter of a critical manifold at the value where those `chosen` vanish.

        `critical` is about the centres of the rates of `original`.
        """
        vanishing = tuple(p.name for p in chosen)
        return cls(
            original=original,
            vanishing=vanishing,
            kept=tuple(p.name for p in original.parameters if p.name not in vanishing),
            critical=critical,
        )

    @cached_property
    def _centres(self) -> Mapping[sp.Symbol, sp.Rational]:
        return centres(self.original.rates, self.original.states)

    def _here(self, expression: sp.Expr) -> sp.Expr:
        """What is told about the centres, in the states themselves."""
        return expression.xreplace({z: z - c for z, c in self._centres.items()})

    @cached_property
    def manifold(self) -> tuple[sp.Eq, ...]:
        """The equations of the critical manifold."""
        return tuple(sp.Eq(self._here(e), 0, evaluate=False) for e in self.critical.equations)

    @cached_property
    def attracts(self) -> bool | None:
        """Whether the manifold attracts wherever states are positive, and parameters have the signs of their values.

        States that are far from the origin are counted from the centres of the field.
        True: everywhere there; False: nowhere; None: it depends, or signs of coefficients do not decide it, or there
        are more of them than the exact algebra forms.
        """
        return self._decided(attracts)

    @cached_property
    def is_positive(self) -> bool | None:
        """Whether states can be positive or zero on the manifold; None where signs do not decide it."""
        return self._decided(has_positive_points)

    def _decided(self, verdict: Callable[[CriticalPiece], bool | None]) -> bool | None:
        with self.critical.whole.ring.afresh(SHARE), suppress(BudgetError):
            return verdict(self.critical)
        return None

    @cached_property
    def is_within_reach(self) -> bool:
        """Whether the exact algebra forms `graph` and `reduced`: otherwise they raise `BudgetError`."""
        try:
            return self.reduced is not None
        except BudgetError:
            return False

    @cached_property
    def is_trivial(self) -> bool:
        """Whether nothing moves on the manifold to leading order: the reduction has no use then."""
        return all(rate == 0 for rate in self.reduced.values())

    @property
    def dimension(self) -> int:
        """How many variables are left."""
        return len(self.original.states) - self.critical.codimension

    @cached_property
    def epsilon(self) -> sp.Symbol:
        """The distance along the ray to the special value: 0 there, 1 at the values of the field."""
        field = self.original
        return sp.Symbol(
            Names(s.name for s in (*field.states, *field.parameters, *field.observables))("epsilon")
        )

    @cached_property
    def field(self) -> VectorField:
        """The field with epsilon p for each vanishing parameter p, in slow time: at epsilon = 1 it is the original."""
        ray = {p: self.epsilon * p for p in self.original.parameters if p.name in self.vanishing}
        divided = self.epsilon ** (1 - self.critical.ray.order)
        rates = {
            z: sp.Add(*[term / divided for term in sp.Add.make_args(sp.expand_mul(rate.xreplace(ray)))])
            for z, rate in self.original.equations.items()
        }
        observables = {o: e.xreplace(ray) for o, e in self.original.observables.items()}
        return VectorField(
            rates,
            epsilon=self.epsilon,
            parameters=self.original.parameters,
            name=self.original.name,
            observables=observables,
        )

    @cached_property
    def graph(self) -> Mapping[sp.Symbol, sp.Expr] | None:
        """States on the manifold as functions of the others; None where it is implicit."""
        with self.critical.whole.ring.afresh(SHARE):
            graph = self.critical.graph
        if graph is None:
            return None
        return MappingProxyType({z: self._here(e) + self._centres.get(z, 0) for z, e in graph.items()})

    @cached_property
    def reduced(self) -> Mapping[sp.Symbol, sp.Expr]:
        """The rates on the manifold to leading order, in the time of the field, of the states that stay.

        x' = (1 - P (D psi P)^-1 D psi) F_1; where the manifold is implicit, of all states, in all of them. Raises
        `BudgetError` where that has more terms than the exact algebra forms.
        """
        with self.critical.whole.ring.afresh(SHARE):
            rates = self.critical.reduction
        gone = self.critical.graph or {}
        return MappingProxyType({z: self._here(rate) for z, rate in rates.items() if z not in gone})

    @property
    def reduced_field(self) -> VectorField:
        """`reduced` as a field without a small parameter; raises `DeclarationError` where the manifold is implicit."""
        if self.graph is None:
            raise DeclarationError(
                f"the reduction at {', '.join(self.vanishing)} -> 0 is to an implicit manifold.",
                "Use split(found.field), which finds coordinates on it.",
            )
        used = set().union(*(rate.free_symbols for rate in self.reduced.values()))
        return VectorField(
            dict(self.reduced),
            parameters={p: value for p, value in self.original.parameters.items() if p in used},
            name=self.original.name,
        )

    def __str__(self) -> str:
        gone = ", ".join(f"{name} -> 0" for name in self.vanishing)
        equations = ", ".join(f"{brief(e.lhs)} = 0" for e in self.manifold)
        verdict = {True: "attracts", False: "does not attract", None: "undecided whether it attracts"}
        where = ", has no points with positive states" if self.is_positive is False else ""
        return f"{gone}: {equations}, {verdict[self.attracts]}{where}"

    def __repr__(self) -> str:
        return f"SmallParameter({self})"


class SmallParameters(tuple[SmallParameter, ...]):
    """What `small_parameters` found, in the order in which it looked; with `status` and `message` how far that was."""

    field: VectorField
    status: Status
    message: str

    def __new__(
        cls, found: Iterable[SmallParameter], *, field: VectorField, status: Status, message: str
    ) -> SmallParameters:
        made = super().__new__(cls, found)
        made.field, made.status, made.message = field, status, message
        return made

    def simplest(self) -> tuple[SmallParameter, ...]:
        """Those to whose manifold no fewer of the same parameters lead."""
        kept: dict[frozenset[sp.Expr], list[SmallParameter]] = {}
        for each in self:
            same = kept.setdefault(frozenset(each.critical.equations), [])
            if not any(set(other.vanishing) <= set(each.vanishing) for other in same):
                same.append(each)
        chosen = {id(each) for group in kept.values() for each in group}
        return tuple(each for each in self if id(each) in chosen)

    def __reduce__(self) -> tuple:
        return _made, (tuple(self), self.field, self.status, self.message)

    def __repr__(self) -> str:
        values = len({each.vanishing for each in self})
        return f"SmallParameters({len(self)} reductions at {values} special values)"

    def __str__(self) -> str:
        if not self:
            return f"no parameter of {self.field.name or 'the field'} may be called small. {self.message}"
        return "\n".join([*(str(each) for each in self), self.message])


def _made(
    found: tuple[SmallParameter, ...], field: VectorField, status: Status, message: str
) -> SmallParameters:
    return SmallParameters(found, field=field, status=status, message=message)
