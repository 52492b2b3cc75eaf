"""Further peers for the benchmarks: CasADi, heyoka and diffrax, which take a graph of the field, and scikit-sundae."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from operator import ge, gt, le, lt
from typing import Any

import numpy as np
import sympy as sp
from choosing import ChoosingLanguage, translate
from compiled_peers import MAX_STEPS, DiffsolPeer, NumbalsodaPeer
from forward import Forward

from gsp.comparison.peers import PEERS as OWN
from gsp.comparison.peers import Peer, PeerRun, Solve
from gsp.kernels.evaluate import evaluate
from gsp.systems.flow import Flow

# Steps of the explicit and of the slow one: more only delay the news that they fail.
_FEW_STEPS = 20_000
_NAMES = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "erf", "atan2"),
)


def _named(module: Any, *names: str) -> dict[Any, Any]:
    return {getattr(sp, name): getattr(module, name) for name in names}


@dataclass(frozen=True)
class CasadiPeer(Peer):
    """CasADi's interface to CVODES: expressions and exact Jacobian in its virtual machine."""

    name = "casadi CVODES"
    package = "casadi"

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        import casadi

        language = ChoosingLanguage(
            name="casadi",
            number=casadi.SX,
            power=casadi.power,
            root=casadi.sqrt,
            functions={
                **_named(casadi, *_NAMES),
                sp.Abs: casadi.fabs,
                sp.Max: casadi.fmax,
                sp.Min: casadi.fmin,
            },
            choose=casadi.if_else,
            relations={sp.Lt: lt, sp.Le: le, sp.Gt: gt, sp.Ge: ge, sp.Eq: casadi.eq, sp.Ne: casadi.ne},
            joins={sp.And: casadi.logic_and, sp.Or: casadi.logic_or},
        )
        problem = Forward(flow, p, start, first, grid)
        z = casadi.SX.sym("z", len(flow.states))
        states = {symbol: z[i] for i, symbol in enumerate(flow.states)}
        rates = translate(problem.rates, states=states, language=language)
        model, times = {"x": z, "ode": casadi.vertcat(*rates)}, problem.times.tolist()
        begin, solvers = np.array(start, dtype=float), {}

        def solve(rtol: float, atol: float) -> PeerRun:
            if (rtol, atol) not in solvers:
                options = {
                    "reltol": rtol,
                    "abstol": atol,
                    "max_num_steps": MAX_STEPS,
                    "disable_internal_warnings": True,
                    "show_eval_warnings": False,
                }
                solvers[rtol, atol] = casadi.integrator("solver", "cvodes", model, 0.0, times, options)
            return PeerRun(np.array(solvers[rtol, atol](x0=begin)["xf"]))

        return solve


@dataclass(frozen=True)
class HeyokaPeer(Peer):
    """Taylor series of an order that the tolerance sets, jitted; explicit."""

    name = "heyoka Taylor"
    package = "heyoka"
    is_explicit = True

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        import heyoka

        choose = heyoka.select
        language = ChoosingLanguage(
            name="heyoka",
            number=heyoka.expression,
            power=lambda x, k: x**k,
            root=heyoka.sqrt,
            functions={
                **_named(heyoka, *_NAMES),
                sp.Abs: lambda x: choose(heyoka.lt(x, heyoka.expression(0.0)), -x, x),
                sp.Max: lambda a, b: choose(heyoka.gt(a, b), a, b),
                sp.Min: lambda a, b: choose(heyoka.lt(a, b), a, b),
            },
            choose=choose,
            relations={
                **{sp.Lt: heyoka.lt, sp.Le: heyoka.lte, sp.Gt: heyoka.gt, sp.Ge: heyoka.gte},
                **{sp.Eq: heyoka.eq, sp.Ne: heyoka.neq},
            },
            joins={
                sp.And: lambda a, b: heyoka.logical_and([a, b]),
                sp.Or: lambda a, b: heyoka.logical_or([a, b]),
            },
        )
        problem = Forward(flow, p, start, first, grid)
        variables = [heyoka.make_vars(f"s{i}") for i in range(len(flow.states))]
        states = dict(zip(flow.states, variables))
        rates = translate(problem.rates, states=states, language=language)
        system = list(zip(variables, rates))
        begin, times = np.array(start, dtype=float), problem.times_from_start
        integrators: dict[float, Any] = {}

        def solve(rtol: float, atol: float) -> PeerRun:
            # Its one tolerance is both relative and absolute.
            if rtol not in integrators:
                integrators[rtol] = heyoka.taylor_adaptive(system, begin.tolist(), tol=rtol)
            taylor = integrators[rtol]
            taylor.time = 0.0
            taylor.state[:] = begin
            if times.size == 2:
                outcome, _, _, steps, *_ = taylor.propagate_until(times[-1], max_steps=_FEW_STEPS)
                values = taylor.state.copy()[:, np.newaxis]
            else:
                outcome, _, _, steps, *_, rows = taylor.propagate_grid(times, max_steps=_FEW_STEPS)
                values = rows[1:].T
            if outcome != heyoka.taylor_outcome.time_limit:
                raise ArithmeticError(f"stopped with {outcome} after {steps} steps")
            return PeerRun(values, int(steps))

        return solve


