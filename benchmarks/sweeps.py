"""What a sweep costs beside its work, and how it scales: `python benchmarks/sweeps.py`.

Each point tells how long its own work took, so that both figures are ratios within one run on a noisy machine.
"""

from __future__ import annotations

import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from gsp.sweeps.sweep import Sweep, sweep

POINTS, CHUNK, TERMS = 960, 24, 1_200_000


def harmonic(x: float) -> dict[str, float]:
    """A sum that takes some hundredths of a second, and how long it took."""
    begun = time.perf_counter()
    value = sum(x / k for k in range(1, TERMS))
    return {"value": value, "seconds": time.perf_counter() - begun}


def cheap(x: float, k: float) -> dict[str, float]:
    """Next to no work."""
    return {"value": x * k}


def stop(share: float) -> None:
    """Ctrl-C after the first chunk."""
    raise KeyboardInterrupt


def main() -> None:
    # A task is found by its module's name, which __main__ is not.
    import sweeps

    with tempfile.TemporaryDirectory() as scratch:
        for workers in range(1, (os.cpu_count() or 1) + 1):
            begun = time.perf_counter()
            found = sweep(
                sweeps.harmonic,
                over={"x": range(POINTS)},
                points_per_chunk=CHUNK,
                into=Path(scratch, str(workers)),
                workers=workers,
            )
            spent = time.perf_counter() - begun
            work = float(found.as_dataset().seconds.sum())
            print(
                f"{workers} process{'es' if workers > 1 else ''}: {POINTS // CHUNK} chunks of "
                f"{work / POINTS * CHUNK:.2f} s; {work:.2f} s of work in {spent:.2f} s, {work / spent:.3f} at once"
            )
        huge = Path(scratch, "huge")
        with suppress(KeyboardInterrupt):
            sweep(sweeps.cheap, over={"x": range(4000), "k": range(2500)}, into=huge, workers=1, progress=stop)
        begun = time.perf_counter()
        told = str(Sweep(huge))
        print(f"a plan of 10^7 points opened, its progress told: {time.perf_counter() - begun:.3f} s")
        assert "of 10,000,000 points" in told


if __name__ == "__main__":
    main()
