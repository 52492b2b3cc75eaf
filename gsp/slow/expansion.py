"""The expansion of a slow manifold in powers of epsilon over one branch, order by order, each order once."""

from __future__ import annotations

from functools import cached_property

from gsp.algebra.power_series import SeriesProgram
from gsp.algebra.ring_elements import RingElement
from gsp.critical.branch import Branch
from gsp.errors import BudgetError
from gsp.slow.coordinates import Chart, chart, dot

Rows = list[list[RingElement]]


class Expansion:
    """The series over `branch`, which grows: `through(order)` computes the orders that are not known yet.

    With `symbolic` the parameters stay symbols, else their exact values are put in first. As `programs` the
    coefficients are straight-line programs whatever their length.
    """

    def __init__(self, branch: Branch, *, symbolic: bool = True, programs: bool = False) -> None:
        self.branch = branch
        self.symbolic = symbolic
        self._as_programs = programs
        self._known: int | None = None
        # The last order within the budget and what was met beyond it, once that is known.
        self._ended: tuple[int | None, BudgetError] | None = None

    @cached_property
    def numeric(self) -> Expansion:
        """The expansion with the parameters' values put in first."""
        return self if not self.symbolic else Expansion(self.branch, symbolic=False, programs=self._as_programs)

    @cached_property
    def programs(self) -> Expansion:
        """The expansion whose coefficients are straight-line programs, which grow far slower than polynomials."""
        return self if self._as_programs else Expansion(self.branch, symbolic=self.symbolic, programs=True)

    @property
    def end(self) -> tuple[int | None, str]:
        """The last order within the budget, where one beyond it was asked for, and what was met there; else None."""
        return (None, "") if self._ended is None else (self._ended[0], self._ended[1].fact)

    def through(self, order: int) -> tuple[Chart, Rows, Rows]:
        """(chart, rows of h, rows of f), the coefficients of epsilon^0 to epsilon^order in each row.

        Raises `BudgetError` for an order beyond the budget; what it spent is not charged to the orders before it.
        """
        if self._ended is not None and (self._ended[0] is None or order > self._ended[0]):
            raise self._beyond(order, *self._ended)
        try:
            if self._known is None:
                self._begin()
            while self._known is None or self._known < order:
                before = self._chart.ring.spending
                try:
                    self._next()
                except BudgetError:
                    self._chart.ring.spending = before
                    raise
        except BudgetError as error:
            reached, self._known = self._known, None
            self._ended = reached, error
            raise self._beyond(order, reached, error) from None
        except BaseException:
            # An order that was interrupted is half computed: what is kept begins again.
            self._known = None
            raise
        count = order + 1
        return self._chart, [row[:count] for row in self._h], [row[:count] for row in self._rates]

    def _beyond(self, order: int, reached: int | None, error: BudgetError) -> BudgetError:
        """What a spent budget of terms leaves, and what to do."""
        symbols = len(self.branch.system.parameters) if self.symbolic else 0
        remedies = [] if reached is None else [f"take order {reached} or less"]
        if symbols:
            remedies.append(f"put the values of the {symbols} parameters in (`--values`, symbolic=False)")
        remedies.append("take fewer variables or lower powers")
        how_far = "was not reached at any order" if reached is None else f"was reached through order {reached}"
        return BudgetError(
            f"the series through order {order} {how_far}: {error}",
            f"Rather {', or '.join(remedies)}; `solve_manifold` needs no series.",
            limit=error.limit,
            value=error.spent,
        )

    def _begin(self) -> None:
        system = self.branch.system
        values = {} if self.symbolic else dict(system.parameters)
        self._chart = chart(self.branch, substitute=values, programs=self._as_programs)
        self._h: Rows = [[self._chart.elements[y]] for y in system.y]
        self._program = SeriesProgram(
            self._chart.ring,
            epsilon=system.epsilon,
            inputs=dict(zip(system.y, self._h)),
            constants={x: self._chart.elements[x] for x in system.x},
        )
        self._f = [self._program.compile(rate.xreplace(values)) for rate in system.f]
        self._g = [self._program.compile(rate.xreplace(values)) for rate in system.g]
        self._slopes: list[Rows] = []
        self._program.extend(0)
        self._rates: Rows = [[rate.coefficients[0].reduced()] for rate in self._f]
        self._known = 0

    def _next(self) -> None:
        """One order more: g_y h_k = sum_(i<k) Dh_i f_(k-1-i) - [g]_k."""
        assert self._known is not None
        k, ring = self._known + 1, self._chart.ring
        slow = range(len(self.branch.system.x))
        self._slopes.append([[ring.derive(row[k - 1], j).reduced() for j in slow] for row in self._h])
        for row in self._h:
            row.append(ring.zero)
        # With h_k = 0 the program gives what the lower orders contribute to [g]_k.
        self._program.extend(k)
        defect = []
        for i in range(len(self._h)):
            total = self._g[i].coefficients[k]
            for lower in range(k):
                rates = [rate.coefficients[k - 1 - lower] for rate in self._f]
                total = total - dot(self._slopes[lower][i], rates, ring)
            defect.append(total.reduced())
        for row, value in zip(self._h, self._chart.solve(defect)):
            row[k] = (-value).reduced()
        self._program.extend(k)
        for row, rate in zip(self._rates, self._f):
            row.append(rate.coefficients[k].reduced())
        self._known = k
