"""Numbers and words as they are set in the text of a page."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from markupsafe import Markup, escape

from gsp.results.lettering import GREEK
from gsp.systems.region import digits_between


def number(value: float, digits: int = 3, *, bound: Callable[[float, int], str] | None = None) -> Markup:
    """A number as it is set in text: 0.0123, 1.2 times a power of ten, and a dash for nan; rounded as a `bound` is."""
    if math.isnan(value):
        return Markup("–")
    if math.isinf(value):
        return Markup("∞" if value > 0 else "−∞")
    text = f"{value:.{digits}g}" if bound is None else bound(value, digits)
    if 0.0 < abs(value) < 1e-3 and "e" not in text:
        head, power = f"{float(text):.{digits - 1}e}".split("e")
        text = f"{float(head):g}e{power}"
    mantissa, _, exponent = text.replace("-", "−").partition("e")
    if not exponent:
        return Markup(mantissa)
    power = _power_of_ten(exponent.replace("−", "-"))
    return power if mantissa == "1" else Markup("{}×{}").format(mantissa, power)


def signed(value: float, digits: int = 3) -> Markup:
    """A number as a further term of a sum: its sign as an operator, apart."""
    return Markup("{} {}").format("−" if value < 0.0 else "+", number(abs(value), digits))


def scientific(value: float) -> Markup:
    """A number of a table: always two decimals and a power of ten."""
    if not math.isfinite(value) or value == 0.0:
        return number(value)
    mantissa, exponent = f"{value:.2e}".split("e")
    return Markup("{}×{}").format(mantissa.replace("-", "−"), _power_of_ten(exponent))


def _power_of_ten(exponent: str) -> Markup:
    return Markup("10<sup>{}</sup>").format(str(int(exponent)).replace("-", "−"))


def words(text: str) -> Markup:
    """Words of this package's own, in which mathematics is written as h_0(x), |Re lambda| or 1e-09, set as such."""
    result = str(escape(text))
    for pattern, replacement in _MATHEMATICS:
        result = re.sub(pattern, replacement, result)
    return Markup(result)


_MATHEMATICS = (
    (r"`([^`<>]+)`", r"<code>\1</code>"),
    *((rf"\b{name}\b", letter) for name, letter in GREEK.items()),
    (r"\b([a-zA-Z])_([a-z0-9])\b", r"<i>\1</i><sub>\2</sub>"),
    (r"\b([a-zA-Z])([0-9]{1,2})\b", r"<i>\1</i><sub>\2</sub>"),
    (r"(?<=[\w)>])\*\*([0-9]+)\b", r"<sup>\1</sup>"),
    (r"(?<=[\w)>])\*(?=[\w(<])", "·"),
    (r"\b([a-zA-Z])\^([0-9])\b", r"<i>\1</i><sup>\2</sup>"),
    (r"(?<=\))\^(-?[0-9.]*[0-9])", lambda found: f"<sup>{found[1].replace('-', '−')}</sup>"),
    (r"(?<=\w)\^\((-?[0-9]+/[0-9]+)\)", lambda found: f"<sup>{found[1].replace('-', '−')}</sup>"),
    (r"\ba b\b", "<i>a b</i>"),
    (r"(?<=[0-9] )us\b", "μs"),
    (r"\b([a-zA-Z])(?= = -?[0-9])", r"<i>\1</i>"),
    (r"(?:(?<==)|(?<=,)|(?<=from)|(?<=to)|(?<=\[)) ?-(?=[0-9])", lambda found: found[0].replace("-", "−")),
    ("&lt;-&gt;", "⇌"),
    (r"\b([0-9]+(?:\.[0-9]+)?)e\+00\b", r"\1"),
    (r"(?<![\w.])1e-0?([0-9]+)\b", r"10<sup>−\1</sup>"),
    (r"\b([0-9]+(?:\.[0-9]+)?)e-0?([0-9]+)\b", r"\1×10<sup>−\2</sup>"),
    (r"\b([0-9]+(?:\.[0-9]+)?)e\+0?([0-9]+)\b", r"\1×10<sup>\2</sup>"),
    (r"(?<![\w<])([bfglrxNy])(?=[\s,(:)]|$)(?!\w)", r"<i>\1</i>"),
)


def listed(items: Iterable[Any]) -> Markup:
    """Items with commas that do not part from them at the end of a line."""
    parts = list(items)
    commas = [","] * (len(parts) - 1) + [""]
    return Markup(" ").join(
        Markup('<span class="whole">{}{}</span>').format(*pair) for pair in zip(parts, commas)
    )


def fitted(value: float) -> str:
    """A fitted slope: two decimals, or a dash for nan."""
    return "–" if math.isnan(value) else f"{value:.2f}"


def span(interval: tuple[float, float]) -> Markup:
    """An interval of slow time."""
    return Markup("<i>t</i> = {}").format(ends(interval))


def ends(interval: tuple[float, float]) -> Markup:
    """The ends of an interval, so that they can be told apart."""
    return Markup("{} to {}").format(*(number(end, digits_between(interval)) for end in interval))


def unit(name: str, units: Mapping[str, str]) -> Markup:
    """The unit behind a value of the quantity `name`; empty where none is given."""
    return Markup("\u00a0{}").format(units[name]) if name in units else Markup("")
