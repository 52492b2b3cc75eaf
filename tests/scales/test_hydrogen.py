"""Hydrogen and oxygen with published rates: modes along a run against eigenvectors in 30 digits.

Rates of a skeletal mechanism (ISRN 2012, 475607, table 1, without H2O2), in mol, cm, s, K and kcal/mol, at constant
temperature and volume. The computation that it is compared with shares nothing but the states along the run: rates,
Jacobian, eigenvalues and both sets of eigenvectors are those of mpmath.
"""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
import pytest
import sympy as sp

import gsp

DIGITS = 30
TEMPERATURE, TOTAL = 1500, "8.124e-6"
SPECIES = ("H2", "O2", "H2O", "H", "O", "OH", "HO2")
# Reactants, products, A, n and E; "M" is any partner.
STEPS = (
    ("H O2", "OH O", "1.91e14", "0", "16.44"),
    ("H2 O", "OH H", "5.08e4", "2.67", "6.292"),
    ("H2 OH", "H2O H", "2.16e8", "1.51", "3.43"),
    ("H2 M", "H H M", "4.57e19", "-1.4", "105.1"),
    ("O O M", "O2 M", "6.17e15", "-0.5", "0"),
    ("H O M", "OH M", "4.72e18", "-1", "0"),
    ("H OH M", "H2O M", "4.5e22", "-2", "0"),
    ("H O2 M", "HO2 M", "6.17e19", "-1.42", "0"),
    ("H HO2", "H2 O2", "1.66e13", "0", "0.82"),
    ("H2 O2", "H HO2", "3.68e13", "0.203", "54.46"),
    ("H HO2", "OH OH", "1.69e14", "0", "0.87"),
    ("OH HO2", "H2O O2", "2.89e13", "0", "-0.5"),
)
START = {"H2": 0.28, "O2": 0.14, "H2O": 0, "H": 1e-6, "O": 0, "OH": 0, "HO2": 0}


@cache
def constants() -> tuple[sp.Rational, ...]:
    """In units of the total concentration, exact numbers of 30 digits, so that both sides have the same."""
    with mpmath.workdps(DIGITS):
        found = []
        for reactants, _, A, n, E in STEPS:
            k = mpmath.mpf(A) * mpmath.mpf(TEMPERATURE) ** mpmath.mpf(n)
            k *= mpmath.exp(-mpmath.mpf(E) / (mpmath.mpf("1.987204e-3") * TEMPERATURE))
            found.append(
                sp.Rational(mpmath.nstr(k * mpmath.mpf(TOTAL) ** (len(reactants.split()) - 1), DIGITS))
            )
    return tuple(found)


@cache
def scales() -> gsp.TimeScales:
    z = {name: sp.Symbol(name) for name in SPECIES}
    rates = dict.fromkeys(SPECIES, sp.Integer(0))
    for (reactants, products, *_), k in zip(STEPS, constants()):
        step = k * sp.Mul(*(z[name] for name in reactants.split() if name != "M"))
        for name in reactants.split():
            rates[name] = rates.get(name, 0) - step
        for name in products.split():
            rates[name] = rates.get(name, 0) + step
    field = gsp.VectorField({z[name]: rates[name] for name in SPECIES})
    return gsp.time_scales(field, start=START, span=(0, 1e-3))


def in_many_digits(place: np.ndarray) -> tuple[list, list, mpmath.matrix, list]:
    """(rates, pointers by mode, field, a_r (b^r . F) by mode) at a place, fastest first."""
    x = [mpmath.mpf(float(value)) for value in place]
    at = {name: i for i, name in enumerate(SPECIES)}
    n = len(SPECIES)
    J, F = mpmath.zeros(n, n), mpmath.zeros(n, 1)
    for (reactants, products, *_), k in zip(STEPS, constants()):
        k = mpmath.mpf(k.p) / k.q
        left = [at[name] for name in reactants.split() if name != "M"]
        change = [(i, -1) for i in left] + [(at[name], 1) for name in products.split() if name != "M"]
        for i, sign in change:
            F[i] += sign * k * mpmath.fprod(x[j] for j in left)
            for place_of, j in enumerate(left):
                others = (x[m] for q, m in enumerate(left) if q != place_of)
                J[i, j] += sign * k * mpmath.fprod(others)
    values, right = mpmath.eig(J)
    left_rows = right**-1
    order = sorted(range(n), key=lambda r: -abs(values[r]))
    pointers = [[right[i, r] * left_rows[r, i] for i in range(n)] for r in order]
    amplitudes = [mpmath.fsum(left_rows[r, i] * F[i] for i in range(n)) for r in order]
    moved = [[right[i, r] * amplitudes[k] for i in range(n)] for k, r in enumerate(order)]
    return [values[r] for r in order], pointers, F, moved


@pytest.mark.exhaustive
@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.7, 0.95])
def test_rates_and_pointers_are_those_of_an_eigenproblem_in_thirty_digits(share: float) -> None:
    found = scales()
    i = int(share * (len(found.t) - 1))
    with mpmath.workdps(2 * DIGITS):
        rates, pointers, _, _ = in_many_digits(found.states[i])
        expected = np.array([complex(rate) for rate in rates])
        shares = np.array([[complex(entry) for entry in row] for row in pointers])
    # Hydrogen and oxygen are conserved; the others move.
    moving = len(SPECIES) - len(found.conserved)
    assert len(found.conserved) == 2
    np.testing.assert_array_less(np.abs(expected[moving:]), 1e-20 * abs(expected[0]))
    # Rounding of the largest rate turns a mode by its share of how far the rate is from the others.
    rounding = 100 * np.finfo(float).eps * abs(expected[0])
    for part in (np.real, lambda rates: np.abs(np.imag(rates))):
        np.testing.assert_allclose(
            part(found.rates[i, :moving]), part(expected[:moving]), rtol=0, atol=rounding
        )
    groups = found.groups[i]
    assert len(set(groups[:moving])) >= moving - 1
    for group in set(groups[:moving]):
        inside = groups == group
        apart = np.abs(expected[inside][:, None] - expected[~inside]).min()
        # Within a group the sum means something.
        np.testing.assert_allclose(
            found.pointers[i, inside].sum(axis=0),
            shares[inside].sum(axis=0).real,
            rtol=0,
            atol=rounding / apart,
        )


@pytest.mark.exhaustive
def test_exhausted_modes_are_those_of_the_criterion_in_thirty_digits() -> None:
    found, rtol = scales(), 0.1
    tolerance = rtol * np.abs(found.states) + rtol**2 * np.abs(found.states).max(axis=0)
    seen = set()
    for i in range(0, len(found.t), 20):
        with mpmath.workdps(2 * DIGITS):
            rates, _, _, moved = in_many_digits(found.states[i])
            best = 0
            for m in range(1, len(SPECIES) - len(found.conserved)):
                if mpmath.re(rates[m - 1]) >= 0:
                    break
                if abs(mpmath.im(rates[m - 1])) > 0 and abs(mpmath.im(rates[m - 1] + rates[m])) == 0:
                    continue
                sums = [abs(mpmath.re(mpmath.fsum(row[s] for row in moved[:m]))) for s in range(len(SPECIES))]
                if all(total < limit * abs(rates[m]) for total, limit in zip(sums, tolerance[i])):
                    best = m
        assert found.exhausted[i] == best
        seen.add(best)
    assert len(seen) > 2
