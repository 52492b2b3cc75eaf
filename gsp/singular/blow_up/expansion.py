"""The field at a nilpotent point as Taylor polynomials, on the centre manifold of the zero eigenvalue.

The layer problem's Jacobian g_y has the null vectors l, r, l . r = 1. The fast variables are v = l . (y - y_0) and
u_i = (y - y_0)_i - r_i v for all i but one with l_i != 0; u' = C u + ... with C regular. The centre manifold u = h
solves

    C h = -N(v, x, h) + h_v G + epsilon h_x F,      N the rest of u',                                              (1)

degree by degree (Carr, *Applications of centre manifold theory*, 1981).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import AlgebraicPoint
from gsp.algebra.local_series import BITS, LocalRing, LocalSeries, Polynomial
from gsp.algebra.ring import read
from gsp.hyperbolicity.losses.zeros import ZERO_SINGULAR
from gsp.singular.blow_up.local_form import BlowUpError, LocalForm
from gsp.systems.system import SlowFastSystem

Matrix = list[list[Polynomial]]


def expanded(
    system: SlowFastSystem,
    point: AlgebraicPoint | Mapping[sp.Symbol, sp.Rational],
    parameters: Sequence[sp.Symbol],
    degree: int,
) -> LocalForm:
    """The rates at `point`, which is exact or near to rounding, in the states, the `parameters` and epsilon."""
    is_exact = isinstance(point, AlgebraicPoint)
    field = point.field if is_exact and not point.is_rational else None
    names = (*system.y, *system.x, *parameters, system.epsilon)
    ring = LocalRing(len(names), degree, field, is_exact)
    environment = {p: ring.constant(sp.Rational(value)) for p, value in system.parameters.items()}
    for symbol in system.states:
        value = point.values[symbol] if is_exact else point[symbol]
        environment[symbol] = ring.scalar(ring.element(value)) if is_exact else ring.constant(value)
    environment[system.epsilon] = ring.zero
    for i, symbol in enumerate(names):
        environment[symbol] = environment[symbol] + ring.variable(i)
    cache: dict = {}
    fast, slow = ([read(e, ring, environment, cache) for e in rates] for rates in (system.g, system.f))
    if isinstance(point, AlgebraicPoint) and field is not None and not ring.is_exact:
        # Beside a number that is not in it no element of the field is seen to be zero.
        return expanded(system, point.near(BITS + 64), parameters, degree)
    # Whether all values were exact is known now only.
    fast, slow = (
        [LocalSeries(ring, [ring.reduced(part) for part in e.parts]) for e in rates] for rates in (fast, slow)
    )
    return LocalForm(ring, names, fast, slow)


def block_of(form: LocalForm) -> LocalForm:
    """`form` on the centre manifold of its nilpotent block of fast directions.

    Raises `BlowUpError` where g_y is regular, has several null vectors, more than two zero eigenvalues, or an imaginary
    pair beside them.
    """
    ring, n = form.ring, len(form.fast)
    jacobian = [[g.slope(j) for j in range(n)] for g in form.fast]
    right = null_vectors(ring, jacobian)
    if not right:
        raise BlowUpError("the fast Jacobian g_y is regular here.", "Nothing has to be blown up.")
    if len(right) > 1:
        raise BlowUpError(
            f"the fast Jacobian g_y has {len(right)} null vectors here.",
            "Points with one null vector are blown up.",
            value=len(right),
        )
    r, left = right[0], null_vectors(ring, [list(column) for column in zip(*jacobian)])[0]
    return form if n == 1 else _reduced(form, r, left)


def _reduced(form: LocalForm, r: list[Polynomial], left: list[Polynomial]) -> LocalForm:
    """The field in (v, u), then on u = h."""
    ring, n = form.ring, len(form.fast)
    product = _dot(ring, left, r)
    if product.is_zero() and n == 2:
        return _double(form, r)
    if product.is_zero():
        raise BlowUpError(
            "the fast Jacobian g_y has a double zero eigenvalue here and more than two fast directions.",
            "Blow up the system reduced to the two of them.",
        )
    scale = ring.inverse(product)
    left = [ring.reduced(c * scale) for c in left]
    own = next(i for i in reversed(range(n)) if not ring.reduced(left[i] * r[i]).is_zero())
    others = [i for i in range(n) if i != own]
    # In place of y_i stands u_i + r_i v, and v in the place of `own`.
    images = [ring.variable(i) + ring.scalar(r[i]) * ring.variable(own) for i in range(n)]
    images[own] = ring.scalar(r[own]) * ring.variable(own)
    first = ring.inverse(left[own])
    for i in others:
        images[own] = images[own] - ring.scalar(ring.reduced(left[i] * first)) * ring.variable(i)
    rates = [_with_variables(e, images) for e in (*form.fast, *form.slow)]
    fast, slow = rates[:n], rates[n:]
    along = ring.zero
    for c, g in zip(left, fast):
        along = along + ring.scalar(c) * g
    across = [fast[i] - ring.scalar(r[i]) * along for i in others]
    v = sp.Add(*(ring.expression(c) * y for c, y in zip(left, form.names)))
    h = _centre_manifold(form, own, others, along, across, slow)
    along, *slow = (_on(e, others, h) for e in (along, *slow))
    return _packed(form, own, along, slow, v)


def _double(form: LocalForm, r: list[Polynomial]) -> LocalForm:
    """The field in (v, w), y - y_0 = r v + q w with g_y q = r, so that v' = w + ..."""
    ring = form.ring
    at = next(j for j in (0, 1) if any(not g.slope(j).is_zero() for g in form.fast))
    i = next(i for i in (0, 1) if not r[i].is_zero())
    length = ring.reduced(r[i] * ring.inverse(form.fast[i].slope(at)))
    q = [ring.nothing, ring.nothing]
    q[at] = length
    inverse = _inverse(ring, [[r[0], q[0]], [r[1], q[1]]])
    images = [ring.scalar(a) * ring.variable(0) + ring.scalar(b) * ring.variable(1) for a, b in zip(r, q)]
    fast, slow = ([_with_variables(e, images) for e in rates] for rates in (form.fast, form.slow))
    block = [sp.Add(*(ring.expression(c) * y for c, y in zip(row, form.names))) for row in inverse]
    return LocalForm(ring, form.names, [_combination(ring, row, fast) for row in inverse], slow, block)


