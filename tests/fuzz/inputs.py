"""Inputs of the fuzzer: model files by grammar, and mutations of files that are valid; the same for the same seed."""

from __future__ import annotations

import random
from pathlib import Path

CASES = Path(__file__).parent / "cases"
FUNCTIONS = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "sqrt", "erf", "abs", "sign"),
)
NUMBERS = (
    *(
        "0",
        "1",
        "2",
        "3",
        "-1",
        "0.1",
        "1/3",
        "1000",
        "1e-3",
        "1e300",
        "1e-300",
        "1e400",
        "0.30000000000000004",
    ),
    *("99", "100", "101", "1e308", "-0", "007", "1e999999999", ".5", "5.", "1_0", "nan", "inf"),
)
FRAGMENTS = (
    *(
        "^",
        "**",
        "*",
        "/",
        "+",
        "-",
        "(",
        ")",
        ",",
        '"',
        "'",
        "[",
        "]",
        "=",
        "\n",
        "#",
        ".",
        "{",
        "}",
        "\\",
        "\x00",
    ),
    *(
        "exp(",
        "log(",
        "sqrt(",
        "pi",
        "e",
        "I",
        "1/0",
        "0^0",
        "0^-1",
        "epsilon",
        "(1 - x)^0.5",
        "1000**(1 - 2*pi)",
    ),
    *(
        "__import__",
        "lambda",
        "nan",
        "inf",
        "1e999",
        "\u202e",
        "\x1b[31m",
        "é",
        "𝟙",
        "[slow]",
        "[fast]",
        "[states]",
    ),
)

VALID = """\
epsilon = "epsilon"
title = "Michaelis and Menten"

[parameters]
kappa = 1
lambda = 0.5

[slow]
s = "-s + (s + kappa - lambda)*c"

[fast]
c = "s - (s + kappa)*c"

[observables]
total = "s + c"

[region]
s = [0.1, 2]

[start]
s = 1
c = 0.5

[scene]
span = [0, 5]
epsilon = 0.01
epsilons = [0.04, 0.02, 0.01]
tolerance = 1e-6
path = ["s", "c"]
"""
RAW = """\
[parameters]
a = 0.2

[states]
v = "omega*w + a*omega^2"
omega = "-a*v*omega + a*w/epsilon"
w = "-v*omega - 2*w/epsilon"

[reconstruction]
phi = "omega"

[region]
v = [0.5, 1]
omega = [0.1, 1]
w = [-1, 1]

[start]
v = 1
omega = 0.5
w = 0.1

[scene]
span = [0, 1]
epsilon = 0.01
"""
TEMPLATES = (VALID, RAW)


def expression(rng: random.Random, names: list[str], depth: int = 3) -> str:
    """A text of the grammar, or nearly."""
    kind = rng.random()
    if depth == 0 or kind < 0.25:
        return rng.choice(names) if rng.random() < 0.7 else rng.choice(NUMBERS[:14])
    inner = [expression(rng, names, depth - 1) for _ in range(2)]
    if kind < 0.7:
        return f"({inner[0]} {rng.choice('+-*/')} {inner[1]})"
    if kind < 0.8:
        return f"({inner[0]})^{rng.choice(['2', '3', '-1', '0.5', '1/3', '-2/3', rng.choice(names), '(1 - 2*pi)'])}"
    if kind < 0.83:
        return f"{rng.choice(['min', 'max'])}({inner[0]}, {inner[1]})"
    if kind < 0.86:
        return f"(-{rng.choice(NUMBERS[:6])}**{inner[0]})"
    return f"{rng.choice(FUNCTIONS)}({inner[0]})"


def by_grammar(rng: random.Random) -> str:
    """A model file whose shape is right and whose expressions are random."""
    slow, fast = ["x", "u"][: rng.randint(1, 2)], ["y", "z"][: rng.randint(1, 2)]
    names = [*slow, *fast, "a", *(["epsilon"] if rng.random() < 0.2 else [])]
    number = lambda: rng.choice(NUMBERS[:7])  # noqa: E731
    lines = ["[parameters]", f"a = {rng.choice(['0.5', '2', '-1', '0', '1e-8', '1e8'])}"]
    if rng.random() < 0.8:
        lines += ["[slow]", *(f'{s} = "{expression(rng, names)}"' for s in slow)]
        damped = rng.random() < 0.6
        lines += ["[fast]", *(f'{s} = "{expression(rng, names)}{" - " + s if damped else ""}"' for s in fast)]
    else:
        lines += ["[states]", *(f'{s} = "{expression(rng, names)}"' for s in slow)]
        lines += [f'{s} = "({expression(rng, names)})/epsilon + {expression(rng, names, 1)}"' for s in fast]
    bounds = [
        ("0", "1"),
        ("-1", "1"),
        ("0.5", "0.6"),
        ("-1e300", "1e300"),
        ("1e-300", "1e-299"),
        ("1", "1"),
        ("-1e308", "1e308"),
    ]
    lines.append("[region]")
    for s in slow if rng.random() < 0.7 else [*slow, *fast]:
        low, high = bounds[0] if rng.random() < 0.6 else rng.choice(bounds)
        lines.append(f"{s} = [{low}, {high}]")
    lines += ["[start]", *(f"{s} = {number()}".replace("1/3", "0.25") for s in [*slow, *fast])]
    small = rng.choice(["0.01", "0.01", "0.1", "1e-300", "1e300", "0"])
    lines += ["[scene]", "span = [0, 1]", f"epsilon = {small}"]
    return "\n".join(lines) + "\n"


def mutated(rng: random.Random, texts: list[str]) -> str:
    """A valid text with a few pieces removed, repeated, moved or replaced."""
    text = rng.choice(texts)
    for _ in range(rng.randint(1, 4)):
        if not text:
            break
        i = rng.randrange(len(text))
        j = min(len(text), i + rng.randint(0, 12))
        kind = rng.randrange(6)
        if kind == 0:
            text = text[:i] + text[j:]
        elif kind == 1:
            text = text[:i] + rng.choice(FRAGMENTS) + text[i:]
        elif kind == 2:
            text = text[:i] + text[i:j] * rng.choice([2, 3, 50]) + text[j:]
        elif kind == 3:
            text = text[:i] + rng.choice(NUMBERS) + text[j:]
        elif kind == 4:
            other = rng.choice(texts)
            k = rng.randrange(len(other))
            text = text[:i] + other[k : k + rng.randint(1, 60)] + text[i:]
        else:
            digits = [k for k, c in enumerate(text) if c.isdigit()]
            if digits:
                k = rng.choice(digits)
                text = text[:k] + rng.choice(NUMBERS) + text[k + 1 :]
    return text


def inputs(seed: int):
    """Endless inputs: half by grammar, half mutations of the templates and of the kept cases."""
    rng = random.Random(seed)
    texts = [*TEMPLATES, *(path.read_text(encoding="utf-8") for path in sorted(CASES.glob("*.toml")))]
    while True:
        yield by_grammar(rng) if rng.random() < 0.5 else mutated(rng, texts)
