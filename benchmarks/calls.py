"""What stands around a solve: starting Python, and calling from it.

The figures to reach: the first solve of a fresh process under 0.5 s after the import, with numba's cache warm; a
call around a solve under 15 us. For the reduced model the ratio is reported, whatever it is.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

import numpy as np
from problems import sleigh

import gsp

COLD = """
import time
begun = time.perf_counter()
import sympy, gsp
v, w, omega, epsilon = sympy.symbols("v w omega epsilon")
imported = time.perf_counter()
rates = {v: omega * w + omega**2 / 5, w: -v * omega - sympy.Rational(26, 25) * w / epsilon, omega: w / epsilon / 5}
field = gsp.VectorField(rates, epsilon=epsilon)
gsp.integrate(field, start={"v": 1, "w": 0, "omega": 1}, span=(0, 20), epsilon=1e-3, rtol=RTOL)
print(imported - begun, time.perf_counter() - imported)
"""
# One for each of the three default methods.
COLD_RTOLS = (1e-6, 1e-8, 1e-10)
RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
# Short batches, so that some fall between the disturbances of a busy machine.
CALLS, ROUNDS = 20, 150


def cold_start(repeats: int = 3) -> list[dict]:
    """By tolerance: seconds of the import and of the first solve after it, the least of fresh processes."""
    rows = []
    # Installed packages have their bytecode; without it each process would compile the modules anew.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    for rtol in COLD_RTOLS:
        runs = []
        for _ in range(repeats + 1):
            code = COLD.replace("RTOL", repr(rtol))
            done = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
            )
            runs.append([float(word) for word in done.stdout.split()])
        # The first run may have had to compile.
        imported, solved = min(runs[1:], key=lambda run: run[1])
        rows.append({"rtol": rtol, "import": imported, "first_solve": solved})
    return rows


def call_overhead(rounds: int = ROUNDS) -> dict:
    """Microseconds of a public call without its steps, and of a step: a line through runs of many lengths.

    The sleigh at epsilon = 1e-6 by Radau of order 9: one short step, and the whole span at rtol from 1e-2 to 1e-7.
    """
    problem = sleigh(1e-6)
    cases = [((0.0, 1e-9), 1e-6), *((problem.span, rtol) for rtol in RTOLS)]

    def solve(span: tuple[float, float], rtol: float) -> gsp.Trajectory:
        return gsp.integrate(
            problem.field,
            start=problem.start,
            span=span,
            epsilon=problem.epsilon,
            rtol=rtol,
            atol=rtol,
            method=gsp.Method.RADAU9,
            dense=False,
        )

    steps = [float((stats := solve(*case).stats).steps + stats.rejected) for case in cases]
    least = [float("inf")] * len(cases)
    for _ in range(rounds):
        for i, case in enumerate(cases):
            begun = time.perf_counter()
            for _ in range(CALLS):
                solve(*case)
            least[i] = min(least[i], 1e6 * (time.perf_counter() - begun) / CALLS)
    step, call = np.polyfit(steps, least, 1)
    return {
        "method": "RADAU9",
        "call_us": float(call),
        "step_us": float(step),
        "shortest_us": least[0],
        "longest_steps": steps[-1],
    }


def show(cold: list[dict], overhead: dict[str, float]) -> None:
    """Print what both found."""
    print("\nFirst solve of a fresh process: seconds of the import, and of the solve after it")
    for row in cold:
        print(f"  rtol {row['rtol']:.0e}   {row['import']:6.2f} {row['first_solve']:6.2f}")
    print(
        f"\nA call around a solve: {overhead['call_us']:.1f} us and {overhead['step_us']:.2f} us a step "
        f"(sleigh, epsilon = 1e-6, Radau of order 9)"
    )


def main() -> None:
    """Print the figures."""
    show(cold_start(), call_overhead())


if __name__ == "__main__":
    main()
