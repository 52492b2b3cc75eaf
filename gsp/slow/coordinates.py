"""Coordinates on a branch of the critical manifold, and the exact functions on it.

On an explicit branch the coordinates are the slow variables. On an implicit one the fast variables are adjoined,
and a slow variable that an equation gives polynomially (y = x^3/3 - x on van der Pol's) is dropped instead, so
that every function on the branch has one representation. The derivations are the total derivatives along M0,
D_j = d/dx_j - (g_y^-1 g_x)_j d/dy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np
import sympy as sp

from gsp.algebra.centres import centres
from gsp.algebra.circuits import CircuitRing, Factors, Gate
from gsp.algebra.differentiation import derivative, slopes
from gsp.algebra.factorisation import degree, quotient
from gsp.algebra.functions import are_rational, require_rules
from gsp.algebra.laurent import laurent
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.ring_elements import RingElement, number_of
from gsp.algebra.triangular_blocks import triangular_blocks
from gsp.critical.critical_manifold import Branch
from gsp.errors import HyperbolicityError
from gsp.lowering.steps.straight_line import eliminate

# So many fast variables that depend on one another have polynomials that can be written out; with more, the
# determinant of their Jacobian has thousands of terms.
WRITTEN = 5
# A variable that the others move by so many units is not eliminated: errors of a run in them grow by as much in it.
STEEP = 100.0


@dataclass(frozen=True)
class Chart:
    """The functions on a branch: their `ring`, `coordinates`, the element of every x and y, g_y^-1, and the `centres`
    of x and y about which the ring's polynomials are written.

    The ring is a `CircuitRing` where that is asked for, or where more than `WRITTEN` fast variables depend on one
    another, else a `LocalisedRing`.
    """

    branch: Branch
    ring: Any
    coordinates: tuple[sp.Symbol, ...]
    elements: dict[sp.Symbol, Any]
    inverse_jacobian: list[list[RingElement]] | Factors
    centres: Mapping[sp.Symbol, sp.Rational]

    def solve(self, b: Sequence[Any]) -> list[Any]:
        """g_y^-1 b."""
        if isinstance(self.inverse_jacobian, Factors):
            return self.inverse_jacobian.solve(b)
        return [dot(row, b, self.ring) for row in self.inverse_jacobian]


def chart(
    branch: Branch, *, substitute: dict[sp.Symbol, sp.Expr] | None = None, programs: bool = False
) -> Chart:
    """The chart of a branch; `substitute` puts exact values for parameters, `programs` asks for a `CircuitRing`.

    Raises `HyperbolicityError` when the fast Jacobian is singular on the whole branch.
    """
    system = branch.system
    values = substitute or {}

    def put(expression: sp.Expr) -> sp.Expr:
        return expression.xreplace(values)

    require_rules({f"{s.name}'": rate for s, rate in zip(system.states, (*system.f, *system.g))})
    g0 = [put(laurent(g, system.epsilon, order=0).get(0, sp.Integer(0))) for g in system.g]
    g_y, g_x = slopes(g0, system.y), slopes(g0, system.x)
    parameters = tuple(p for p in system.parameters if p not in values)
    is_written = not programs and largest_block(g_y, len(g0), lambda e: not e.is_number) <= WRITTEN
    # The coordinates are the same whether the parameters have their values or not.
    states = frozenset(system.states)
    is_short = largest_block(g_y, len(g0), lambda e: not states.isdisjoint(e.free_symbols)) <= WRITTEN
    graph = _eliminated(branch) if is_short else dict(branch.graph or {})
    graph = {symbol: put(value) for symbol, value in graph.items()}
    coordinates = tuple(symbol for symbol in (*system.x, *system.y) if symbol not in graph)
    # Functions of eliminated variables become functions of their graphs, so those are counted too.
    expressions = [put(e) for e in (*system.f, *system.g)] + [*g_y.values(), *g_x.values(), *graph.values()]
    ring: Any
    about = centres(tuple(put(e) for e in (*system.f, *system.g)), system.states) if is_written else {}
    if is_written:
        ring = LocalisedRing(
            coordinates,
            constants=parameters,
            functions=not are_rational(expressions),
            derivations=len(system.x),
            centres=about,
        )
        sizes = np.log2(np.concatenate(branch.scales)).astype(int).tolist()
        ring.sizes = {s: size for s, size in zip(system.states, sizes) if size}
    else:
        ring = CircuitRing(coordinates, constants=parameters, derivations=len(system.x))
    for j, x in enumerate(system.x):
        if x in coordinates:
            ring.set_derivative(x, j, ring.one)
    elements = {symbol: ring.generator(symbol) for symbol in coordinates}
    cache: dict = {}
    for symbol, value in graph.items():
        elements[symbol] = read(value, ring, {}, cache).reduced()
    cache = {}
    read_entries = {place: read(e, ring, elements, cache) for place, e in g_y.items()}
    # What vanishes on the branch is no pivot.
    entries = {place: e for place, e in read_entries.items() if not e.is_zero}
    try:
        if is_written:
            fast = range(len(g0))
            inverse = invert([[entries.get((i, j), ring.zero) for j in fast] for i in fast], ring)
        else:
            inverse = factorised(entries, system.y, ring)
    except HyperbolicityError:
        raise HyperbolicityError(
            f"the fast Jacobian g_y is singular on the whole branch {branch}: det g_y = 0 for every "
            f"{', '.join(s.name for s in system.x)}.",
            "The branch is nowhere normally hyperbolic; check which variables are fast.",
        ) from None
    found = Chart(branch, ring, coordinates, elements, inverse, about)
    if any(y in coordinates for y in system.y):
        for j in range(len(system.x)):
            column = [
                read(g_x[i, j], ring, elements, cache) if (i, j) in g_x else ring.zero for i in range(len(g0))
            ]
            for y, slope in zip(system.y, found.solve(column)):
                if y in coordinates:
                    ring.set_derivative(y, j, (-slope).reduced())
    return found


def moving(chart: Chart, f: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """The coordinates' rates by powers of epsilon, from the slow variables' `f`.

    A fast coordinate is that of the point of M0, which moves with the slow variables: y0' = sum_j (D_j y0) x_j'.
    """
    ring, x = chart.ring, chart.branch.system.x
    rows = []
    for coordinate in chart.coordinates:
        if coordinate in x:
            rows.append(list(f[x.index(coordinate)]))
            continue
        slopes = [ring.derive(ring.generator(coordinate), j) for j in range(len(x))]
        rows.append([dot(slopes, terms, ring).reduced() for terms in zip(*f)])
    return rows


def set_apart(chart: Chart, others: Iterable[sp.Symbol] = ()) -> dict[sp.Symbol, sp.Symbol]:
    """Fresh symbols for the fast coordinates of M0, which are not the fast variables on M_epsilon; none of `others`."""
    system = chart.branch.system
    taken = {s.name for s in (*system.states, *system.parameters, *system.observables, *others)}
    result = {}
    for symbol in chart.coordinates:
        if symbol in system.y:
            name = symbol.name + "0"
            while name in taken:
                name += "0"
            # y1 becomes y10, and then a y10 of its own may not become the same.
            taken.add(name)
            result[symbol] = sp.Symbol(name)
    return result


def largest_block(entries: Mapping[tuple[int, int], sp.Expr], n: int, counts: Callable[[sp.Expr], bool]) -> int:
    """How many fast variables depend on one another at most, in blocks of which an entry `counts`; 1 without any."""
    largest = 1
    for block in triangular_blocks([[(i, j) in entries for j in range(n)] for i in range(n)]):
        members = set(block)
        if any(i in members and j in members and counts(e) for (i, j), e in entries.items()):
            largest = max(largest, len(block))
    return largest


def factorised(
    entries: Mapping[tuple[int, int], Gate], fast: Sequence[sp.Symbol], ring: CircuitRing
) -> Factors:
    """The factors of a matrix of programs by its entries, one row and column for each of `fast`, eliminated in
    Markowitz's order.

    Where a diagonal entry is missing, as of positions that move with their velocities, rows are matched with columns.
    Equals go by their names: how long a program is does not depend on the order in which variables are declared.
    """
    places = sorted(range(len(fast)), key=lambda k: fast[k].name)
    ranks = {place: rank for rank, place in enumerate(places)}
    sources = _matched(len(fast), {(ranks[i], ranks[j]) for i, j in entries})
    at = {places[source]: places[k] for k, source in enumerate(sources)}
    entries = {(at[i], j): entry for (i, j), entry in entries.items()}
    found = eliminate(len(fast), [(ranks[i], ranks[j]) for i, j in entries])
    order = tuple(places[k] for k in found.order)
    rows, columns = (
        tuple(tuple(places[k] for k in part) for part in parts) for parts in (found.rows, found.columns)
    )
    source_of = {k: i for i, k in at.items()}
    return Factors(ring, entries, order, rows, columns, [source_of[k] for k in range(len(fast))])


def _matched(n: int, entries: Collection[tuple[int, int]]) -> list[int]:
    """For each column a row of its own with an entry there, its own row where there is one in each."""
    if all((k, k) in entries for k in range(n)):
        return list(range(n))
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import maximum_bipartite_matching

    rows, columns = zip(*sorted(entries))
    pattern = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    found = maximum_bipartite_matching(pattern, perm_type="row")
    if (found < 0).any():
        raise HyperbolicityError("the matrix is singular.")
    return found.tolist()


def dot(a: Sequence[RingElement], b: Sequence[RingElement], ring: LocalisedRing) -> RingElement:
    """sum_i a_i b_i."""
    total = ring.zero
    for x, y in zip(a, b):
        if not x.is_zero and not y.is_zero:
            total = total + x * y
    return total


def invert(matrix: list[list[RingElement]], ring: LocalisedRing) -> list[list[RingElement]]:
    """Inverse block by block: variables that drive one another one way, as in a chain, are inverted one by one."""
    n = range(len(matrix))
    inverse = [[ring.zero for _ in n] for _ in n]
    known: list[int] = []
    for block in triangular_blocks([[not entry.is_zero for entry in row] for row in matrix]):
        own = _invert_block([[matrix[i][j] for j in block] for i in block], ring)
        for column in known:
            ahead = [inverse[d][column] for d in known]
            forced = [dot([matrix[i][d] for d in known], ahead, ring) for i in block]
            for i, row in zip(block, own):
                inverse[i][column] = (-dot(row, forced, ring)).reduced()
        for i, row in zip(block, own):
            for j, entry in zip(block, row):
                inverse[i][j] = entry
        known += block
    return inverse


def _invert_block(matrix: list[list[RingElement]], ring: LocalisedRing) -> list[list[RingElement]]:
    """Inverse by the Faddeev-LeVerrier recursion, which divides by integers and by the determinant only.

    Gaussian elimination would make every pivot a denominator of the ring. It is what inverts numbers.
    """
    n = len(matrix)
    numbers: Any = [[number_of(entry) for entry in row] for row in matrix]
    if n > 1 and all(number is not None for row in numbers for number in row):
        try:
            inverse = flint.fmpq_mat(numbers).inv()
        except ZeroDivisionError:
            raise HyperbolicityError("the matrix is singular.") from None
        return [[ring.one * inverse[i, j] for j in range(n)] for i in range(n)]
    identity = [[ring.one if i == j else ring.zero for j in range(n)] for i in range(n)]
    adjugate, product, coefficient = identity, matrix, ring.one
    for k in range(1, n + 1):
        if k > 1:
            adjugate = [
                [product[i][j] + (coefficient if i == j else ring.zero) for j in range(n)] for i in range(n)
            ]
            columns = [[adjugate[i][j] for i in range(n)] for j in range(n)]
            product = [[dot(row, column, ring).reduced() for column in columns] for row in matrix]
        trace = ring.zero
        for i in range(n):
            trace = trace + product[i][i]
        coefficient = (trace * ring.constant(sp.Rational(-1, k))).reduced()
    # A adj = -c_n 1 with the last coefficient c_n of the characteristic polynomial.
    scale = (-coefficient).inverse()
    return [[(scale * entry).reduced() for entry in row] for row in adjugate]


def _eliminated(branch: Branch) -> dict[sp.Symbol, sp.Expr]:
    """Variables that the branch's equations give as polynomials or, when explicit, as the graph."""
    if branch.graph is not None:
        return dict(branch.graph)
    system = branch.system
    variables = [*system.y, *system.x]
    # In an order of their own, so that nothing depends on that in which variables are declared.
    equations = sorted((sp.numer(sp.together(e)) for e in branch.equations), key=str)
    size = _size_at(branch)
    graph: dict[sp.Symbol, sp.Expr] = {}
    while equations:
        found = next(_eliminations(equations, variables, graph, system.x, size), None)
        if found is None:
            break
        symbol, equations, graph = found
        variables.remove(symbol)
    return graph


