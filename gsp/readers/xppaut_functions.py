"""Functions of XPPAUT that model files do not have, as definitions of what they have."""

from __future__ import annotations

import re
from fractions import Fraction

from gsp.readers.conditions import POSITIVE
from gsp.readers.foreign import WORDS, free_name

_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+))\s*"
_JUMP_OF_NUMBERS = re.compile(rf"(?<![a-z0-9_.])(mod|flr)\s*\({_NUMBER}(?:,{_NUMBER})?\)")
# What a step is made of, and XPPAUT's jumps. atan(tan(u)) is a line on each period: `near` is u less the whole number
# for which it is between 1/pi - 1/2 and 1/pi + 1/2, so that no fraction is at its jump, and `flr` sets that right. What
# is as near below a whole number as rounding may be, of a million periods, is on it.
HELPERS = {
    "positive": (("u",), POSITIVE),
    "log10": (("u",), "log(u)/log(10)"),
    "erfc": (("u",), "1 - erf(u)"),
    "near": (("u",), "(1 + atan(tan(pi*u - 1)))/pi"),
    "flr": (("u",), "u - near(u) - (1 - sign(near(u) + 1e-9))/2"),
    "rest": (("u", "w"), "u - w*flr(u/w)"),
    # The rest that C has, with the sign of u, and w more where that is negative: by a negative w it is below w then.
    "mod": (
        ("u", "w"),
        "rest(u, abs(w)) + (w - abs(w))*(1 - sign(u))*(1 + sign(rest(u, abs(w)) - 1e-9*abs(w)))/4",
    ),
}


class Helpers:
    """Functions that a file's own need: they become `definitions` when they are first asked for."""

    def __init__(self, definitions: dict[str, str], taken: set[str]) -> None:
        self._definitions, self._taken, self._made = definitions, taken, dict[str, str]()

    def name(self, word: str) -> str:
        """What the helper `word` is called here."""
        if word not in self._made:
            self._made[word] = name = free_name(word, self._taken)
            arguments, body = HELPERS[word]
            own = {a: free_name(a, {*self._taken}) for a in arguments}
            head = f"{name}({', '.join(own.values())})"
            own |= {word: self.name(word) for word in set(WORDS.findall(body)) & HELPERS.keys()}
            self._definitions[head] = WORDS.sub(lambda match: own.get(match[0], match[0]), body)
        return self._made[word]

    def written(self, text: str) -> str:
        """An expression with helpers for what model files lack, or the values of `mod` and `flr` of numbers."""
        text = _JUMP_OF_NUMBERS.sub(_worked_out, text)
        return re.sub(r"(?<![a-z0-9_.])(mod|flr|log10|erfc)(?=\s*\()", lambda match: self.name(match[1]), text)


def _worked_out(found: re.Match[str]) -> str:
    """`mod` or `flr` of numbers, exactly; as it stands where it is of none or of too many."""
    u, w = Fraction(found[2]), Fraction(found[3] or 0)
    if (found[1] == "flr") != (w == 0):
        return found[0]
    if found[1] == "flr":
        return f"({u // 1})"
    rest = u % abs(w)
    return f"({rest + w - abs(w) if u < 0 < rest else rest})"