@dataclass(frozen=True)
class DiffraxPeer(Peer):
    """Kvaerno's ESDIRK method of order 5 in JAX, compiled by XLA."""

    name = "diffrax Kvaerno5"
    package = "diffrax"

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        import diffrax
        import jax
        import jax.numpy as jnp

        # Double precision here alone: what else uses JAX keeps its own. Older JAX has it elsewhere.
        double: Any = jax.enable_x64 if hasattr(jax, "enable_x64") else jax.experimental.enable_x64
        plain = [name for name in _NAMES if name not in ("erf", "atan2")]
        language = ChoosingLanguage(
            name="jax",
            number=partial(jnp.asarray, dtype=float),
            power=jnp.power,
            root=jnp.sqrt,
            functions={
                **_named(jnp, *plain),
                sp.erf: jax.scipy.special.erf,
                sp.atan2: jnp.arctan2,
                sp.Abs: jnp.abs,
                sp.Max: jnp.maximum,
                sp.Min: jnp.minimum,
            },
            choose=jnp.where,
            relations={sp.Lt: lt, sp.Le: le, sp.Gt: gt, sp.Ge: ge, sp.Eq: jnp.equal, sp.Ne: jnp.not_equal},
            joins={sp.And: jnp.logical_and, sp.Or: jnp.logical_or},
        )
        problem = Forward(flow, p, start, first, grid)
        with double(True):
            begin, times = jnp.array(start, dtype=float), jnp.array(problem.times)

        def rate(t: Any, z: Any, _: Any) -> Any:
            states = {symbol: z[i] for i, symbol in enumerate(flow.states)}
            return jnp.stack(translate(problem.rates, states=states, language=language))

        def run(rtol: Any, atol: Any) -> Any:
            found = diffrax.diffeqsolve(
                diffrax.ODETerm(rate),
                diffrax.Kvaerno5(),
                t0=0.0,
                t1=times[-1],
                dt0=None,
                y0=begin,
                saveat=diffrax.SaveAt(ts=times),
                stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
                max_steps=_FEW_STEPS,
                throw=False,
            )
            return found.ys, found.result == diffrax.RESULTS.successful, found.stats["num_steps"]

        with double(True):
            compiled = jax.jit(run).lower(1e-3, 1e-3).compile()

        def solve(rtol: float, atol: float) -> PeerRun:
            with double(True):
                values, is_done, steps = compiled(rtol, atol)
            if not bool(is_done):
                raise ArithmeticError(f"Kvaerno5 stopped after {int(steps)} steps")
            return PeerRun(np.asarray(values).T, int(steps))

        return solve


@dataclass(frozen=True)
class SundaePeer(Peer):
    """CVODE with the BDF formulas, compiled field and Jacobian behind the callbacks."""

    name = "sundae CVODE"
    package = "scikit-sundae"
    is_compiled = False

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        from sksundae.cvode import CVODE

        problem = Forward(flow, p, start, first, grid)
        field, jacobian = problem.field.address, problem.jacobian.address
        states, times, n = np.array(start, dtype=float), problem.times_from_start, len(flow.states)
        flat = np.empty(n * n)

        def rates(t: float, z: np.ndarray, out: np.ndarray) -> None:
            evaluate(field, t, z, p, out)

        def derivatives(t: float, z: np.ndarray, _: np.ndarray, matrix: np.ndarray) -> None:
            evaluate(jacobian, t, z, p, flat)
            matrix[:] = flat.reshape(n, n)

        def solve(rtol: float, atol: float) -> PeerRun:
            # The problem keeps the machine code alive.
            assert problem is not None
            solver = CVODE(
                rates, jacfn=derivatives, rtol=rtol, atol=atol, method="BDF", max_num_steps=MAX_STEPS
            )
            found = solver.solve(times, states)
            if not found.success:
                raise ArithmeticError(found.message)
            # Asked for a start and an end it returns every step.
            return PeerRun(found.y[1 - times.size :].T, None, int(found.nfev))

        return solve


PEERS: tuple[Peer, ...] = (
    *OWN,
    NumbalsodaPeer(),
    DiffsolPeer("BDF", "bdf"),
    DiffsolPeer("ESDIRK34", "esdirk34"),
    DiffsolPeer("TR-BDF2", "tr_bdf2"),
    CasadiPeer(),
    SundaePeer(),
    HeyokaPeer(),
    DiffraxPeer(),
)
"""All that there are adapters for, installed or not: the package's own, the compiled ones and those of this module."""