def _eliminations(
    equations: list[sp.Expr],
    variables: list[sp.Symbol],
    graph: dict[sp.Symbol, sp.Expr],
    slow: Collection[sp.Symbol],
    size: Callable[[sp.Symbol, sp.Expr], float],
) -> Iterator[tuple[sp.Symbol, list[sp.Expr], dict[sp.Symbol, sp.Expr]]]:
    """(variable, equations left, graph) for every variable that an equation gives, as far as the rest stays short:
    fast ones first, and none that the others move steeply by their `size`.

    Squares of squares double their degree each time: one more coordinate is cheaper than such a graph.
    """
    candidates = []
    for i, equation in enumerate(equations):
        gradient = {s: derivative(equation, s) for s in variables if s in equation.free_symbols}
        # Only parameters may multiply it: a factor that vanishes somewhere would end the chart there. Nor is it linear
        # where it stands in a sign too, whose slope is 0.
        linear = [
            s for s, slope in gradient.items()
            if slope != 0 and not slope.has(*variables) and not sp.expand(equation - slope * s).has(s)
        ]  # fmt: skip
        sizes = {s: size(s, slope) for s, slope in gradient.items()} if linear else {}
        candidates += [
            (s not in slow, s.name, i, s, gradient[s])
            for s in linear
            if max(sizes.values()) <= STEEP * sizes[s]
        ]
    for _, _, i, symbol, slope in sorted(candidates, key=lambda candidate: candidate[:3], reverse=True):
        value = -equations[i].subs(symbol, 0) / slope
        rest = [e.subs(symbol, value) for j, e in enumerate(equations) if j != i]
        values = {s: v.subs(symbol, value) for s, v in graph.items()}
        if all(_is_short(e, variables) for e in (value, *rest, *values.values())):
            expanded = {s: sp.expand(v) for s, v in values.items()}
            yield symbol, [sp.numer(sp.together(e)) for e in rest], {**expanded, symbol: sp.expand(value)}


def _size_at(branch: Branch) -> Callable[[sp.Symbol, sp.Expr], float]:
    """How much a unit of a variable changes an equation at the branch's seed, by its slope there."""
    system = branch.system
    units = dict(zip(system.states, np.concatenate(branch.scales).tolist()))
    place = units.values() if branch.seed is None else np.concatenate(branch.seed).tolist()
    at = dict(zip(system.states, map(sp.Float, place))) | dict(system.parameters)

    def size(symbol: sp.Symbol, slope: sp.Expr) -> float:
        found = abs(complex(slope.xreplace(at).evalf()))
        return found * units[symbol] if math.isfinite(found) else 0.0

    return size


def _is_short(expression: sp.Expr, variables: Sequence[sp.Symbol]) -> bool:
    # Variables are eliminated by polynomials of this degree at most: a chain of cubics triples it with each
    # link.
    return quotient(expression) is not None and (degree(expression, variables) or 0) <= 15
