"""Sine, cosine and the exponential written in place: within four units in the last place, the library's beyond."""

from __future__ import annotations

import ctypes
import math
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from llvmlite import ir

from gsp.kernels.engine import build
from gsp.lowering.steps import elementary
from gsp.lowering.steps.emission import LIBRARY, Emitter
from gsp.lowering.steps.values import DOUBLE, SIGNATURE, lane, load, store

POINTER = ctypes.POINTER(ctypes.c_double)
FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)
LANES = 4
UNITS = 4
x = sp.Symbol("x")


@pytest.fixture(scope="module")
def code():
    """By width, 0 for one number: (sin, cos, exp) of that many numbers in z."""
    module = ir.Module()
    for width in (0, LANES):
        function = ir.Function(module, SIGNATURE, f"f{width}")
        builder = ir.IRBuilder(function.append_basic_block())
        _, z, _, out = function.args
        value = load(builder, z, 0)
        if width:
            value = ir.Constant(ir.VectorType(DOUBLE, width), ir.Undefined)
            for k in range(width):
                value = builder.insert_element(value, load(builder, z, k), lane(k))
        written = Emitter(builder, {x: value}, constants={}, width=width).write(
            [sp.sin(x), sp.cos(x), sp.exp(x)]
        )
        for i, result in enumerate(written):
            for k in range(max(width, 1)):
                one = builder.extract_element(result, lane(k)) if width else result
                store(builder, one, out, i * max(width, 1) + k)
        builder.ret_void()
    engine = build(str(module), library=LIBRARY)

    def run(values) -> np.ndarray:
        z = np.array(values, dtype=float)
        out = np.empty((3, z.size))
        address = engine.get_function_address(f"f{0 if z.size == 1 else LANES}")
        FUNCTION(address)(
            0.0, z.ctypes.data_as(POINTER), z.ctypes.data_as(POINTER), out.ctypes.data_as(POINTER)
        )
        return out

    return run


def units(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.max(np.abs(found - exact) / np.spacing(np.abs(exact) + np.finfo(float).tiny)))


@pytest.mark.exhaustive
@given(st.floats(-elementary.LARGEST_ANGLE, elementary.LARGEST_ANGLE))
@settings(max_examples=500)
def test_angles(code, angle):
    sine, cosine, _ = code([angle])[:, 0]
    assert units(sine, math.sin(angle)) <= UNITS
    assert units(cosine, math.cos(angle)) <= UNITS


@pytest.mark.exhaustive
@given(st.floats(-elementary.LARGEST_EXPONENT, elementary.LARGEST_EXPONENT))
@settings(max_examples=500)
def test_exponents(code, exponent):
    assert units(code([exponent])[2, 0], math.exp(exponent)) <= UNITS


def test_angles_beside_quarter_turns_keep_their_digits(code):
    """Where the sine or the cosine nearly vanishes all parts of pi are needed."""
    angles = [float(sp.N(sp.pi * k / 2, 30)) for k in (*range(-9, 10), 355, 103993, 636618)]
    for angle in angles:
        exact = [float(sp.N(f(sp.Rational(angle)), 30)) for f in (sp.sin, sp.cos)]
        assert units(code([angle])[:2, 0], np.array(exact)) <= UNITS


@pytest.mark.parametrize(
    "odd", [1e7, -1e22, 705.0, 800.0, -740.0, -1e4, float("inf"), float("-inf"), float("nan"), 5e-324, -0.0]
)
def test_what_is_beyond_the_reduction_comes_from_the_library_in_every_lane(code, odd):
    values = [0.25, odd, -3.0, 1.0]
    with np.errstate(invalid="ignore", over="ignore"):
        exact = np.array([np.sin(values), np.cos(values), np.exp(values)])
    found = code(values)
    np.testing.assert_allclose(found, exact, rtol=5e-16, atol=0)
    np.testing.assert_allclose(code([odd])[:, 0], exact[:, 1], rtol=5e-16, atol=0)


def test_lanes_and_single_numbers_give_the_same_bits(code):
    values = np.random.default_rng(5).normal(size=(50, LANES)) * 30
    for row in values:
        together = code(row)
        alone = np.array([code([value])[:, 0] for value in row]).T
        assert np.array_equal(together, alone)


@pytest.mark.parametrize(
    ("value", "parts", "bits"),
    [(elementary._HALF_PI, elementary._QUARTER_TURN, 33), (elementary._LOG_2, elementary._DOUBLING, 42)],
)
def test_parts_of_a_constant_have_exact_multiples_and_nothing_is_lost_between_them(value, parts, bits) -> None:
    left = value
    for part in parts[:-1]:
        for multiple in (2 ** (53 - bits) - 1, 3 * 2 ** (51 - bits) + 1):
            assert Fraction(multiple * part) == multiple * Fraction(part)
        # As many bits as there may be.
        assert 0 <= left - Fraction(part) < left / 2 ** (bits - 1)
        left -= Fraction(part)
    assert parts[-1] == float(left)
