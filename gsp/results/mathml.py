"""Expressions as presentation MathML, which browsers set without any script.

SymPy's printer sorts symbols by name; here the small parameter comes first, then parameters, then states, as one
writes them. Everything returned is markup that is safe to place in a page.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, cast

import sympy as sp
from markupsafe import Markup
from sympy.printing.conventions import split_super_sub
from sympy.printing.mathml import MathMLPresentationPrinter

from gsp.results.lettering import letter, rate_of
from gsp.results.long_formulas import NamedParts, lines

_ONE_LINE = re.compile(r"<mo>\(</mo>((?:(?!<mo>[()]</mo>|<mfrac).)*)<mo>\)</mo>")

_DOTS = "˙¨"
_NEGATIVE = re.compile(r"(?:<mrow>)*<m[on]>−")

# A product next to a word, as in v cos(phi), c tanh(x)^2 and Ke Kt: set solid, the two would be one.
_WORD = r"<mi>[^<&]{2,}</mi>"
_BEFORE_A_WORD = re.compile(rf"<mo>&#8290;</mo>(?=(?:<m(?:row|su[bp]|subsup)>)*{_WORD})")
_BEHIND_A_WORD = re.compile(rf"({_WORD}<mo>&#8290;</mo>)(?!<mspace)")


class _MathPrinter(MathMLPresentationPrinter):
    """SymPy's printer, for expressions whose symbols were renamed for the sake of their order."""

    def __init__(self, originals: Mapping[sp.Symbol, sp.Symbol]) -> None:
        super().__init__()
        self.originals = originals

    def _print_Symbol(self, sym: Any, style: str = "plain") -> Any:
        original = self.originals.get(sym, sym)
        rate = rate_of(original.name)
        if not all(original.name.split("_")):
            # SymPy sets what is behind two underscores as a power.
            return self._made("mi", original.name)
        printed = super()._print_Symbol(sp.Symbol(rate[0]) if rate else original, style)  # pyright: ignore[reportAttributeAccessIssue]
        if rate is None:
            return printed
        return self._made("mover", printed, self._made("mo", _DOTS[rate[1] - 1], mathsize="120%"))

    def _print_Piecewise(self, expr: sp.Piecewise) -> Any:
        """A brace, and a line for each case."""
        lines = []
        for value, condition in cast(Any, expr.args):
            word = self._made("mtext", "otherwise" if condition == sp.true else "if\u00a0")
            where = [word] if condition == sp.true else [word, self._print(condition)]
            cells = (
                self._made("mtd", *parts, style="text-align: left") for parts in ([self._print(value)], where)
            )
            lines.append(self._made("mtr", *cells))
        table = self._made("mtable", *lines, **{"class": "cases", "columnalign": "left left"})
        return self._made("mrow", self._made("mo", "{", stretchy="true"), table)

    def _made(self, tag: str, *parts: Any, **attributes: str) -> Any:
        """An element of `parts`, text among them."""
        element = self.dom.createElement(tag)
        for name, value in attributes.items():
            element.setAttribute(name, value)
        for part in parts:
            element.appendChild(self.dom.createTextNode(part) if isinstance(part, str) else part)
        return element