def _packed(
    form: LocalForm, own: int, along: LocalSeries, slow: Sequence[LocalSeries], v: sp.Expr
) -> LocalForm:
    """The form without the variables that the centre manifold gives."""
    n = len(form.fast)
    kept = [own, *range(n, len(form.names))]
    ring = LocalRing(len(kept), form.ring.degree, form.ring.field, form.ring.is_exact)

    def moved(series: LocalSeries) -> LocalSeries:
        parts = []
        for part in series.parts:
            terms = part.to_dict().items()
            parts.append(ring.context.from_dict({(m[0], *(m[i + 1] for i in kept)): c for m, c in terms}))
        return LocalSeries(ring, parts)

    names = [form.names[i] for i in kept]
    return LocalForm(ring, names, [moved(along)], [moved(e) for e in slow], [v])


def _with_variables(series: LocalSeries, images: Sequence[LocalSeries]) -> LocalSeries:
    """`series` with linear `images` of its first variables, all at once."""
    ring, total = series.ring, series.ring.zero
    powers: dict[tuple[int, int], LocalSeries] = {}

    def power(i: int, k: int) -> LocalSeries:
        if (i, k) not in powers:
            powers[i, k] = images[i] if k == 1 else power(i, k - 1) * images[i]
        return powers[i, k]

    for m, c in series.terms():
        term = ring.scalar(c)
        for i, k in enumerate(m):
            if k:
                term = term * (power(i, k) if i < len(images) else _monomial(ring, i, k))
        total = total + term
    return total


def _monomial(ring: LocalRing, i: int, k: int) -> LocalSeries:
    return LocalSeries(ring, [*([ring.nothing] * k), ring.generators[i] ** k])


