"""Taylor jets in time along the full flow, and their derivatives by the fast start, through a tape.

A tape is an array of instructions (operation, a, b, c): a and b are earlier rows (b also a later one, in `CHAIN`),
c a place in the array of constants. Rows 0..n-1 are the states. In fast time tau = t/epsilon the flow is
dx/dtau = epsilon f, dy/dtau = g, so that every coefficient stays O(1) as epsilon goes to 0.

A row's value is v[k], its coefficient of tau^k. An elementary function v = F(u) with dv/du = r obeys
k v_k = sum_j j u_j r_(k-j) (Griewank and Walther 2008, section 13.2): r is wanted only to order k - 1, so that it
may stand later in the tape and depend on v.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.compilation import kernel

STATE, CONSTANT, ADD, SUBTRACT, MULTIPLY, DIVIDE, SHIFT, SCALE, QUOTIENT, SIGN = range(10)
# From here on: v = F(u), u in row a, dv/du in row b; the number says which function.
CHAIN = 20
(
    POWER, EXP, LOG, SQRT, SIN, COS, TAN, SINH, COSH, TANH, ASIN, ACOS, ATAN, ASINH, ACOSH, ATANH, ERF,
    LOG1P, EXPM1,
) = range(CHAIN, CHAIN + 19)  # fmt: skip


@kernel
def _elementary(operation, u, constant):
    # NumPy's functions: outside their domain those of math raise, and NaN is what the layers above look for.
    if operation == EXP:
        return np.exp(u)
    if operation == LOG:
        return np.log(u)
    if operation == SQRT:
        return np.sqrt(u)
    if operation == SIN:
        return np.sin(u)
    if operation == COS:
        return np.cos(u)
    if operation == TAN:
        return np.tan(u)
    if operation == SINH:
        return np.sinh(u)
    if operation == COSH:
        return np.cosh(u)
    if operation == TANH:
        return np.tanh(u)
    if operation == ASIN:
        return np.arcsin(u)
    if operation == ACOS:
        return np.arccos(u)
    if operation == ATAN:
        return np.arctan(u)
    if operation == ASINH:
        return np.arcsinh(u)
    if operation == ACOSH:
        return np.arccosh(u)
    if operation == ATANH:
        return np.arctanh(u)
    if operation == LOG1P:
        return np.log1p(u)
    if operation == EXPM1:
        return np.expm1(u)
    if operation == ERF:
        return math.erf(u)
    return np.power(u, constant)


@kernel
def values(tape, constants, v, k, states):
    """Coefficient k of every row after the `states`, whose own coefficients through k are known."""
    for row in range(states, tape.shape[0]):
        operation = tape[row, 0]
        a = tape[row, 1]
        b = tape[row, 2]
        if operation == MULTIPLY:
            total = 0.0
            if a == b:
                for j in range((k + 1) // 2):
                    total += v[a, j] * v[a, k - j]
                total *= 2.0
                if k % 2 == 0:
                    total += v[a, k // 2] * v[a, k // 2]
            else:
                for j in range(k + 1):
                    total += v[a, j] * v[b, k - j]
            v[row, k] = total
        elif operation == ADD:
            v[row, k] = v[a, k] + v[b, k]
        elif operation == SUBTRACT:
            v[row, k] = v[a, k] - v[b, k]
        elif operation == SCALE:
            v[row, k] = constants[tape[row, 3]] * v[a, k]
        elif operation == SHIFT:
            v[row, k] = v[a, k] + constants[tape[row, 3]] if k == 0 else v[a, k]
        elif operation == DIVIDE:
            total = v[a, k]
            for j in range(1, k + 1):
                total -= v[b, j] * v[row, k - j]
            v[row, k] = total / v[b, 0]
        elif operation == QUOTIENT:
            total = constants[tape[row, 3]] if k == 0 else 0.0
            for j in range(1, k + 1):
                total -= v[a, j] * v[row, k - j]
            v[row, k] = total / v[a, 0]
        elif operation == CONSTANT:
            v[row, k] = constants[tape[row, 3]] if k == 0 else 0.0
        elif operation == SIGN:
            v[row, k] = np.sign(v[a, 0]) if k == 0 else 0.0
        elif k == 0:
            v[row, 0] = _elementary(operation, v[a, 0], constants[tape[row, 3]])
        else:
            total = 0.0
            for j in range(1, k + 1):
                total += j * v[a, j] * v[b, k - j]
            v[row, k] = total / k


@kernel
def tangents(tape, constants, v, d, k, states):
    """Derivatives d[i, row, k] of the coefficients by the i-th fast start; `values` has been run through k."""
    for i in range(d.shape[0]):
        w = d[i]
        for row in range(states, tape.shape[0]):
            operation = tape[row, 0]
            a = tape[row, 1]
            b = tape[row, 2]
            if operation == MULTIPLY:
                total = 0.0
                other = 0.0
                if a == b:
                    for j in range(k + 1):
                        total += w[a, j] * v[a, k - j]
                    total *= 2.0
                else:
                    for j in range(k + 1):
                        total += w[a, j] * v[b, k - j]
                        other += v[a, j] * w[b, k - j]
                w[row, k] = total + other
            elif operation == ADD:
                w[row, k] = w[a, k] + w[b, k]
            elif operation == SUBTRACT:
                w[row, k] = w[a, k] - w[b, k]
            elif operation == SCALE:
                w[row, k] = constants[tape[row, 3]] * w[a, k]
            elif operation == SHIFT:
                w[row, k] = w[a, k]
            elif operation == DIVIDE:
                total = w[a, k] - w[b, 0] * v[row, k]
                for j in range(1, k + 1):
                    total -= w[b, j] * v[row, k - j] + v[b, j] * w[row, k - j]
                w[row, k] = total / v[b, 0]
            elif operation == QUOTIENT:
                total = -w[a, 0] * v[row, k]
                for j in range(1, k + 1):
                    total -= w[a, j] * v[row, k - j] + v[a, j] * w[row, k - j]
                w[row, k] = total / v[a, 0]
            elif operation in (CONSTANT, SIGN):
                w[row, k] = 0.0
            elif k == 0:
                w[row, 0] = v[b, 0] * w[a, 0]
            else:
                total = 0.0
                for j in range(1, k + 1):
                    total += j * (w[a, j] * v[b, k - j] + v[a, j] * w[b, k - j])
                w[row, k] = total / k


@kernel
def flow_jet_with_tangents(flow, x, y, order, v, d):
    """Fill rows 0..n-1 of `v` with the coefficients 0..order of the orbit through (x, y), in fast time.

    `flow` is (tape, constants, rates, epsilon, how many x). d[i] gets the derivatives of `v` by y_i; where `d` has no
    rows there are none.
    """
    tape, constants, rates, epsilon, slow = flow
    states = rates.shape[0]
    fast = d.shape[0]
    for i in range(slow):
        v[i, 0] = x[i]
    for i in range(slow, states):
        v[i, 0] = y[i - slow]
    for i in range(fast):
        for row in range(states):
            d[i, row, 0] = 1.0 if row == slow + i else 0.0
    for k in range(order):
        values(tape, constants, v, k, states)
        tangents(tape, constants, v, d, k, states)
        for row in range(states):
            factor = epsilon / (k + 1) if row < slow else 1.0 / (k + 1)
            v[row, k + 1] = factor * v[rates[row], k]
            for i in range(fast):
                d[i, row, k + 1] = factor * d[i, rates[row], k]
