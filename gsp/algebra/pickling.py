"""Exact numbers and polynomials on their way to another process: python-flint's own cannot be pickled or deeply copied.

Imported for what it does: it tells `copyreg`, which `pickle` and `copy` ask. What arrives is exactly what was sent.
"""

from __future__ import annotations

import copyreg

import flint


def _ball(value: flint.arb) -> tuple:
    middle, radius = value.mid(), value.rad()
    return _ball_of, tuple(_number(part) for part in (middle, radius))


def _number(end: flint.arb) -> tuple[int, int] | str:
    """An exact ball as (mantissa, exponent), or in words."""
    if not end.is_finite():
        return "nan" if end.is_nan() else "inf" if end > 0 else "-inf"
    mantissa, exponent = end.man_exp()
    return int(mantissa), int(exponent)


def _ball_of(middle: tuple[int, int] | str, radius: tuple[int, int] | str) -> flint.arb:
    return flint.arb(middle, radius)


def _univariate(value: flint.fmpq_poly) -> tuple:
    return flint.fmpq_poly, (value.coeffs(),)


def _polynomials(context: flint.fmpq_mpoly_ctx) -> tuple:
    return flint.fmpq_mpoly_ctx.get, (context.names(), context.ordering())


def _polynomial(value: flint.fmpq_mpoly) -> tuple:
    terms = [(exponents, int(c.p), int(c.q)) for exponents, c in value.to_dict().items()]
    return _polynomial_of, (value.context(), terms)


def _polynomial_of(context: flint.fmpq_mpoly_ctx, terms: list[tuple]) -> flint.fmpq_mpoly:
    return context.from_dict({exponents: flint.fmpq(p, q) for exponents, p, q in terms})


copyreg.pickle(flint.fmpq_mpoly_ctx, _polynomials)
copyreg.pickle(flint.fmpq_mpoly, _polynomial)
copyreg.pickle(flint.arb, _ball)
copyreg.pickle(flint.fmpq_poly, _univariate)
