"""Integrability of a distribution D = {A qdot + c = 0}: Frobenius' test and the flag of brackets.

For affine constraints D lives on space-time: it is spanned by (S_i, 0) and (-T c, 1), with time as one more
coordinate, and the constraints are the one-forms A dq + c dt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.algebra.ring_elements import RingElement
from gsp.mechanics.algebra import Algebra, entries, generic_points, numbers
from gsp.mechanics.frame import MovingFrame, inverse_forms
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.velocity_forms import rank
from gsp.slow.coordinates import dot

VectorElements = list[RingElement]


@dataclass(frozen=True)
class Flag:
    """`growth` holds the ranks of D, D + [D, D], ... at a generic point until they grow no more.

    `integrable[j]` says whether constraint j vanishes on the last of these: then it is, with the others of its
    kind, a constraint on positions in disguise (Remark 2.4).
    """

    growth: tuple[int, ...]
    integrable: tuple[bool, ...]

    @property
    def is_holonomic(self) -> bool:
        """Whether D is involutive, so that Frobenius' theorem makes every constraint integrable."""
        return all(self.integrable)


def flag(system: LagrangianSystem, frame: MovingFrame) -> Flag:
    """The flag of brackets of D; ranks are taken at a generic point and the parameters' values."""
    n, a = len(system.coordinates), len(frame.along)
    affine = any(c != 0 for c in frame.offset)
    clock = (sp.Dummy("time"),) if affine else ()
    base = (*system.coordinates, *clock)
    algebra = Algebra(base, tuple(system.values), [*entries(frame.forms), *frame.offset], derivations=len(base))
    ring = algebra.ring
    for i, q in enumerate(base):
        ring.set_derivative(q, i, ring.one)
    psi = inverse_forms(algebra, frame)
    zero = [ring.zero] * len(clock)
    fields = [[*(psi[i][j] for i in range(n)), *zero] for j in range(a)]
    offsets = [algebra.read(c) for c in frame.offset]
    if affine:
        fields.append([*(-dot(row[a:], offsets, ring) for row in psi), ring.one])
    covectors = [
        [*(algebra.read(e) for e in entries(frame.forms.row(a + j))), *([c] if affine else [])]
        for j, c in enumerate(offsets)
    ]
    generic = generic_points(1, len(base))

    def rank_of(vectors: Sequence[VectorElements]) -> int:
        written = [algebra.write(e, factored=False) for vector in vectors for e in vector]
        return rank(numbers(written, base, generic, system.values).reshape(len(vectors), len(base)))

    basis, growth, newest = list(fields), [len(fields)], list(fields)
    while True:
        found = []
        for X in fields:
            for Y in newest:
                bracket = _bracket(algebra, X, Y)
                if any(not e.is_zero for e in bracket) and rank_of([*basis, bracket]) > len(basis):
                    basis.append(bracket)
                    found.append(bracket)
        if not found:
            break
        growth.append(len(basis))
        newest = found
    integrable = tuple(all(dot(form, vector, ring).reduced().is_zero for vector in basis) for form in covectors)
    return Flag(tuple(growth), integrable)


def _bracket(algebra: Algebra, X: VectorElements, Y: VectorElements) -> VectorElements:
    ring = algebra.ring
    result = []
    for i in range(len(X)):
        total = ring.zero
        for j in range(len(X)):
            if not X[j].is_zero:
                total = total + X[j] * ring.derive(Y[i], j)
            if not Y[j].is_zero:
                total = total - Y[j] * ring.derive(X[i], j)
        result.append(total.reduced())
    return result
