"""The slow manifold and the reduced field as exact power series in epsilon.

y = h_epsilon(x) = h_0 + epsilon h_1 + ... solves the invariance equation epsilon Dh f(x, h, epsilon) =
g(x, h, epsilon) (Fenichel 1979; Kaper 1999, section 2), order by order:

    g_y h_k = sum_(i<k) Dh_i f_(k-1-i) - [g(x, h_0 + ... + epsilon^(k-1) h_(k-1), epsilon)]_k .

The coefficients live in the chart's ring, so parameters stay symbolic and nothing is rounded.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import sympy as sp

from gsp.algebra.circuits import CircuitRing
from gsp.algebra.ring_elements import RingElement
from gsp.critical.critical_manifold import Branch
from gsp.errors import BeyondReachWarning, BudgetError, DeclarationError
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.results.card import Card
from gsp.slow.components import Components
from gsp.slow.coordinates import Chart, moving
from gsp.slow.expansion import Expansion
from gsp.slow.missing_terms import without_value
from gsp.slow.truncation import AHEAD, best, errors, least, past, units
from gsp.systems.arguments import check_flag, check_noun
from gsp.systems.flow import as_points, check_epsilon, check_order

# Coefficients with more terms than this are not for reading.
READABLE = 300
# With longer ones than this it takes seconds to compile what is evaluated, which then runs no faster than the full
# system: they are not sought ahead, and not run where nobody asked for their order.
LONGEST = 600


@dataclass(frozen=True, eq=False, repr=False)
class SeriesManifold(Card):
    """The slow manifold of `branch` to `order` in epsilon, and the reduced field on it.

    `coefficients[k]` is h_k, by place or name of the fast variables; `reduced_field[k]` is f_k, by slow variables.
    On an implicit branch they are functions on M0: the fast symbols in them stand for the point y of M0 over x.
    """

    branch: Branch
    order: int
    chart: Chart = field(repr=False)
    _h: list[list[RingElement]]
    _f: list[list[RingElement]]
    _expansion: Expansion = field(repr=False)

    @cached_property
    def coefficients(self) -> tuple[Components, ...]:
        """h_0, ..., h_n: exact expressions in x, the parameters and, on implicit branches, y on M0."""
        return self._written(self.chart.ring.to_sympy)

    @cached_property
    def reduced_field(self) -> tuple[Components, ...]:
        """f_0, ..., f_n with x' = sum_k epsilon^k f_k on the slow manifold."""
        return self._components(self._f, self.branch.system.x)

    @cached_property
    def coordinate_field(self) -> tuple[Components, ...]:
        """The coordinates' rates by powers of epsilon; a fast coordinate is the point of M0, which moves with x."""
        return self._components(moving(self.chart, self._f), self.coordinates)

    @cached_property
    def nested(self) -> tuple[tuple[Components, ...], tuple[Components, ...]]:
        """`coefficients` and `coordinate_field` by Horner's scheme: for evaluation, where they are too long to read."""
        write = self.chart.ring.horner
        return self._written(write), self._components(moving(self.chart, self._f), self.coordinates, write)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Terms in the longest numerator of h_k and f_k, for k = 0, ..., n: what printing them would take.

        Steps of the longest program where the coefficients are programs.
        """
        rows = (*self._h, *self._f)
        return tuple(max(row[k].length for row in rows) for k in range(self.order + 1))

    @property
    def coordinates(self) -> tuple[sp.Symbol, ...]:
        """The symbols in which the coefficients are written."""
        return self.chart.coordinates

    @property
    def is_program(self) -> bool:
        """Whether the coefficients are straight-line programs, too long to be written out as polynomials."""
        return isinstance(self.chart.ring, CircuitRing)

    def at_order(self, order: int) -> SeriesManifold:
        """The same series cut at a lower order."""
        if check_order(order) > self.order:
            raise DeclarationError(
                f"the series is known through order {self.order}.",
                "Expand the branch further.",
                got=f"order {order}",
                value=order,
            )
        h, f = ([row[: order + 1] for row in rows] for rows in (self._h, self._f))
        return replace(self, order=order, _h=h, _f=f)

    def over(self, branch: Branch) -> SeriesManifold:
        """The same series over another sheet of its branch; raises `DeclarationError` for any other branch."""
        check_noun(branch, Branch, verb="over")
        if replace(branch, seed=None) != replace(self.branch, seed=None):
            raise DeclarationError(f"the series is over {self.branch}.", "Use expand(branch).", got=branch)
        return replace(self, branch=branch)

    def readable(self, limit: int) -> SeriesManifold:
        """What of the series can be printed in at most `limit` terms a coefficient.

        The series itself where that is so; else with the parameters' values put in; else that cut at a lower order.
        """
        if max(self.sizes) <= limit:
            return self
        numbers = self.specialised
        short = [k for k, size in enumerate(numbers.sizes) if max(numbers.sizes[: k + 1]) <= limit]
        return numbers.at_order(short[-1] if short else 0)

    @cached_property
    def specialised(self) -> SeriesManifold:
        """The same series with the parameters' values put in first, as every numerical evaluation wants it.

        Expanded numerators with symbolic parameters lose their digits near a denominator's zero.
        """
        if not self._expansion.symbolic:
            return self
        return series_of(self._expansion.numeric, self.order).over(self.branch)

    @cached_property
    def as_programs(self) -> SeriesManifold:
        """The same series as straight-line programs, with the parameters' values put in."""
        return series_of(self._expansion.numeric.programs, self.order).over(self.branch)

    @cached_property
    def _evaluated(self) -> SeriesManifold:
        """The same series as numbers are best got from it.

        Beside a root in h_0 a numerator A + B sqrt(q) cancels, the more so the higher the order: programs do not.
        """
        special = self.specialised
        powers = [
            p.exp for h in (self.branch.graph or {}).values() for p in h.atoms(sp.Pow) if p.base.free_symbols
        ]
        has_roots = any(power.is_Rational and not power.is_Integer for power in powers)
        return special.as_programs if has_roots else special

    @cached_property
    def _ahead(self) -> SeriesManifold:
        """The series with the parameters' values in, and the next two orders as far as they look short."""
        series = self.specialised
        for _ in range(AHEAD):
            sizes = series.sizes
            growth = max(1.0, sizes[-1] / sizes[-2]) if series.order and sizes[-2] else 1.0
            if max(sizes) * growth > LONGEST:
                break
            try:
                series = series_of(self._expansion.numeric, series.order + 1).over(self.branch)
            except BudgetError:
                break
        return series

    def evaluate(
        self, x, epsilon: float, *, order: int | None = None, near=None, masked: bool = False
    ) -> np.ndarray:
        """h_epsilon(x) through `order`, shape (m, n_fast), or (n_fast,) for one point; see `Branch.points`.

        Where the terms no longer fall by then the sum is no value of h: such points are beyond the series' reach, which
        a `BeyondReachWarning` says, or NaN with `masked`. The sum of `terms` is the same without that check. Raises
        `HyperbolicityError` where the series is singular, unless `masked`.
        """
        n = self._order(order)
        check_flag(masked, what="masked")
        terms, coordinates, single = self._ahead._terms(x, epsilon, near, masked=masked)
        # Singular points, which only `masked` lets through, have no sum.
        terms = np.where(np.isfinite(terms), terms, np.nan)
        result = terms[:, : n + 1].sum(axis=1)
        unit = units(coordinates)
        estimates = errors(np.linalg.norm(terms, axis=2), n, unit=unit)
        if past(estimates).any():
            # Looked at again without the terms that are rounding altogether, as `optimal_order` does.
            estimates = errors(self._ahead._known_sizes(coordinates, terms, epsilon), n, unit=unit)
        beyond = past(estimates)
        if beyond.any():
            if masked:
                result[beyond] = np.nan
            else:
                warnings.warn(self._beyond(x, estimates, beyond), BeyondReachWarning, stacklevel=2)
        return result[0] if single else result

    def terms(self, x, epsilon: float, *, near=None) -> np.ndarray:
        """The terms epsilon^k h_k(x), shape (m, n + 1, n_fast), or (n + 1, n_fast) for one point."""
        terms, _, single = self._terms(x, epsilon, near)
        return terms[0] if single else terms

    def terms_at(self, coordinates: np.ndarray, epsilon: float) -> np.ndarray:
        """The terms (m, n + 1, n_fast) at the chart's `coordinates` (m, k), not finite where the series is singular."""
        h = self._h_function(coordinates, parameter_vector(self.branch.system, epsilon))
        powers = epsilon ** np.arange(self.order + 1)
        return h.reshape(-1, self.order + 1, len(self.branch.system.y)) * powers[None, :, None]

    def residual(self, x, epsilon: float, *, order: int | None = None, near=None) -> np.ndarray:
        """Defect of the invariance equation, epsilon Dh f(x, h, epsilon) - g(x, h, epsilon), as `evaluate`.

        It is O(epsilon^(n+1)) for the series through order n, and the error of h is about
        (g_y)^-1 times the residual.
        """
        n = self._order(order)
        value = check_epsilon(epsilon)
        array, coordinates, single = self._on_branch(x, near)
        system = self.branch.system
        ny, nx = len(system.y), len(system.x)
        powers = value ** np.arange(n + 1)
        inputs = (coordinates, parameter_vector(system, value))
        h = self._h_function(*inputs).reshape(-1, self.order + 1, ny)[:, : n + 1]
        slopes = self._slope_function(*inputs).reshape(-1, self.order + 1, ny, nx)[:, : n + 1]
        y = np.einsum("k,mki->mi", powers, h)
        Dh = np.einsum("k,mkij->mij", powers, slopes)
        rates = self._rates_function(np.hstack([array, y]), parameter_vector(system, value))
        defect = value * np.einsum("mij,mj->mi", Dh, rates[:, :nx]) - rates[:, nx:]
        return defect[0] if single else defect

    def optimal_order(self, x, epsilon: float, *, near=None) -> np.ndarray | int:
        """Order at which to stop, that of the least `truncation_error`: an int for one point or an array (m,).

        The series is asymptotic, not convergent, as a rule: its error is about the first terms left out, so it is best
        cut before the smallest ones. Two orders more than the series has are looked at, where they are short enough;
        when the terms are still falling then, the answer is the series' own order. Terms that cancellation has left
        without digits do not count: the order before the first of them is the last. Near a zero of several terms the
        answer may be too low, and `truncation_error` is that of the sum which is cut there.
        """
        _, orders, _, single = self._best_terms(x, epsilon, near)
        return int(orders[0]) if single else orders

    def truncation_error(self, x, epsilon: float, *, near=None) -> np.ndarray | float:
        """Estimated error |h - sum| at the optimal order, in the fast variables' Euclidean norm.

        Three times the envelope of the next two terms, summed as a geometric series: no bound, but meant to be above
        the true error, as a rule by a factor of 5. Where nothing is known beyond an order, its last term stands in.
        Where the terms after it rise by smaller and smaller factors, it is three times the last of these. All terms
        are taken at the point itself: what a steep front upstream has left there, exp(-distance/(epsilon speed)), is
        beyond all orders and in none of them.
        """
        _, _, error, single = self._best_terms(x, epsilon, near)
        return float(error[0]) if single else error

    # -- evaluation --------------------------------------------------------------------------------

    def _components(self, rows: list[list[RingElement]], symbols, write=None) -> tuple[Components, ...]:
        write = write or self.chart.ring.to_sympy
        return tuple(Components(symbols, [write(row[k]) for row in rows]) for k in range(self.order + 1))

    def _written(self, write: Callable[[RingElement], sp.Expr]) -> tuple[Components, ...]:
        """h_0, ..., h_n: h_0 as what it is off the fast variables' centres, beside which it may be small."""
        y, ring = self.branch.system.y, self.chart.ring
        centres = [self.chart.centres.get(s, 0) for s in y]
        first = [
            write(row[0] - ring.constant(c)) + c if c else write(row[0]) for row, c in zip(self._h, centres)
        ]
        rest = self._components(self._h, y, write)[1:] if self.order else ()
        return (Components(y, first), *rest)

    def _order(self, order: int | None) -> int:
        return self.order if order is None else self.at_order(order).order

    def _on_branch(self, x, near) -> tuple[np.ndarray, np.ndarray, bool]:
        """(x, the chart's coordinates, single): slow points and their coordinates on M0."""
        system = self.branch.system
        array, single = as_points(system.x, x, what="x")
        if self.branch.is_explicit:
            return array, array, single
        z = np.hstack([array, self.branch.points(array, near=near)])
        places = [system.states.index(symbol) for symbol in self.coordinates]
        return array, z[:, places], single

    def _best_terms(self, x, epsilon: float, near) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """(terms, the best orders (m,), the errors (m,) there, single); terms without digits do not count."""
        ahead = self._ahead
        terms, coordinates, single = ahead._terms(x, epsilon, near)
        sizes = ahead._known_sizes(coordinates, terms, epsilon)
        estimates = errors(sizes, self.order, unit=units(coordinates))
        orders = best(estimates)
        return terms, orders, least(sizes, orders, estimates), single

    def _known_sizes(self, coordinates: np.ndarray, terms: np.ndarray, epsilon: float) -> np.ndarray:
        """Sizes (m, k) of `terms` (m, k, n_fast), NaN where they have no digits: those say nothing about the error."""
        sizes = np.linalg.norm(terms, axis=2)
        sizes[np.arange(sizes.shape[1]) > self._last_with_digits(coordinates, terms, epsilon)[:, None]] = np.nan
        return sizes

    def _beyond(self, x, estimates: np.ndarray, beyond: np.ndarray) -> str:
        """What is beyond the reach, for a warning."""
        system = self.branch.system
        array, _ = as_points(system.x, x, what="x")
        i = int(np.argmax(np.where(beyond, np.nan_to_num(estimates[:, -1], nan=np.inf), -1.0)))
        place = system.place(zip(system.x, array[i]))
        many = f", and at {beyond.sum() - 1} more of {len(beyond)} points" if beyond.sum() > 1 else ""
        order, last = int(best(estimates[i : i + 1])[0]), estimates.shape[1] - 1
        why = (
            f"its terms fall no more after order {order}, and the error is about {estimates[i, -1]:.2g}"
            if np.isfinite(estimates[i, -1])
            else f"cancellation leaves its terms without digits, and order {order} is the best"
        )
        return (
            f"the series through order {last} is beyond its reach at {place}{many}: {why}. Take "
            "order=series.optimal_order(x, epsilon), a smaller epsilon, or solve_manifold; masked=True gives NaN."
        )

    def _terms(self, x, epsilon: float, near, *, masked: bool = False) -> tuple[np.ndarray, np.ndarray, bool]:
        """(terms, the chart's coordinates, single) over `x`."""
        value = check_epsilon(epsilon)
        array, coordinates, single = self._on_branch(x, near)
        terms = self.terms_at(coordinates, value)
        finite = np.isfinite(terms).all(axis=(1, 2))
        if not finite.all() and not masked:
            i = int(np.argmin(finite))
            raise without_value(self.branch, array[i], terms[i])
        return terms, coordinates, single

    def _last_with_digits(self, coordinates: np.ndarray, terms: np.ndarray, epsilon: float) -> np.ndarray:
        """The highest order (m,) up to which all `terms` (m, k, n_fast) have digits, seen by moving the point by ulps.

        Expanded numerators of long series cancel: a term may be rounding altogether, and look like any other.
        """
        noise = np.zeros(terms.shape[:2])
        for i, ulps in enumerate((1.0, 2.0, 3.0)):
            signs = 1.0 - 2.0 * ((np.arange(coordinates.shape[1]) + i) % 2)
            moved = self.terms_at(coordinates * (1.0 + ulps * signs * np.finfo(float).eps), epsilon)
            noise = np.maximum(noise, np.linalg.norm(moved - terms, axis=2))
        sizes = np.linalg.norm(terms, axis=2)
        # Digits are lost when the change is a tenth, and more than rounding of the sum would be.
        lost = (noise > 0.1 * sizes) & (noise > 1e-13 * (units(coordinates)[:, None] + sizes[:, :1]))
        return np.where(lost.any(axis=1), np.maximum(np.argmax(lost, axis=1) - 1, 0), terms.shape[1] - 1)

    @cached_property
    def _h_function(self):
        special = self._evaluated
        outputs = [e for part in special._written(special.chart.ring.horner) for e in part]
        return compile_over(self.branch.system, tuple(outputs), arguments=self.coordinates)

    @cached_property
    def _slope_function(self):
        special = self._evaluated
        ring = special.chart.ring
        rows, places = range(self.order + 1), range(ring.derivations)
        return self._compiled(
            [ring.derive(row[k], j).reduced() for k in rows for row in special._h for j in places]
        )

    def _compiled(self, elements: list[RingElement]):
        outputs = tuple(map(self._evaluated.chart.ring.horner, elements))
        return compile_over(self.branch.system, outputs, arguments=self.coordinates)

    @cached_property
    def _rates_function(self):
        system = self.branch.system
        return compile_over(system, (*system.f, *system.g))

    def __repr__(self) -> str:
        return f"SeriesManifold({self.branch}, order={self.order})"

    def __str__(self) -> str:
        lines = [f"slow manifold of {self.branch}, through order {self.order}"]
        for k in range(self.order + 1):
            lines += [f"  h_{k}: {y} = {e}" for y, e in self.coefficients[k].as_dict().items()]
        for k in range(self.order + 1):
            lines += [f"  f_{k}: {x}' = {e}" for x, e in self.reduced_field[k].as_dict().items()]
        return "\n".join(lines)


