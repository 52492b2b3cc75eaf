"""Seconds for exact series with symbolic parameters: one table, one line a system.

The figures to reach, after import: order 10 of the sleigh, Michaelis-Menten, Lindemann and the implicit
van der Pol branch under 0.3 s, order 6 of Koper's implicit cubic under 1 s.
"""

from __future__ import annotations

import time

import gsp
import gsp.models
from gsp.placement import place

CASES = (
    ("chaplygin_sleigh", 10, 0.3),
    ("michaelis_menten", 10, 0.3),
    ("lindemann", 10, 0.3),
    ("van_der_pol", 10, 0.3),
    ("koper", 6, 1.0),
)


def measure(name: str, order: int) -> tuple[float, float, float, int]:
    """(first, best of five, conversion to SymPy) in seconds, and the terms of the last numerator."""
    branch = place(gsp.models.load(name)).branch
    times = []
    for _ in range(6):
        begun = time.perf_counter()
        series = gsp.expand(branch, order=order)
        times.append(time.perf_counter() - begun)
    begun = time.perf_counter()
    last = series.coefficients[order][0]
    shown = time.perf_counter() - begun
    return times[0], min(times[1:]), shown, len(last.as_numer_denom()[0].expand().args)


def main() -> None:
    """Print the table."""
    print(f"{'scene':18} order    first     best  to SymPy   terms   bound")
    for name, order, bound in CASES:
        first, best, shown, terms = measure(name, order)
        verdict = "ok" if first < bound else "SLOW"
        print(f"{name:18} {order:5} {first:8.4f} {best:8.4f} {shown:9.4f} {terms:7} {bound:6} s {verdict}")


if __name__ == "__main__":
    main()
