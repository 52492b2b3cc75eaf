"""A proof about a relaxation cycle as a file: what `cycle_checker` reads, every number a hexadecimal double."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import sympy as sp

from gsp.cycles.annulus import Band, Strip
from gsp.cycles.axis_cycle import ProvedCircuit
from gsp.cycles.delay import ProvedDelay
from gsp.cycles.enclosed_field import exact_rates
from gsp.cycles.sectors import Turn
from gsp.errors import GspError
from gsp.proofs import circuit_checker, cycle_checker, passage_checker
from gsp.proofs.programs import IntervalProgram, Rejected, TooLong
from gsp.systems.system import SlowFastSystem

if TYPE_CHECKING:
    from gsp.cycles.cycle_certificate import CycleCertificate, ProvedAnnulus

# Strips in place of those of the prover, and by which shares the bounds that are claimed are wider than its own: the
# checker encloses in its own way.
CLAIMS = ((1, 0.0), (1, 1e-3), (1, 1e-2), (2, 1e-2), (2, 0.1), (4, 0.1), (4, 0.5), (4, 1.0), (4, 10.0))


def plain(certificate: CycleCertificate) -> dict:
    """The proof as plain values; raises `GspError` when the checker does not follow it."""
    return _with_circuits(certificate) or _accepted(certificate)


def _accepted(certificate: CycleCertificate) -> dict:
    """The proof as plain values, with the sharpest bounds that the checker follows."""
    system = certificate.orbit.branch.system
    found = {"format": cycle_checker.FORMAT, **plain_field(system, exact_rates(system))}
    rows = []
    for one in _kept(certificate):
        assert not isinstance(one, ProvedCircuit)
        unique = one is certificate.uniqueness

        def written(finer: int, room: float, one: ProvedAnnulus = one, unique: bool = unique) -> dict:
            row = plain_band(one.annulus, one.epsilon, one.turn, finer * one.fineness, room)
            # Little is left of a bound that is claimed at all.
            bound = one.turn.contraction * max(1.0 - room, 2.0**-40) if unique else 0.0
            return row | {"unique": unique, "contraction": bound.hex()}

        rows.append(accepted(written, lambda row: cycle_checker.check(found | {"annuli": [row]})))
    return found | {"annuli": rows}


def _kept(certificate: CycleCertificate) -> list[ProvedAnnulus | ProvedCircuit]:
    return list(dict.fromkeys(a for a in (certificate.existence, certificate.uniqueness) if a is not None))


def _with_circuits(certificate: CycleCertificate) -> dict | None:
    """The proof by circuits as plain values; None where it is one by annuli."""
    circuits = [one for one in _kept(certificate) if isinstance(one, ProvedCircuit)]
    if not circuits:
        return None
    found = {
        "format": circuit_checker.FORMAT, "level": str(circuits[0].level),
        **plain_field(certificate.orbit.branch.system, circuits[0].rates),
    }  # fmt: skip
    rows = []
    for one in circuits:
        unique = one is certificate.uniqueness

        def written(finer: int, room: float, one: ProvedCircuit = one, unique: bool = unique) -> dict:
            bound = one.turn.contraction * max(1.0 - room, 2.0**-40) if unique else 0.0
            strip = plain_strip(one.strip, one.strip_turn, one.epsilon, finer * one.fineness, 0.5 * room)
            delays = [plain_delay(delay, found["rates"], room) for delay in one.delays]
            (least, _), (_, most) = (row["time"] for row in delays)
            parts = [[float.fromhex(v) for v in pair] for pair in (strip["period"], (least, most))]
            low, high = (sum(ends) for ends in zip(*parts))
            return {
                "strip": strip, "delays": delays, "unique": unique, "contraction": bound.hex(),
                "period": [math.nextafter(low, -math.inf).hex(), math.nextafter(high, math.inf).hex()],
            }  # fmt: skip

        rows.append(accepted(written, lambda row: circuit_checker.check(found | {"circuits": [row]})))
    return found | {"circuits": rows}


def plain_field(system: SlowFastSystem, rates: Sequence[sp.Expr]) -> dict:
    """The names of a planar system, and rates as expressions of z0, z1 and z2."""
    symbols = (*system.x, *system.y, system.epsilon)
    plain = {s: sp.Symbol(f"z{i}") for i, s in enumerate(symbols)}
    return {
        "names": [s.name for s in symbols],
        "rates": [sp.sstr(e.xreplace(plain), full_prec=False) for e in rates],
    }


def plain_band(band: Band, epsilon: float, turn: Turn, fineness: int, room: float) -> dict:
    """What an annulus and a strip have in common, with wider bounds of the time by the share `room`."""
    least, most = turn.period
    return {
        "epsilon": epsilon.hex(),
        "outer": [float(v).hex() for v in band.outer.ravel()],
        "inner": [float(v).hex() for v in band.inner.ravel()],
        "cuts": [list(cut) for cut in band.cuts],
        "strips": fineness,
        "grids": [[v.hex() for v in band.grid(k, fineness)] for k in range(len(band.sides))],
        "period": [(least * max(1.0 - room, 0.0)).hex(), (most * (1.0 + room)).hex()],
    }


def plain_strip(strip: Strip, turn: Turn, epsilon: float, fineness: int, room: float) -> dict:
    """A strip, with wider bounds by the share `room`."""
    row = plain_band(strip, epsilon, turn, fineness, room)
    bound = turn.contraction + room * abs(turn.contraction)
    return row | {
        "slow_first": strip.slow_first, "cornered": strip.cornered, "contraction": bound.hex()
    }  # fmt: skip


def plain_delay(one: ProvedDelay, rates: Sequence[str], room: float) -> dict:
    """A delay, kept and left with the share `room` of its grid to spare, and the bounds of the checker itself."""
    spare = math.ceil(0.1 * min(room, 0.5) * len(one.grid))
    row = {
        "epsilon": one.epsilon.hex(),
        "width": one.width.hex(),
        "above": one.above,
        "grid": [float(v).hex() for v in one.grid],
        "kept": max(1, one.kept - spare),
        "left": one.left and min(len(one.grid) - 1, one.left + spare),
        "time": [(0.0).hex(), (0.0).hex()],
        "depth": (0.0).hex(),
    }
    least, most, depth = passage_checker.DelayChecker(row, IntervalProgram(tuple(rates), 3)).bounds()
    down, up = (lambda v: math.nextafter(float(v), -math.inf)), (lambda v: math.nextafter(float(v), math.inf))
    return row | {"time": [down(least).hex(), up(most).hex()], "depth": down(depth).hex()}


def accepted(written: Callable[[int, float], dict], check: Callable[[dict], object]) -> dict:
    """What is written with the sharpest of the claims that pass the check; raises `GspError` when none does."""
    refused = ""
    for finer, room in CLAIMS:
        try:
            row = written(finer, room)
            check(row)
        except TooLong as error:
            # Later claims have as many strips at least: each would take as long, which is more than a minute.
            refused = str(error)
            break
        except Rejected as error:
            refused = str(error)
            continue
        return row
    raise GspError(
        f"the checker does not follow this proof: {refused}.", "It cannot be saved. Give a smaller epsilon."
    )
