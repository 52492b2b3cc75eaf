"""Random systems of one or two slow and fast variables, the same for the same seed, and what `gsp check` says of them.

`python -m tests.random_systems 0 200` checks the seeds from 0 to 199, each in a process of its own with bounds on CPU
time and memory, prints a line for each that is lost or refused, and ends with status 1 when one is lost.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from dataclasses import dataclass

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem
from tests.children import in_child
from tests.fuzz.run import check

EPSILON = sp.Symbol("epsilon")
SECONDS = 10
"""Of CPU time, for a system."""
MEMORY = 500 * 2**20
"""Bytes resident at the peak, for a system."""
REFUSED = "refused: "


def random_scene(seed: int) -> Scene:
    """Polynomials, tanh, sin, exp(u/2) and 1/(2 + u^2) in every rate, damped in the fast directions."""
    rng = random.Random(seed)
    slow = sp.symbols("x1:3")[: rng.randint(1, 2)]
    fast = sp.symbols("y1:3")[: rng.randint(1, 2)]
    states = (*slow, *fast)

    def coefficient() -> sp.Rational:
        return sp.Rational(rng.choice([-1, 1]) * rng.randint(1, 12), 10)

    def term() -> sp.Expr:
        u, v = rng.choice(states), rng.choice(states)
        forms = [u, u * v, u**2, u**3, sp.tanh(u), sp.sin(u), sp.exp(u / 2), 1 / (2 + u**2), u / (2 + v**2)]
        forms += [v * sp.tanh(u), sp.sin(u * v), sp.exp(u / 2) * v, sp.tanh(u + v)]
        return coefficient() * rng.choice(forms)

    def rate() -> sp.Expr:
        return sp.Add(*[term() for _ in range(rng.randint(2, 4))])

    system = SlowFastSystem(
        slow={x: rate() for x in slow},
        fast={y: rate() - sp.Rational(rng.randint(15, 40), 10) * y for y in fast},
        epsilon=EPSILON,
        name=f"random_{seed}",
    )
    start = {s.name: 0.1 * rng.randint(-5, 5) for s in states}
    region = {x.name: (start[x.name] - 0.5, start[x.name] + 0.5) for x in slow}
    return Scene(
        system=system,
        region=region,
        start=start,
        span=(0.0, 1.0),
        epsilon=0.01,
        epsilons=(0.02, 0.01),
        tolerance=1e-6,
        name=system.name,
    )


@dataclass(frozen=True)
class Ending:
    """How the check of `seed` ended: `status` (negative: a signal), answer, CPU `seconds` and peak `memory`."""

    seed: int
    status: int
    answer: str
    seconds: float
    memory: int

    @property
    def complaint(self) -> str:
        """Why this system is lost, empty when there is a verdict or a refusal within the bounds."""
        if self.status != 0:
            return f"ended with status {self.status}"
        if self.seconds > SECONDS:
            return f"took {self.seconds:.1f} s of CPU time"
        if self.memory > MEMORY:
            return f"took {self.memory / 2**20:.0f} MB"
        return ""

    @property
    def is_refused(self) -> bool:
        """Whether the answer is a refusal by one of our own errors."""
        return self.status == 0 and self.answer.startswith(REFUSED)

    def __str__(self) -> str:
        head = f"{self.seed:6d} {self.seconds:5.1f} s {self.memory / 2**20:4.0f} MB  "
        return head + ": ".join(part for part in (self.complaint, self.answer[:300]) if part)


def run(seed: int) -> Ending:
    """What `gsp check` does with the scene of a seed, in a child of this process."""

    def work() -> int:
        try:
            answer.write(check(random_scene(seed)))
        except BaseException as error:
            answer.write(f"{type(error).__name__}: {error}")
            raise
        finally:
            answer.flush()
        return 0

    with tempfile.TemporaryFile("w+") as answer:
        status, seconds, memory = in_child(work, SECONDS)
        answer.seek(0)
        return Ending(seed, status, answer.read(), seconds, memory)


def main(arguments: list[str]) -> int:
    """Check the seeds that `arguments` ask for; the status, 1 when one of them is lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.random_systems")
    parser.add_argument("first", type=int, help="the first seed")
    parser.add_argument("last", type=int, help="the seed after the last one")
    options = parser.parse_args(arguments)
    if not options.first < options.last:
        parser.error(f"no seeds from {options.first} to {options.last}")

    endings = []
    for seed in range(options.first, options.last):
        endings.append(ending := run(seed))
        if ending.complaint or ending.is_refused:
            print(ending, flush=True)
    lost, refused = (sum(map(bool, which)) for which in zip(*((e.complaint, e.is_refused) for e in endings)))
    print(
        f"{len(endings)} systems, {lost} lost, {refused} refused; at most {max(e.seconds for e in endings):.1f} s of "
        f"CPU time and {max(e.memory for e in endings) / 2**20:.0f} MB"
    )
    return int(lost > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
