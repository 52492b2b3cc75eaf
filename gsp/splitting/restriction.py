"""The flow on a critical manifold to leading order, as a field with a second small parameter."""

from __future__ import annotations

import sympy as sp

from gsp.algebra.inversion import solve_for
from gsp.algebra.laurent import laurent, pole_order
from gsp.errors import DeclarationError, DegenerateError, SplittingError
from gsp.systems.arguments import check_text
from gsp.systems.system import SlowFastSystem, VectorField


def restricted(system: SlowFastSystem, second: str | sp.Symbol) -> VectorField:
    """x' = f(x, h_0(x), 0) on {g(x, y, 0) = 0}, with `second` for its small parameter.

    Raises `DegenerateError` where leading terms cancel, so that a time scale is hidden.
    """
    epsilon = system.epsilon
    name = check_text(getattr(second, "name", second), what="second")
    small = next((p for p in system.parameters if p.name == name), None)
    if small is None:
        raise DeclarationError.none_of(
            system.parameters, name, f"second is {name}, and no parameter has this name.", "They are"
        )
    # Equations by the values that they take.
    zeros = {sp.Dummy(): laurent(g, epsilon, order=0).get(0, sp.S.Zero) for g in system.g}
    solved = solve_for(system.y, zeros)
    if solved is None:
        raise SplittingError(
            f"the critical manifold of {epsilon} has no formula, so that the flow on it is not split in {name}.",
            f'Take nest(scene, small=["{epsilon}", "{name}"]), which follows it by numbers.',
        )
    on = {y: e.xreplace(dict.fromkeys(zeros, sp.S.Zero)) for y, e in solved.items()}
    rates = {x: laurent(f, epsilon, order=0).get(0, sp.S.Zero).xreplace(on) for x, f in system.slow.items()}
    for x, rate in rates.items():
        if pole_order(rate, small) < pole_order(system.slow[x], small):
            raise DegenerateError(
                f"a time scale is hidden: on the critical manifold of {epsilon} the leading terms of the rate of {x} "
                f"in 1/{name} cancel. What moves there depends on {epsilon}/{name}.",
                f"Say how the two are related: put {epsilon} = a*{name}^2 or so into the equations, and take {name} "
                "alone.",
            )
    if not any(rate.has(small) for rate in rates.values()):
        raise SplittingError(
            f"no rate on the critical manifold of {epsilon} carries {name}.",
            f"Where {name} belongs to the faster scale, declare the field with epsilon={name}.",
        )
    return VectorField(
        rates,
        epsilon=small,
        parameters={p: value for p, value in system.parameters.items() if p != small},
        name=system.name,
    )