def expand(branch: Branch, *, order: int = 3, symbolic: bool = True) -> SeriesManifold:
    """The slow manifold over `branch` and its reduced field as exact series through `order` in epsilon.

    With `symbolic=False` the parameters' exact values are put in first: the same series, much shorter where there
    are many parameters. Works on explicit and implicit branches, with any number of slow and fast variables,
    symbolic parameters and elementary functions. Where the polynomials grow too long the coefficients are straight-line
    programs, which `is_program` tells. Raises `DeclarationError` when `order` is no non-negative integer,
    `HyperbolicityError` when the fast Jacobian is singular on the whole branch, `BudgetError` when the programs too
    grow too long, and `UnsupportedFunctionError` for functions without a power series rule.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=eps)
    >>> expand(solve_critical(system).branches[0], order=2).coefficients
    ((y,), (y,), (y,))
    """
    check_noun(branch, Branch, verb="expand")
    check_order(order)
    check_flag(symbolic, what="symbolic")
    expansion = Expansion(branch, symbolic=symbolic)
    try:
        return series_of(expansion, order)
    except BudgetError:
        return series_of(expansion.programs, order)


def best_sum(
    series: SeriesManifold, x, epsilon: float, *, near=None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """h_epsilon (m, n_fast) over `x` at each point's own `optimal_order`, these orders and the errors (m,), at once."""
    terms, orders, left_out, _ = series._best_terms(x, epsilon, near)
    return terms.cumsum(axis=1)[np.arange(len(terms)), orders], orders, left_out


def length(series: SeriesManifold) -> str:
    """How long its longest coefficient is, in words."""
    return f"{max(series.sizes)} {'steps' if series.is_program else 'terms'}"


def series_of(expansion: Expansion, order: int) -> SeriesManifold:
    """The series of an `expansion` through `order`; what the expansion knows already is not computed again."""
    place, h, f = expansion.through(order)
    return SeriesManifold(expansion.branch, order, place, h, f, expansion)
