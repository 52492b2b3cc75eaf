"""Seconds for exact series with symbolic parameters: one table, one line a system.

The figures to reach, after import: order 10 of the sleigh, Michaelis-Menten, Lindemann and the implicit
van der Pol branch under 0.3 s, order 6 of Koper's implicit cubic under 1 s.
"""

from __future__ import annotations

import time

import gsp
import gsp.models
from gsp.scenes.study import study_of

CASES = (
    ("chaplygin_sleigh", 10, 0.3),
    ("michaelis_menten", 10, 0.3),
    ("lindemann", 10, 0.3),
    ("van_der_pol", 10, 0.3),
    ("koper", 6, 1.0),
)


def measure(name: str, order: int, bound: float) -> dict:
    """Seconds of the first call, of the best of five and of the conversion to SymPy; terms of the last numerator."""
    branch = study_of(gsp.models.load(name)).branch
    times = []
    for _ in range(6):
        begun = time.perf_counter()
        series = gsp.expand(branch, order=order)
        times.append(time.perf_counter() - begun)
    begun = time.perf_counter()
    last = series.coefficients[order][0]
    shown = time.perf_counter() - begun
    terms = len(last.as_numer_denom()[0].expand().args)
    return {
        "model": name,
        "order": order,
        "first": times[0],
        "best": min(times[1:]),
        "to_sympy": shown,
        "terms": terms,
        "bound": bound,
    }


def show(rows: list[dict]) -> None:
    """Print what `measure` found."""
    print(f"{'scene':18} order    first     best  to SymPy   terms   bound")
    for row in rows:
        print(
            f"{row['model']:18} {row['order']:5} {row['first']:8.4f} {row['best']:8.4f} {row['to_sympy']:9.4f} "
            f"{row['terms']:7} {row['bound']:6} s {'ok' if row['first'] < row['bound'] else 'SLOW'}"
        )


def main() -> None:
    """Print the table."""
    show([measure(*case) for case in CASES])


if __name__ == "__main__":
    main()
