"""The splitting of a friction system, from its geometry: momenta along D feel no friction across it.

With p_i = <e_i, M qdot> = (G_uu u + G_uw w)_i the friction force A^T B w drops out of p', since A e_i = 0.
Where u_i + (C w)_i has coefficients without positions that combination serves, free of denominators, and where
C_i = 0 it is u_i itself.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from types import MappingProxyType

import sympy as sp

from gsp.algebra.brevity import shorter
from gsp.algebra.ring_elements import RingElement
from gsp.errors import BudgetError
from gsp.mechanics.algebra import Algebra, Matrix, common_denominator
from gsp.mechanics.frame import fresh_symbols
from gsp.mechanics.hamel import HamelEquations
from gsp.splitting.splitting import Splitting
from gsp.systems.system import SlowFastSystem, VectorField


@dataclass(frozen=True)
class SlowMomenta:
    """Slow variables s = `along` u + `across` w with rates `rates`, all over (q, t, u, w).

    `kept[i]` says that s_i is u_i itself, `constant[i]` that its coefficients contain no position.
    """

    along: Matrix
    across: Matrix
    rates: list[RingElement]
    kept: tuple[bool, ...]
    constant: tuple[bool, ...]


def slow_momenta(equations: HamelEquations) -> SlowMomenta:
    """The slow momenta of Hamel's equations."""
    algebra, ring, a = equations.algebra, equations.algebra.ring, equations.along
    eta = [ring.generator(s) for s in equations.frame.quasi_velocities]
    along, across, rates, kept, constant = [], [], [], [], []
    for i, row in enumerate(equations.coupling):
        kept.append(all(e.is_zero for e in row))
        constant.append(all(algebra.is_constant(e) for e in row))
        if constant[-1]:
            scale = algebra.read(common_denominator(map(algebra.write, row)))
            along.append([scale if j == i else ring.zero for j in range(a)])
            across.append([(scale * e).reduced() for e in row])
            rates.append((scale * equations.free[i]).reduced())
            continue
        metric = equations.metric[i]
        along.append(metric[:a])
        across.append(metric[a:])
        turned = algebra.apply([algebra.derive(metric, 0)], eta)[0]
        rates.append((turned + equations.force[i]).reduced())
    return SlowMomenta(along, across, rates, tuple(kept), tuple(constant))


def geometric_splitting(
    field: VectorField,
    equations: HamelEquations,
    momenta: SlowMomenta,
    friction: sp.ImmutableMatrix,
    layer: list[sp.Expr],
    drift: list[sp.Expr],
) -> Splitting:
    """The `Splitting` of `field` into positions and momenta, slow, and slip velocities w, fast.

    `friction` (n - k + k, k) maps w to the fast part of eta', `layer` is that fast part, `drift` the other one.
    """
    algebra, system, frame = equations.algebra, equations.system, equations.frame
    write = algebra.write
    epsilon = field.epsilon
    assert epsilon is not None
    taken = {s.name for s in (*field.states, *system.coordinates, *system.clock, *system.values, epsilon)}
    names = _names(frame.along, momenta.kept, taken | {v.name for v in system.velocities})
    new = Algebra(
        (*system.coordinates, *system.clock, *names, *frame.across),
        tuple(system.values),
        [*friction, *drift, *(write(e, factored=False) for e in _everything(equations, momenta))],
        sines=equations.algebra.awkward_angles,
        measured_from=equations.algebra.measured_from,
    )
    # s = P u + Q w solved for u.
    P = new.matrix(_written(algebra, momenta.along))
    Q = new.matrix(_written(algebra, momenta.across))
    w = [new.ring.generator(s) for s in frame.across]
    left = [(new.ring.generator(s) - b).reduced() for s, b in zip(names, new.apply(Q, w))]
    u = dict(zip(frame.along, new.apply(new.inverse(P), left)))
    solved = {s: new.write(e) for s, e in u.items()}

    def carried(written: sp.Expr) -> sp.Expr:
        # Multiplied out a quadratic form in u is short where there are few positions, and endless where there are many.
        as_it_stands = written.xreplace(solved)
        with new.ring.afresh(), suppress(BudgetError):
            return shorter(new.write(new.read(written, u)), as_it_stands)
        return as_it_stands

    positions = equations.positions()
    slow = {q: carried(write(positions[q])) for q in field.states if q in system.coordinates}
    slow |= {s: carried(write(rate)) for s, rate in zip(names, momenta.rates)}
    slow |= {t: sp.Integer(1) for t in system.clock if t in field.states}
    place = len(frame.along)
    fast = {
        s: carried(layer[place + j]) + epsilon * carried(drift[place + j]) for j, s in enumerate(frame.across)
    }
    inverse = {z: solved.get(z, z) for z in field.states}
    expressions = [
        sp.Add(*[write(c) * s for c, s in zip((*a, *b), frame.quasi_velocities)])
        for a, b in zip(momenta.along, momenta.across)
    ]
    shown = dict(zip(names, expressions)) | {q: q for q in slow if q not in names}
    standard = SlowFastSystem(
        slow=slow,
        fast=fast,
        epsilon=epsilon,
        parameters=field.parameters,
        name=field.name,
        observables={s: e for s, e in solved.items() if s not in slow},
    )
    rates = dict(zip(frame.quasi_velocities, drift))
    N = dict(zip(frame.quasi_velocities, friction.tolist()))
    k = len(frame.across)
    return Splitting(
        field=field,
        system=standard,
        coordinates=MappingProxyType({s: shown[s] for s in slow} | {s: s for s in frame.across}),
        inverse=MappingProxyType(inverse),
        N=sp.ImmutableMatrix([N.get(z, [sp.Integer(0)] * k) for z in field.states]),
        layer=sp.ImmutableMatrix(list(frame.across)),
        drift=sp.ImmutableMatrix([rates.get(z, field.equations[z]) for z in field.states]),
        route=_route(names, momenta, frame.across),
        nonzero=tuple(new.denominators),
    )


def _everything(equations: HamelEquations, momenta: SlowMomenta) -> list[RingElement]:
    entries = (e for matrix in (momenta.along, momenta.across) for row in matrix for e in row)
    return [*equations.positions().values(), *momenta.rates, *entries]


def _written(algebra: Algebra, matrix: Matrix) -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix([[algebra.write(e, factored=False) for e in row] for row in matrix])


def _names(along: tuple[sp.Symbol, ...], kept: tuple[bool, ...], taken: set[str]) -> list[sp.Symbol]:
    """u_i where it is slow itself, and p, or p1, p2, ..., for the others, as `split` has it."""
    fresh = fresh_symbols(kept.count(False), (*"pqruxyz", "slow"), taken)
    return [s if own else next(fresh) for s, own in zip(along, kept)]


def _route(names: list[sp.Symbol], momenta: SlowMomenta, across: tuple[sp.Symbol, ...]) -> str:
    slips = ", ".join(s.name for s in across)
    new = [s.name for s, own in zip(names, momenta.kept) if not own]
    if not new:
        return (
            f"The velocities along D are orthogonal to {slips} in the kinetic metric: they are slow themselves."
        )
    turning = [s.name for s, fixed in zip(names, momenta.constant) if not fixed]
    moving = f" ({', '.join(turning)} with coefficients that depend on positions)" if turning else ""
    return (
        f"Friction acts across the constraints only, so momenta along them feel none: {', '.join(new)}{moving} "
        f"in place of velocities; the slip velocities {slips} are fast."
    )