class Typesetter:
    """MathML of expressions in some symbols, which are written in the order given."""

    def __init__(self, symbols: Iterable[sp.Symbol]) -> None:
        ordered = list(dict.fromkeys(symbols))
        self._stand_ins = {s: sp.Symbol(f"s{i:03d}") for i, s in enumerate(ordered)}
        self._named = NamedParts(s.name for s in ordered)
        self._printer = _MathPrinter({stand_in: s for s, stand_in in self._stand_ins.items()})

    def row(self, expression: sp.Basic | sp.MatrixBase) -> str:
        """The expression without its <math> element."""
        if isinstance(expression, sp.MatrixBase):
            return self._matrix(expression)
        text = self._printer.doprint(cast(sp.Basic, expression.xreplace(self._stand_ins)))
        # The double-struck e of the entity is no mathematician's exponential.
        text = text.replace("<mi>&ExponentialE;</mi>", "<mi>e</mi>").replace("&InvisibleTimes;", "&#8290;")
        for dots in _DOTS:
            text = text.replace(f"&#{ord(dots)};", dots)
        # Without a mathematical font a browser sets the ASCII sign as a hyphen.
        text = text.replace("<mo>-</mo>", "<mo>−</mo>").replace("<mn>-", "<mn>−")
        text = text.replace("<mo><</mo>", "<mo>&lt;</mo>").replace("<mo>></mo>", "<mo>&gt;</mo>")
        for product in (_BEFORE_A_WORD, _BEHIND_A_WORD):
            text = product.sub(r'\g<0><mspace width="0.17em"></mspace>', text)
        # Brackets of one line keep their size: grown to the exact height they look loose.
        return _ONE_LINE.sub(r'<mo stretchy="false">(</mo>\1<mo stretchy="false">)</mo>', text)

    def _matrix(self, matrix: sp.MatrixBase) -> str:
        # Brackets as borders: as characters they grow with the matrix in a mathematical font only.
        rows = [
            "<mtr>" + "".join(f"<mtd>{self.row(matrix[i, j])}</mtd>" for j in range(matrix.cols)) + "</mtr>"
            for i in range(matrix.rows)
        ]
        return f'<mtable class="matrix" displaystyle="true">{"".join(rows)}</mtable>'

    def broken(self, expression: sp.Expr, *, sign: str) -> str:
        """A `sign` and the expression, in as many lines as it needs, its parts named below where it is too wide.

        A part that the page has named before stands by its name alone.
        """
        rows, parts = lines(expression, self._named)
        if len(rows) == 1 and not parts:
            return row(sign, self.row(rows[0]))
        made = [row(*([sign] if k == 0 else []), self._line(term, k > 0)) for k, term in enumerate(rows)]
        for symbol, terms in parts:
            head = row("<mtext>where&#160;</mtext>", self.row(symbol), operator("="))
            made += [row(*([head] if k == 0 else []), self._line(term, k > 0)) for k, term in enumerate(terms)]
        cells = "".join(f'<mtr><mtd style="text-align: left">{line}</mtd></mtr>' for line in made)
        return f'<mtable class="broken" columnalign="left" displaystyle="true">{cells}</mtable>'

    def _line(self, terms: sp.Expr, continued: bool) -> str:
        text = self.row(terms)
        # The printer has an order of its own, so that only its text says which term comes first.
        return row(operator("+"), text) if continued and not _NEGATIVE.match(text) else text

    def inline(self, expression: sp.Basic | str) -> Markup:
        """The expression, or MathML already, in a line of text."""
        return Markup(math(expression if isinstance(expression, str) else self.row(expression)))

    def equation(self, left: str, right: sp.Basic | sp.MatrixBase | str) -> str:
        """left = right, where texts are MathML already."""
        return row(left, operator("="), right if isinstance(right, str) else self.row(right))

    def power_series(self, terms: Sequence[sp.Expr], epsilon: sp.Symbol, *, open_end: bool = True) -> str:
        """terms[0] + epsilon terms[1] + ..., without the terms that vanish; + O(epsilon^n) with `open_end`."""
        parts: list[str] = []
        for k, term in enumerate(terms):
            if term == 0:
                continue
            negative = bool(parts) and term.could_extract_minus_sign() and not isinstance(term, sp.Add)
            body = self.row(-term if negative else term)
            if k and (isinstance(term, sp.Add)):
                body = row(operator("("), body, operator(")"))
            if parts:
                parts.append(operator("−" if negative else "+"))
            elif k and term.could_extract_minus_sign():
                parts.append(operator("−"))
                body = self.row(-term)
            unit = abs(term) == 1
            parts.append(body if k == 0 else self._power(epsilon, k) + ("" if unit else body))
        parts = parts or ["<mn>0</mn>"]
        if not open_end:
            return row(*parts)
        remainder = row("<mi>O</mi>", operator("("), self._power(epsilon, len(terms)), operator(")"))
        return row(*parts, operator("+"), remainder)

    def _power(self, epsilon: sp.Symbol, k: int) -> str:
        base = self.row(epsilon)
        return base if k == 1 else f"<msup>{base}<mn>{k}</mn></msup>"


def parts_of_name(name: str) -> tuple[str, str, str]:
    """The letter of a symbol, what stands below it, and what stands above, where no MathML can be: on a canvas.

    >>> parts_of_name("omega_max")
    ('ω', 'max', '')
    """
    # Where letters are missing between underscores, those are part of the name.
    parts: tuple[str, list[str], list[str]] = (
        cast(Any, split_super_sub(name)) if all(name.split("_")) else (name, [], [])
    )
    base, above, below = parts
    return letter(base), " ".join(map(letter, below)), " ".join(map(letter, above))


def math(*parts: str, display: bool = False) -> str:
    """A <math> element of MathML parts, as roomy as on a line of its own with `display`."""
    style = ' displaystyle="true"' if display else ""
    return f"<math{style}>{''.join(parts)}</math>"


def row(*parts: str) -> str:
    """Parts side by side."""
    return f"<mrow>{''.join(parts)}</mrow>"


def operator(text: str) -> str:
    """An operator or a bracket."""
    return f'<mo stretchy="false">{escape(text)}</mo>'


def dotted(symbol: str) -> str:
    """The derivative of a symbol in slow time."""
    # As an accent the dot falls onto the letter where no font for mathematics is installed.
    one, two = (f'<mo mathsize="120%">{dots}</mo></mover>' for dots in _DOTS)
    return symbol.replace(one, two) if symbol.endswith(one) else f"<mover>{symbol}{one}"


def indexed(name: str, below: int, above: str | None = None) -> str:
    """name_below, or name_below^above with a symbol above, for a component of a coefficient."""
    base = f"<mi>{escape(name)}</mi><mn>{below}</mn>"
    return f"<msub>{base}</msub>" if above is None else f"<msubsup>{base}{above}</msubsup>"


def numeral(value: float, digits: int = 6) -> str:
    """A number, with its power of ten written out."""
    mantissa, _, exponent = f"{value:.{digits}g}".replace("-", "−").partition("e")
    if not exponent:
        return f"<mn>{mantissa}</mn>"
    power = f"<msup><mn>10</mn><mn>{exponent.replace('+', '').lstrip('0').replace('−0', '−')}</mn></msup>"
    return power if mantissa == "1" else row(f"<mn>{mantissa}</mn>", operator("×"), power)