def _centre_manifold(
    form: LocalForm,
    own: int,
    others: list[int],
    along: LocalSeries,
    across: list[LocalSeries],
    slow: list[LocalSeries],
) -> list[LocalSeries]:
    """h of (1), one more degree at a time.

    Beside what the lower parts give, a part obeys C h_k = (h_k)_v G_1 + epsilon (h_k)_x F_0, which takes every term to
    one of less of v and x: the series of what it gives ends.
    """
    C = [[e.slope(i) for i in others] for e in across]
    inverse = _inverse(form.ring, C)
    _check_off_axis(form.ring, C)
    h = [form.ring.zero for _ in others]
    for degree in range(1, form.ring.degree + 1):
        ring = LocalRing(form.ring.size, degree, form.ring.field, form.ring.is_exact)
        h = [LocalSeries(ring, own_h.parts) for own_h in h]
        G, *rest = (_on(LocalSeries(ring, e.parts), others, h) for e in (along, *across, *slow))
        N, F = rest[: len(others)], rest[len(others) :]
        moves = [(own, G), *((j, ring.variable(form.small) * f) for j, f in zip(form.slow_at, F))]

        def moved(e: LocalSeries, ring=ring, moves=moves) -> LocalSeries:
            return sum((e.derivative(i) * rate for i, rate in moves), ring.zero)

        step = [_combination(ring, row, [moved(own_h) - e for e, own_h in zip(N, h)]) for row in inverse]
        while not all(e.is_rounding_of(own_h) for e, own_h in zip(step, h)):
            h = [a + b for a, b in zip(h, step)]
            step = [_combination(ring, row, list(map(moved, step))) for row in inverse]
    return [LocalSeries(form.ring, own_h.parts) for own_h in h]


def _check_off_axis(ring: LocalRing, C: Matrix) -> None:
    values = np.linalg.eigvals(np.array([[float(sp.N(ring.expression(c))) for c in row] for row in C]))
    pair = values[(values.imag > 0.0) & (np.abs(values.real) <= ZERO_SINGULAR * np.abs(values))]
    if pair.size:
        raise BlowUpError(
            f"an imaginary pair of fast eigenvalues, +-{pair[0].imag:.4g}i, is beside the zero one here: both "
            "belong to one centre manifold, and a blow-up of the zero alone would leave the pair out.",
            "Integrate the full system across it, or move a parameter so that the two are apart.",
            value=tuple(values),
        )


def _combination(ring: LocalRing, row: Sequence[Polynomial], series: Sequence[LocalSeries]) -> LocalSeries:
    total = ring.zero
    for c, e in zip(row, series):
        total = total + ring.scalar(c) * e
    return total


def _on(series: LocalSeries, others: Sequence[int], h: Sequence[LocalSeries]) -> LocalSeries:
    for i, image in zip(others, h):
        series = series.with_variable(i, image)
    return series


def _dot(ring: LocalRing, a: Sequence[Polynomial], b: Sequence[Polynomial]) -> Polynomial:
    return ring.reduced(sum((x * y for x, y in zip(a, b)), ring.nothing))


def null_vectors(ring: LocalRing, matrix: Matrix) -> list[list[Polynomial]]:
    """A basis of the vectors with matrix v = 0, by elimination in the ring's field."""
    rows, pivots = _eliminated(ring, matrix)
    columns = len(matrix[0])
    basis = []
    for free in (j for j in range(columns) if j not in pivots):
        vector = [ring.nothing] * columns
        vector[free] = ring.context.constant(1)
        for i, pivot in enumerate(pivots):
            vector[pivot] = -rows[i][free]
        basis.append(vector)
    return basis


def _inverse(ring: LocalRing, matrix: Matrix) -> Matrix:
    n = len(matrix)
    unit = [[ring.context.constant(int(i == j)) for j in range(n)] for i in range(n)]
    rows, pivots = _eliminated(ring, [[*row, *more] for row, more in zip(matrix, unit)])
    if pivots != list(range(n)):
        raise BlowUpError(
            "the fast Jacobian g_y has more than one zero eigenvalue here.",
            "A block of two is blown up where no other fast direction is there.",
        )
    return [row[n:] for row in rows]


def _eliminated(ring: LocalRing, matrix: Matrix) -> tuple[Matrix, list[int]]:
    """Reduced row echelon form and its pivots' columns."""
    rows, pivots = [list(row) for row in matrix], []
    for column in range(len(rows[0])):
        at = len(pivots)
        found = next((i for i in range(at, len(rows)) if not rows[i][column].is_zero()), None)
        if found is None:
            continue
        rows[at], rows[found] = rows[found], rows[at]
        inverse = ring.inverse(rows[at][column])
        rows[at] = [ring.reduced(c * inverse) for c in rows[at]]
        for i in range(len(rows)):
            if i != at and not rows[i][column].is_zero():
                factor = rows[i][column]
                rows[i] = [ring.reduced(a - factor * b) for a, b in zip(rows[i], rows[at])]
        pivots.append(column)
        if len(pivots) == len(rows):
            break
    return rows, pivots
