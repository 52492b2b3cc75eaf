"""Other integrators that a Python user can install, each behind one shape: `build(problem)` -> `solve(rtol, times)`.

`solve` returns the states (n, m) at `times` (m,), ascending and ending at the problem's end, or raises when the
peer fails. All compiling is done in `build` or in a first call that is not timed. Right-hand sides and Jacobians are
compiled wherever a peer takes compiled ones; where one takes Python functions only, those call our machine code.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numba
import numpy as np
import sympy as sp

import gsp
from gsp.kernels.call import call
from gsp.lowering import compile_flow, parameter_vector

Solve = Callable[[float, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Problem:
    """An initial-value problem. `floor` is atol/rtol; `grid` (m,) ends with the span.

    Errors are relative to each component's largest value on the grid, or, when `pointwise`, to its value there.
    """

    name: str
    field: gsp.VectorField
    start: dict[str, float]
    span: tuple[float, float]
    epsilon: float | None = None
    floor: float = 1.0
    grid: np.ndarray | None = None
    pointwise: bool = False
    is_stiff: bool = True

    @property
    def times(self) -> np.ndarray:
        """The output grid: by default 100 equal intervals."""
        return np.linspace(*self.span, 101)[1:] if self.grid is None else self.grid

    @property
    def y0(self) -> np.ndarray:
        """The start in the order of the states."""
        return np.array([self.start[symbol.name] for symbol in self.field.states], dtype=float)

    @property
    def constants(self) -> dict[sp.Symbol, sp.Expr]:
        """Exact values of the parameters and of epsilon."""
        values = dict(self.field.parameters)
        if self.epsilon is not None:
            values[self.field.epsilon] = sp.Rational(str(self.epsilon))
        return values

    @property
    def rates(self) -> list[sp.Expr]:
        """Right-hand sides with all constants put in."""
        return [sp.sympify(rate).subs(self.constants) for rate in self.field.rates]


@dataclass(frozen=True)
class Peer:
    """One integrator of one package; `quick` when no Python runs in its loop."""

    name: str
    package: str
    build: Callable[[Problem], Solve]
    explicit: bool = False
    quick: bool = True

    @property
    def version(self) -> str | None:
        """The installed version, or `None` when the package cannot be imported."""
        try:
            importlib.import_module(self.package)
            return version({"sksundae": "scikit-sundae"}.get(self.package, self.package))
        except (ImportError, OSError, PackageNotFoundError):
            return None


@numba.njit(error_model="numpy")
def _evaluate(address, t, y, p, out):
    call(address, t, y, p, out)


def _python_functions(problem: Problem) -> tuple[Callable, Callable]:
    """f(t, y, out) and jacobian(t, y, out) over our machine code: 0.3 us a call above the arithmetic."""
    compiled, p = compile_flow(problem.field), parameter_vector(problem.field, problem.epsilon)
    field, jacobian = compiled.field, compiled.jacobian
    return (
        lambda t, y, out: _evaluate(field, t, y, p, out),
        lambda t, y, out: _evaluate(jacobian, t, y, p, out),
    )


def scipy_method(method: str) -> Callable[[Problem], Solve]:
    """SciPy's `solve_ivp` with the compiled right-hand side and Jacobian; dense output only when asked for more."""

    def build(problem: Problem) -> Solve:
        from scipy.integrate import solve_ivp

        f, df = _python_functions(problem)
        y0, n, (t0, t1) = problem.y0, len(problem.start), problem.span

        def rate(t, y):
            out = np.empty(n)
            f(t, np.ascontiguousarray(y), out)
            return out

        def jacobian(t, y):
            out = np.empty(n * n)
            df(t, np.ascontiguousarray(y), out)
            return out.reshape(n, n)

        def solve(rtol: float, times: np.ndarray) -> np.ndarray:
            result = solve_ivp(
                rate,
                (t0, t1),
                y0,
                method=method,
                jac=jacobian,
                rtol=rtol,
                atol=rtol * problem.floor,
                t_eval=times if len(times) > 1 else None,
            )
            if not result.success:
                raise ArithmeticError(result.message)
            return result.y[:, -len(times) :]

        return solve

    return build


