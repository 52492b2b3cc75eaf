"""The near-identity transformation that averages a field with a fast phase, order by order and exactly.

In fast time x' = epsilon f(x, theta, epsilon) and theta' = Omega(x, theta, epsilon). With
x = X + sum epsilon^k u_k(X, T), theta = T + sum epsilon^k v_k(X, T), X' = sum epsilon^k F_k(X) and
T' = omega(X) + sum epsilon^k G_k(X), the terms of epsilon^k are

    omega du_k/dT + F_k = [epsilon f]_k - sum_(0<j<k) (F_j d/dX + G_j d/dT) u_(k-j),
    omega dv_k/dT + G_k = [Omega]_k     - sum_(0<j<k) (F_j d/dX + G_j d/dT) v_(k-j),

where [.]_k is of the field along the series, which holds u_j and v_j for j < k, and u_k in [Omega]_k. F_k and G_k are
the means over T, u_k and v_k integrals of mean zero (J. A. Sanders, F. Verhulst, J. Murdock, Averaging Methods in
Nonlinear Dynamical Systems, 2007, sections 2.9 and 7.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gsp.algebra.fourier_ring import FourierRing
from gsp.algebra.functions import are_rational
from gsp.algebra.power_series import SeriesProgram, convolve
from gsp.algebra.ring_elements import RingElement
from gsp.averaging.phase_form import PhaseForm
from gsp.systems.flow import Values, read_only

Row = list[RingElement]


class NearIdentity:
    """F_k and G_k of a form in fast time, for k from 1 to `order` + 1, and u_k and v_k through `order`.

    `constants` stay symbols, and `values` are put in for others first.
    """

    def __init__(
        self,
        form: PhaseForm,
        *,
        epsilon: sp.Symbol,
        constants: Sequence[sp.Symbol],
        values: Values,
        order: int,
    ) -> None:
        self.form = form
        x = list(form.rates)
        expressions = [e.xreplace(dict(values)) for e in (*form.rates.values(), form.turning)]
        ring = self.ring = FourierRing(x, constants=constants, functions=not are_rational(expressions))
        waves = [ring.harmonics_of(e, form.phase) for e in expressions]
        self._x: list[Row] = [[ring.generator(symbol)] for symbol in x]
        self._phase: Row = [ring.zero]
        # The series of sine and cosine along theta = T + sum epsilon^k v_k.
        self._sine, self._cosine = [ring.generator(ring.sine)], [ring.generator(ring.cosine)]
        inputs = {ring.sine: self._sine, ring.cosine: self._cosine, **dict(zip(x, self._x))}
        self._program = SeriesProgram(ring, epsilon=epsilon, inputs=inputs, constants={})
        self._f = [self._program.compile(wave) for wave in waves[:-1]]
        self._turning = self._program.compile(waves[-1])
        self._program.extend(0)
        self._slower = self._turning.coefficients[0].reduced().inverse()
        self._rates: list[Row] = [[ring.zero] for _ in x]
        self._turns: Row = [self._turning.coefficients[0].reduced()]
        for k in range(1, order + 1):
            self._next(k)
        # One order more of what moves X and T, which needs no more of the transformation.
        k = order + 1
        for rates, row, f in zip(self._rates, self._x, self._f):
            rates.append(ring.mean(self._right(row, f.coefficients[order], k)))
        for row in self._x:
            row.append(ring.zero)
        self._move_phase(k, ring.zero)
        self._program.extend(k)
        self._turns.append(ring.mean(self._right(self._phase, self._turning.coefficients[k], k)))

    @property
    def averaged_field(self) -> tuple[Values, ...]:
        """F_1, F_2, ... by slow variable."""
        rows = [[self.ring.to_sympy(e) for e in row[1:]] for row in self._rates]
        return tuple(read_only(dict(zip(self.form.rates, each))) for each in zip(*rows))

    @property
    def frequency(self) -> tuple[sp.Expr, ...]:
        """omega, G_1, G_2, ..."""
        return tuple(self.ring.to_sympy(e) for e in self._turns)

    @property
    def transformation(self) -> tuple[Values, ...]:
        """u_1, u_2, ... by slow variable, with v_1, v_2, ... for the phase."""
        phase = self.form.phase
        rows = [[self.ring.in_harmonics(e, phase) for e in row[1:-1]] for row in (*self._x, self._phase)]
        return tuple(read_only(dict(zip((*self.form.rates, phase), each))) for each in zip(*rows))

    def _next(self, k: int) -> None:
        ring = self.ring
        rights = [self._right(row, f.coefficients[k - 1], k) for row, f in zip(self._x, self._f)]
        for rates, row, right in zip(self._rates, self._x, rights):
            rates.append(ring.mean(right))
            row.append(self._shift(right))
        self._move_phase(k, ring.zero)
        self._program.extend(k)
        right = self._right(self._phase, self._turning.coefficients[k], k)
        self._turns.append(ring.mean(right))
        self._move_phase(k, self._shift(right))
        self._program.extend(k)

    def _shift(self, right: RingElement) -> RingElement:
        """The integral of mean zero over the phase, divided by omega."""
        return (self.ring.integral(right) * self._slower).reduced()

    def _right(self, row: Row, field: RingElement, k: int) -> RingElement:
        """`field` less sum_(0<j<k) (F_j d/dX + G_j d/dT) of the transformation in `row`."""
        for j in range(1, k):
            field = field - self._along(j, row[k - j])
        return field.reduced()

    def _along(self, j: int, a: RingElement) -> RingElement:
        """(F_j d/dX + G_j d/dT) a."""
        ring = self.ring
        total = self._turns[j] * ring.derive(a, len(self._x))
        for i, rates in enumerate(self._rates):
            total = total + rates[j] * ring.derive(a, i)
        return total.reduced()

    def _move_phase(self, k: int, shift: RingElement) -> None:
        """Let v_k be `shift`: k S_k = sum_j j v_j C_(k-j) and k C_k = -sum_j j v_j S_(k-j)."""
        ring = self.ring
        for row in (self._phase, self._sine, self._cosine):
            del row[k:]
        self._phase.append(shift)
        slopes = [self._phase[j] * j for j in range(k + 1)]
        share = sp.Rational(1, k)
        sine = convolve(slopes, [*self._cosine, ring.zero], k, ring) * share
        cosine = convolve(slopes, [*self._sine, ring.zero], k, ring) * -share
        self._sine.append(sine.reduced())
        self._cosine.append(cosine.reduced())
