"""A proof about a passage as a file: what `passage_checker` reads, every number a hexadecimal double."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsp.cycles.cycle_file import accepted, plain_delay, plain_field, plain_strip
from gsp.cycles.delay import exact_sheet
from gsp.proofs import passage_checker
from gsp.singular.passage.delayed_exit import DelayedExit
from gsp.systems.system import SlowFastSystem

if TYPE_CHECKING:
    from gsp.cycles.passage_certificate import PassageCertificate, ProvedStrip


def plain(certificate: PassageCertificate) -> dict:
    """The proof as plain values; raises `GspError` when the checker does not follow it."""
    strip, delay, system = certificate.strip, certificate.delay, certificate.system
    if strip is not None:
        return _with_strip(system, strip)
    assert delay is not None
    assert isinstance(certificate.passage, DelayedExit)
    rates = plain_field(system, certificate.sheet_rates)
    sheet = exact_sheet(certificate.passage)
    if not sheet.is_Rational:
        # What is written is the field of the distance, and no number is taken off y.
        rates["names"][1] += "_from_the_sheet"
    origin = ["0", str(sheet) if sheet.is_Rational else "0"]
    found = {"format": passage_checker.FORMAT, "origin": origin, **rates}
    row = accepted(
        lambda _, room: plain_delay(delay, rates["rates"], room),
        lambda row: passage_checker.check(found | {"delay": row}),
    )
    return found | {"delay": row}


def _with_strip(system: SlowFastSystem, one: ProvedStrip) -> dict:
    origin = [str(v) for v in one.origin]
    found = {"format": passage_checker.FORMAT, "origin": origin, **plain_field(system, one.rates)}
    row = accepted(
        lambda finer, room: plain_strip(one.strip, one.turn, one.epsilon, finer * one.fineness, room),
        lambda row: passage_checker.check(found | {"strip": row}),
    )
    return found | {"strip": row}
