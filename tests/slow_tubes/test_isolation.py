"""Residuals over boxes: the smaller of two enclosures, both of which hold what the residual is."""

from types import SimpleNamespace

import pytest

from gsp.slow_tubes.isolation import Isolation


@pytest.mark.parametrize(
    ("box", "width"), [(((0.375, 0.625),), 0.0625), (((0.0, 1.0),), 1.0), (((0.5, 0.5),), 1e-14)]
)
def test_a_residual_is_enclosed_by_its_mean_value_form_where_that_is_smaller(box, width: float) -> None:
    # rho = x (1 - x), from 1/4 down to 1/4 - h^2 at 1/2 +- h; the mean-value form has a width of 4 h^2.
    tests = Isolation.__new__(Isolation)
    tests.invariance = SimpleNamespace(
        residual=lambda x: [x[0] * (1 - x[0])], residual_slopes=lambda x: [1 - 2 * x[0]]
    )
    tests._slopes, tests._residuals = {}, {}
    (found,) = tests._residual(box)
    ((low, _),) = box
    assert found.contains(0.25)
    assert found.contains(low * (1 - low))
    assert 2 * float(found.rad()) <= width * (1 + 1e-6)
