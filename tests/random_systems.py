"""Random systems of one or two slow and fast variables, the same for the same seed, and a worker that checks one."""

from __future__ import annotations

import random
import resource
import sys

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem

EPSILON = sp.Symbol("epsilon")


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


def checked(seed: int) -> str:
    """What `gsp check` does with the scene: the verdict, or the refusal by its own error."""
    from gsp.errors import GspError
    from gsp.hyperbolicity.hyperbolicity import classify
    from gsp.scenes.study import study_of

    scene = random_scene(seed)
    try:
        study = study_of(scene)
        verdict = classify(study.branch, region=study.region, epsilon=scene.epsilon)
    except GspError as error:
        return f"refused: {error}"
    return f"{verdict.kind}"


def main() -> None:
    """Check the seeds from the first argument to the second, one line for each: seconds of processor, answer."""
    first, last = int(sys.argv[1]), int(sys.argv[2])
    for seed in range(first, last):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        answer = checked(seed)
        usage = resource.getrusage(resource.RUSAGE_SELF)
        print(f"{seed} {usage.ru_utime - before:.2f} s {usage.ru_maxrss // 1024} MB {answer}"[:200], flush=True)


if __name__ == "__main__":
    main()
