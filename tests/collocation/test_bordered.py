"""The bordered system of Gauss collocation: what every orbit of it satisfies, whatever its conditions."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.collocation.bordered import Conditions, FlowEquations, linearise
from gsp.collocation.gauss import gauss
from gsp.errors import Status
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.compiled_function import compile_function
from gsp.systems.system import VectorField
from gsp.tracing.newton import Rules, newton

x, y, k = sp.symbols("x y k")
# A saddle: one direction grows by e^20 over the orbit, the other decays by as much.
saddle = VectorField({x: 20 * x + k * y**2, y: -20 * y + k * x**2}, epsilon=None, parameters={k: 0.5})


def equations(free: int) -> tuple[FlowEquations, np.ndarray, object]:
    flow = compile_flow(saddle)
    sensitivity = compile_function([y**2, x**2], arguments=(x, y), epsilon=None, parameters=(k,))
    return (
        FlowEquations(flow.field, flow.jacobian, sensitivity.address, free),
        parameter_vector(saddle, None),
        sensitivity,
    )


@pytest.mark.parametrize("free", [0, 1, 2])
@pytest.mark.parametrize("scaled", [False, True])
def test_a_step_solves_the_whole_linear_system(free: int, scaled: bool) -> None:
    """Against the system written out, stages and all, with weights on inner points and on stages."""
    rng = np.random.default_rng(7)
    scheme, N, n = gauss(3), 5, 2
    s, rows = scheme.degree, n + free
    own, p, _keep = equations(free)
    widths, time = rng.uniform(0.1, 0.3, N), 0.7
    states, stages = rng.normal(size=(N + 1, n)), rng.normal(size=(N, s, n))
    conditions = Conditions(
        rng.normal(size=(rows, n)), rng.normal(size=(rows, n)), rng.normal(size=(rows, free)), rng.normal(size=rows),
        **({"inner": rng.normal(size=(2, N + 1, n))} if scaled else {"inside": rng.normal(size=(2, N, s, n))}),
    )  # fmt: skip
    tangents = rng.normal(size=(rows, 2))
    linear = linearise(own, scheme, p, time, widths, states, stages)
    steps = linear.solve(conditions, tangents=tangents, units=np.arange(1.0, rows + 1) if scaled else None)

    flow = compile_flow(saddle)
    F = flow.rates(stages.reshape(-1, n), p).reshape(stages.shape)
    J = flow.jacobians(stages.reshape(-1, n), p).reshape(N, s, n, n)
    by = np.stack([stages[:, :, 1] ** 2, stages[:, :, 0] ** 2], axis=2)
    for case, step in enumerate(steps):
        share = 1.0 if case == 0 else 0.0
        dq = np.append(step.parameters, np.zeros(2 - free))
        for e in range(N):
            h = time * widths[e]
            rate = (
                np.einsum("kij,kj->ki", J[e], step.stages[e]) * h + widths[e] * F[e] * dq[0] + h * by[e] * dq[1]
            )
            defects = states[e] + h * scheme.A @ F[e] - stages[e]
            np.testing.assert_allclose(
                step.stages[e] - step.states[e] - scheme.A @ rate, share * defects, rtol=0, atol=1e-9
            )
            jump = states[e] + h * scheme.b @ F[e] - states[e + 1]
            np.testing.assert_allclose(
                step.states[e + 1] - step.states[e] - scheme.b @ rate, share * jump, rtol=0, atol=1e-9
            )
        met = conditions.left @ step.states[0] + conditions.right @ step.states[-1]
        met = met + conditions.across @ step.parameters
        if conditions.inner is not None:
            met[-2:] += np.einsum("cei,ei->c", conditions.inner, step.states)
        if conditions.inside is not None:
            met[-2:] += np.einsum("ceji,eji->c", conditions.inside, step.stages)
        np.testing.assert_allclose(
            met, conditions.target if case == 0 else tangents[:, case - 1], rtol=0, atol=1e-9
        )


def test_growth_and_decay_are_carried_the_way_they_are_stable() -> None:
    """x is fixed where the orbit ends and y where it begins: the errors of both stay at rounding over e^20."""
    scheme, N = gauss(4), 40
    own, p, _keep = equations(0)
    states, stages = np.zeros((N + 1, 2)), np.zeros((N, scheme.degree, 2))
    conditions = Conditions(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 0.0]]), np.zeros((2, 0)), np.ones(2)
    )
    step = linearise(own, scheme, p, 1.0, np.full(N, 1.0 / N), states, stages).solve(conditions)[0]
    t = np.linspace(0.0, 1.0, N + 1)
    np.testing.assert_allclose(step.states[:, 1], np.exp(-20 * t), rtol=1e-8)
    np.testing.assert_allclose(step.states[:, 0], np.exp(-20 * (1 - t)), rtol=1e-8)


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_an_orbit_between_two_conditions_is_of_order_twice_its_stages(degree: int) -> None:
    pendulum = VectorField({x: y, y: -sp.sin(x)}, epsilon=None)
    flow, p, scheme = compile_flow(pendulum), parameter_vector(pendulum, None), gauss(degree)
    own, ends = FlowEquations(flow.field, flow.jacobian, 0, 0), []
    for N in (4, 8, 64):
        mesh = np.linspace(0.0, 1.0, N + 1)
        places = scheme.places(mesh)

        def step_of(point, N=N):
            z, Z = point
            left, right = np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 0.0]])
            target = np.array([1.0 - z[0, 0], -z[-1, 0]])
            linear = linearise(own, scheme, p, 1.0, np.full(N, 1.0 / N), z, Z)
            return linear.solve(Conditions(left, right, np.zeros((2, 0)), target))[0]

        line = np.stack([1.0 - places, -np.ones_like(places)], axis=2)
        start = np.stack([1.0 - mesh, -np.ones_like(mesh)], axis=1), line[:, 1:]
        found = newton(
            start, step_of, length=lambda step, _: float(np.abs(step.states).max()),
            moved=lambda point, step, share: (point[0] + share * step.states, point[1] + share * step.stages),
            rules=Rules(20, 1e-13, 1e-8),
        )  # fmt: skip
        assert found.status is Status.SUCCESS
        ends.append(found.point[0][0, 1])
    error = np.abs(np.array(ends[:2]) - ends[2])
    assert np.log2(error[0] / error[1]) == pytest.approx(2 * degree, abs=0.35)


def test_a_singular_system_is_an_error_and_newtons_method_says_so() -> None:
    own, p, _keep = equations(0)
    nothing = Conditions(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 0)), np.ones(2))
    scheme = gauss(2)

    def step_of(z):
        return linearise(own, scheme, p, 1.0, np.full(3, 1 / 3), z, np.zeros((3, 2, 2))).solve(nothing)[0]

    with pytest.raises(np.linalg.LinAlgError):
        step_of(np.zeros((4, 2)))
    found = newton(
        np.zeros((4, 2)), step_of, length=lambda *_: 0.0, moved=lambda z, *_: z, rules=Rules(5, 1e-12)
    )  # fmt: skip
    assert found.status is Status.SINGULAR_JACOBIAN
    assert found.iterations == 1


@pytest.mark.parametrize(
    ("sizes", "status", "steps"),
    [
        ([1.0, 1e-3, 1e-9, 1e-17], Status.SUCCESS, 4),
        ([1.0, 1e-3, 5e-4, 4e-4, 3e-4], Status.NOT_CONVERGED, 5),
        ([1.0, 1e-9, 8e-10], Status.SUCCESS, 3),
        ([1.0, 10.0], Status.NOT_CONVERGED, 2),
        ([1.0, float("nan")], Status.NON_FINITE, 2),
    ],
)
def test_newtons_method_ends_by_its_rules(sizes: list[float], status: Status, steps: int) -> None:
    given = iter(sizes)
    found = newton(
        0.0, lambda _: next(given), length=lambda step, _: step, moved=lambda at, step, share: at + share * step,
        rules=Rules(5, 1e-13, 1e-8, growth=4.0, hopeless=2.0),
    )  # fmt: skip
    assert (found.status, found.iterations) == (status, steps)
