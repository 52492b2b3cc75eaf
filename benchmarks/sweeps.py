"""What a sweep costs beside its work, and how it scales: `python benchmarks/sweeps.py`.

Each point tells how long its own work took, so that both figures are ratios within one run on a noisy machine.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from gsp.sweeps.sweep import Sweep, sweep

POINTS, SHARE, CHUNK, TERMS = 960, 240, 24, 1_200_000


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


def timed(
    task: Callable[..., dict[str, float]], points: int, workers: int, scratch: Path
) -> tuple[float, float]:
    """Seconds of work that the points tell of, and seconds that the sweep took."""
    begun = time.perf_counter()
    found = sweep(
        task,
        over={"x": range(points)},
        points_per_chunk=CHUNK,
        into=scratch / f"{workers}-{points}",
        workers=workers,
    )
    spent = time.perf_counter() - begun
    return float(found.to_xarray().seconds.sum()), spent


def main() -> None:
    # A task is found by its module's name, which __main__ is not.
    import sweeps

    with tempfile.TemporaryDirectory() as scratch:
        for workers in range(1, (os.cpu_count() or 1) + 1):
            little, much = (
                timed(sweeps.harmonic, points, workers, Path(scratch)) for points in (SHARE, POINTS)
            )
            work, spent = much[0] - little[0], much[1] - little[1]
            print(
                f"{workers} process{'es' if workers > 1 else ''}: {POINTS // CHUNK} chunks of "
                f"{much[0] / POINTS * CHUNK:.2f} s; {much[0]:.2f} s of work in {much[1]:.2f} s, "
                f"{much[0] / much[1]:.3f} at once; without the start, which {SHARE // CHUNK} chunks have as well, "
                f"{work / spent:.3f}"
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
