"""Bases in which the fast directions of a slow manifold part: P(x) from exact eigenvectors, or one constant matrix."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import jacobian
from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.proofs.spectrum import IMAGINARY


@dataclass(frozen=True, eq=False)
class AdaptedBasis:
    """P (m, m), its columns grouped into `blocks` of places, and the sign (-1 stable, 1 unstable) of each block."""

    matrix: sp.Matrix
    blocks: tuple[tuple[int, ...], ...]
    signs: tuple[int, ...]


def fast_jacobian(branch: Branch, values: Mapping[sp.Symbol, sp.Expr]) -> sp.Matrix:
    """D_y g on the graph of an explicit branch, with `values` of parameters."""
    system, graph = branch.system, branch.graph
    assert graph is not None
    at = {y: sp.sympify(e, strict=True).xreplace(values) for y, e in graph.items()}
    g = [laurent(e, system.epsilon, order=0).get(0, sp.Integer(0)).xreplace(values) for e in system.g]
    return jacobian(g, system.y).xreplace(at)


def adapted_bases(
    matrix: sp.Matrix, x: Sequence[sp.Symbol], points: Sequence[dict[sp.Symbol, sp.Rational]]
) -> Iterator[AdaptedBasis]:
    """Bases for D_y g on M0, a `matrix` (m, m) of functions of x; the likeliest first, judged at `points`.

    The signs are those at the first point. One that is wrong elsewhere proves nothing.
    """
    m = matrix.rows
    at = np.array(matrix.xreplace(points[0]).evalf(), dtype=float)
    if not np.isfinite(at).all():
        return
    if m == 1:
        yield AdaptedBasis(sp.eye(1), ((0,),), (1 if at[0, 0] > 0.0 else -1,))
        return
    # Beyond so many fast variables exact eigenvectors are not looked for.
    if m <= 3 and matrix.has(*x):
        exact = _eigenvectors(matrix, points[0])
        if exact is not None:
            vectors, values = exact
            signs = tuple(1 if float(v.xreplace(points[0])) > 0.0 else -1 for v in values)
            yield AdaptedBasis(vectors, tuple((i,) for i in range(m)), signs)
    yield _constant(at)


def _eigenvectors(
    matrix: sp.Matrix, point: dict[sp.Symbol, sp.Rational]
) -> tuple[sp.Matrix, list[sp.Expr]] | None:
    """Eigenvectors as columns and eigenvalues where all are rational functions and distinct; else None."""
    value = sp.Dummy("lambda")
    characteristic = sp.together((value * sp.eye(matrix.rows) - matrix).det(method="berkowitz"))
    try:
        factors = sp.factor_list(sp.numer(characteristic), value)[1]
    except sp.PolynomialError:
        return None
    columns, values = [], []
    for factor, multiplicity in factors:
        polynomial = sp.Poly(factor, value)
        if polynomial.degree() == 0:
            continue
        if polynomial.degree() > 1 or multiplicity > 1:
            return None
        root = sp.cancel(-polynomial.nth(0) / polynomial.nth(1))
        null = (matrix - root * sp.eye(matrix.rows)).applyfunc(sp.cancel).nullspace(simplify=True)
        if len(null) != 1:
            return None
        # The component that is largest at the point becomes 1.
        sizes = [abs(complex(e.xreplace(point).evalf())) for e in null[0]]
        largest = null[0][int(np.argmax(sizes))]
        columns.append(null[0].applyfunc(lambda e, scale=largest: sp.cancel(e / scale)))
        values.append(root)
    return (sp.Matrix.hstack(*columns), values) if len(columns) == matrix.rows else None


def _constant(at: np.ndarray) -> AdaptedBasis:
    found, vectors = np.linalg.eig(at)
    eigenvalues = [complex(value) for value in found]
    columns: list[np.ndarray] = []
    blocks, signs = [], []
    for i in np.argsort(np.real(found), kind="stable"):
        paired = abs(eigenvalues[i].imag) > IMAGINARY * abs(eigenvalues[i])
        if paired and eigenvalues[i].imag < 0.0:
            continue
        first = len(columns)
        columns += [np.real(vectors[:, i]), np.imag(vectors[:, i])] if paired else [np.real(vectors[:, i])]
        blocks.append(tuple(range(first, len(columns))))
        signs.append(1 if eigenvalues[i].real > 0.0 else -1)
    # A constant basis is a proof whatever its digits; few of them keep the exact expressions short.
    scale = 2**10
    rounded = sp.Matrix(len(at), len(at), lambda i, j: sp.Rational(round(columns[j][i] * scale), scale))
    return AdaptedBasis(rounded, tuple(blocks), tuple(signs))