def numbalsoda_lsoda(problem: Problem) -> Solve:
    """LSODA in C++ with a right-hand side in machine code; its Jacobian is by differences (it takes no other)."""
    import numbalsoda

    address = compile_flow(problem.field).field
    constants = parameter_vector(problem.field, problem.epsilon)
    n, length = len(problem.start), len(constants)

    @numba.cfunc(numbalsoda.lsoda_sig)
    def rate(t, u, du, p):
        call(address, t, numba.carray(u, n), numba.carray(p, length), numba.carray(du, n))

    pointer, lsoda, t0, y0 = rate.address, numbalsoda.lsoda, problem.span[0], problem.y0

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        # The cfunc must live as long as its address.
        assert rate is not None
        grid = np.concatenate([[t0], times])
        states, success = lsoda(
            pointer, y0, grid, data=constants, rtol=rtol, atol=rtol * problem.floor, mxstep=1_000_000
        )
        if not success:
            raise ArithmeticError("LSODA failed")
        return states[1:].T

    return solve


class _Products(sp.printing.str.StrPrinter):
    """Small integer powers as products, constants as decimals."""

    def _print_Pow(self, expr, rational=False):
        base, exponent = self._print(expr.base), expr.exp
        if exponent.is_Integer and 0 < abs(exponent) <= 8:
            product = "*".join([f"({base})"] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"(1.0/({product}))"
        return f"pow({base}, {self._print(exponent)})"

    def _print_Rational(self, expr):
        return repr(float(expr))

    def _print_Integer(self, expr):
        return f"{int(expr)}.0"

    def _print_Float(self, expr):
        return repr(float(expr))

    def _print_Mul(self, expr):
        return "*".join(f"({self._print(factor)})" for factor in expr.args)


def pydiffsol_method(method: str) -> Callable[[Problem], Solve]:
    """diffsol (Rust): the model in its language DiffSL, compiled by LLVM, exact Jacobian by differentiation."""

    def build(problem: Problem) -> Solve:
        import pydiffsol

        names = {symbol: sp.Symbol(f"s{i}") for i, symbol in enumerate(problem.field.states)}
        rates = [_Products().doprint(rate.subs(names)) for rate in problem.rates]
        start = [f"{name} = {value!r}" for name, value in zip(names.values(), map(float, problem.y0))]
        code = "u_i {\n" + ",\n".join(start) + "\n}\nF_i {\n" + ",\n".join(rates) + "\n}\n"
        ode = pydiffsol.Ode(
            code,
            matrix_type=pydiffsol.nalgebra_dense,
            linear_solver=pydiffsol.lu,
            ode_solver=getattr(pydiffsol, method),
        )
        empty = np.array([])

        def solve(rtol: float, times: np.ndarray) -> np.ndarray:
            ode.rtol, ode.atol = rtol, rtol * problem.floor
            return ode.solve_dense(empty, times).ys

        return solve

    return build


def sundae_cvode(problem: Problem) -> Solve:
    """SUNDIALS' CVODE with the BDF formulas through scikit-sundae; right-hand side and Jacobian are callbacks."""
    from sksundae.cvode import CVODE

    f, df = _python_functions(problem)
    n, t0, y0 = len(problem.start), problem.span[0], problem.y0
    flat = np.empty(n * n)

    def jacobian(t, y, yp, matrix):
        df(t, y, flat)
        matrix[:] = flat.reshape(n, n)

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        solver = CVODE(
            f, jacfn=jacobian, rtol=rtol, atol=rtol * problem.floor, method="BDF", max_num_steps=1_000_000
        )
        result = solver.solve(np.concatenate([[t0], times]), y0)
        if not result.success:
            raise ArithmeticError(result.message)
        return result.y[1:].T

    return solve


def casadi_cvodes(problem: Problem) -> Solve:
    """CasADi's interface to CVODES: expressions and exact Jacobian in its virtual machine."""
    import casadi

    x = casadi.SX.sym("x", len(problem.start))
    values = {symbol: x[i] for i, symbol in enumerate(problem.field.states)}
    functions = {"sin": casadi.sin, "cos": casadi.cos, "exp": casadi.exp}
    rates = casadi.vertcat(*[_convert(rate, values, functions) for rate in problem.rates])
    model, solvers, t0, y0 = {"x": x, "ode": rates}, {}, problem.span[0], problem.y0

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        key = rtol, len(times)
        if key not in solvers:
            options = {"reltol": rtol, "abstol": rtol * problem.floor, "max_num_steps": 1_000_000}
            solvers[key] = casadi.integrator("solver", "cvodes", model, t0, times.tolist(), options)
        return np.array(solvers[key](x0=y0)["xf"])

    return solve


def _convert(expression: sp.Expr, values: dict, functions: dict):
    if expression in values:
        return values[expression]
    if expression.is_number:
        return float(expression)
    parts = [_convert(argument, values, functions) for argument in expression.args]
    if expression.is_Add:
        return sum(parts[1:], parts[0])
    if expression.is_Mul:
        product = parts[0]
        for part in parts[1:]:
            product = product * part
        return product
    if expression.is_Pow:
        return parts[0] ** parts[1]
    return functions[expression.func.__name__](*parts)


def heyoka_taylor(problem: Problem) -> Solve:
    """Taylor series of an order that the tolerance sets, jitted; explicit."""
    import heyoka

    states = heyoka.make_vars(*[f"s{i}" for i in range(len(problem.start))])
    values = dict(zip(problem.field.states, states))
    functions = {"sin": heyoka.sin, "cos": heyoka.cos, "exp": heyoka.exp}
    system = [(state, _convert(rate, values, functions)) for state, rate in zip(states, problem.rates)]
    t0, t1 = problem.span
    y0, integrators = problem.y0, {}

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        if rtol not in integrators:
            integrators[rtol] = heyoka.taylor_adaptive(system, y0.tolist(), tol=rtol)
        one = integrators[rtol]
        one.time = t0
        one.state[:] = y0
        if len(times) == 1:
            outcome = one.propagate_until(t1, max_steps=20_000)[0]
            values = one.state.copy()[:, np.newaxis]
        else:
            outcome, *_, grid = one.propagate_grid(np.concatenate([[t0], times]), max_steps=20_000)
            values = grid[1:].T
        if outcome != heyoka.taylor_outcome.time_limit:
            raise ArithmeticError(f"heyoka stopped: {outcome}")
        return values

    return solve


def diffrax_kvaerno(problem: Problem) -> Solve:
    """Kvaerno's ESDIRK method of order 5 in JAX, jitted."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    functions = {"sin": jnp.sin, "cos": jnp.cos, "exp": jnp.exp}
    states, rates = problem.field.states, problem.rates
    (t0, t1), y0 = problem.span, jnp.array(problem.y0)

    def rate(t, y, _):
        values = {symbol: y[i] for i, symbol in enumerate(states)}
        return jnp.stack([jnp.asarray(_convert(r, values, functions), dtype=float) for r in rates])

    @jax.jit
    def run(rtol, times):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            diffrax.Kvaerno5(),
            t0=t0,
            t1=t1,
            dt0=None,
            y0=y0,
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol * problem.floor),
            max_steps=20_000,
        ).ys

    def solve(rtol: float, times: np.ndarray) -> np.ndarray:
        return np.asarray(run(rtol, times)).T

    return solve


PEERS = (
    Peer("numbalsoda LSODA", "numbalsoda", numbalsoda_lsoda),
    Peer("pydiffsol BDF", "pydiffsol", pydiffsol_method("bdf")),
    Peer("pydiffsol ESDIRK34", "pydiffsol", pydiffsol_method("esdirk34")),
    Peer("pydiffsol TR-BDF2", "pydiffsol", pydiffsol_method("tr_bdf2")),
    Peer("casadi CVODES", "casadi", casadi_cvodes),
    Peer("sundae CVODE", "sksundae", sundae_cvode, quick=False),
    Peer("heyoka Taylor", "heyoka", heyoka_taylor, explicit=True),
    Peer("diffrax Kvaerno5", "diffrax", diffrax_kvaerno, quick=False),
    Peer("SciPy LSODA", "scipy", scipy_method("LSODA"), quick=False),
    Peer("SciPy BDF", "scipy", scipy_method("BDF"), quick=False),
    Peer("SciPy Radau", "scipy", scipy_method("Radau"), quick=False),
)
