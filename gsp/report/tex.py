"""The page's own markup as LaTeX.

Captions, sentences and formulas are written once, as the markup that `Page` and `captions` return; `tex` turns these
into LaTeX. A text from a model file reaches the file through `escaped` alone, which leaves it no character that TeX
acts on.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from html.parser import HTMLParser

from markupsafe import Markup

from gsp.results.lettering import GREEK


class Tex(str):
    """LaTeX that is ready to be written."""

    __slots__ = ()


def tex(value: object) -> Tex:
    r"""`value` as LaTeX: markup is translated, and any other text is escaped.

    >>> print(tex(Markup("<i>h</i><sub>0</sub> is below 10<sup>−3</sup>")), tex("50%_#1"))
    \(h_{0}\) is below 10\(^{-3}\) 50\%\_\#1
    """
    if isinstance(value, Tex):
        return value
    if not isinstance(value, Markup):
        return Tex(escaped(str(value)))
    tree = _Tree()
    tree.feed(value)
    tree.close()
    # Neighbouring formulas are one: <i>h</i><sub>0</sub>.
    return Tex(_text(tree.root).replace(r"\)\(", ""))


@dataclass(frozen=True)
class _Node:
    tag: str
    attributes: Mapping[str, str | None]
    children: list[_Node | str] = field(default_factory=list)


class _Tree(HTMLParser):
    """The tree of a piece of markup, whose elements are all closed."""

    def __init__(self) -> None:
        super().__init__()
        self.root = _Node("", {})
        self._open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        node = _Node(tag, dict(attrs))
        self._open[-1].children.append(node)
        if tag != "br":
            self._open.append(node)

    def handle_endtag(self, tag: str) -> None:
        self._open.pop()

    def handle_data(self, data: str) -> None:
        self._open[-1].children.append(data)


# -- text --------------------------------------------------------------------------------------------------

_SPECIAL: Mapping[str, str] = {
    "\\": r"\textbackslash{}", "{": r"\textbraceleft{}", "}": r"\textbraceright{}", "$": r"\$", "&": r"\&",
    "#": r"\#", "%": r"\%", "_": r"\_", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}",
    "`": r"\textasciigrave{}",
    # At the head of a row of a table these would be arguments of the row before.
    "[": "{[}", "*": "{*}",
    "\u00a0": "~", "‘": "`", "’": "'", "“": "``", "”": "''", "–": "--", "—": "---", "…": r"\dots{}",
    "°": r"\textdegree{}", "ß": r"\ss{}", "æ": r"\ae{}", "Æ": r"\AE{}", "œ": r"\oe{}", "Œ": r"\OE{}",
    "ø": r"\o{}", "Ø": r"\O{}", "ł": r"\l{}", "Ł": r"\L{}", "ı": r"\i{}",
}  # fmt: skip
# TeX's accents, by what Unicode sets behind a letter.
_ACCENTS = dict(
    zip("\u0300\u0301\u0302\u0303\u0304\u0306\u0307\u0308\u030a\u030b\u030c\u0327\u0328", "`'^~=u.\"rHvck")
)
_SIGNS: Mapping[str, str] = {
    "−": "-", "·": r"\cdot ", "×": r"\times ", "±": r"\pm ", "≤": r"\le ", "≥": r"\ge ", "≠": r"\ne ", "≈": r"\approx ",
    "∈": r"\in ", "∞": r"\infty ", "→": r"\to ", "√": r"\surd ", "µ": r"\mu ", "⌊": r"\lfloor ", "⌋": r"\rfloor ",
    "⌈": r"\lceil ", "⌉": r"\rceil ", "∧": r"\wedge ", "∨": r"\vee ", "✓": r"\checkmark ", "✗": r"\times ",
    **{letter: rf"\{name} " for name, letter in GREEK.items()},
    **{sign: f"^{{{k}}}" for k, sign in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")}, "⁻": "^{-}",
    **{sign: f"_{{{k}}}" for k, sign in enumerate("₀₁₂₃₄₅₆₇₈₉")},
}  # fmt: skip
_LETTER = re.compile(r".[\u0300-\u036f]*", re.DOTALL)
_BLANKS = re.compile(r"[ \t-\r\x1c-\x1f\x85\u2028\u2029]+")


def escaped(text: str) -> str:
    """`text` so that TeX prints it; a character that its common fonts have not stands as U+ and its number."""
    letters = _LETTER.findall(unicodedata.normalize("NFD", _BLANKS.sub(" ", text)))
    # Two hyphens, apostrophes or commas would be set as one character.
    parted = ("{}" if a == b and a in "-'," else "" for a, b in zip(letters, [*letters[1:], " "]))
    return "".join(_letter(letter) + gap for letter, gap in zip(letters, parted))


def _letter(letter: str) -> str:
    """A letter with the marks that stand above or below it."""
    base, marks = letter[0], letter[1:]
    if base.isascii() and base.isalpha() and marks in _ACCENTS:
        return rf"\{_ACCENTS[marks]}{{{base}}}"
    character = unicodedata.normalize("NFC", letter)
    if character in _SPECIAL:
        return _SPECIAL[character]
    if character in _SIGNS:
        return rf"\({_SIGNS[character].strip()}\)"
    if " " <= character <= "~":
        return character
    return "".join(rf"\texttt{{U+{ord(part):04X}}}" for part in character)


_STYLES: Mapping[str, str] = {"b": r"\textbf{%s}", "code": r"\texttt{%s}"}


def _text(node: _Node | str) -> str:
    """A node in running text."""
    if isinstance(node, str):
        return escaped(node)
    if node.tag == "math":
        return rf"\({_maths(node)}\)"
    if node.tag == "i":
        return rf"\({_maths(node)}\)" if len(_plain(node)) == 1 else rf"\emph{{{_inside(node, _text)}}}"
    if node.tag in ("sup", "sub"):
        return rf"\({'^' if node.tag == 'sup' else '_'}{{{_inside(node, _index)}}}\)"
    return _STYLES.get(node.tag, "%s").replace("%s", _inside(node, _text))


def _index(node: _Node | str) -> str:
    """What of running text stands above or below the line."""
    return "".join(map(_sign, node)) if isinstance(node, str) else _inside(node, _index)


def _inside(node: _Node, make: Callable[[_Node | str], str]) -> str:
    return "".join(map(make, node.children))


def _plain(node: _Node | str) -> str:
    return node if isinstance(node, str) else _inside(node, _plain)


# -- mathematics -------------------------------------------------------------------------------------------

_OPERATORS = "sin cos tan sec csc cot sinh cosh tanh coth arcsin arccos arctan exp log ln max min"
_FUNCTIONS = frozenset(_OPERATORS.split())
_HIDDEN = "\u2062"


def _sign(character: str) -> str:
    """One character of a formula."""
    if character in _SIGNS:
        return _SIGNS[character]
    if character.isascii() and (character.isalnum() or character in "+-=<>/.,:;()[]|!?' "):
        return character
    return rf"\text{{{escaped(character)}}}"


def _name(text: str) -> str:
    """An identifier: a letter, a function, or an upright word."""
    if len(text) == 1:
        return _sign(text)
    if text in _FUNCTIONS:
        return rf"\{text} "
    return rf"\mathrm{{{text}}}" if text.isascii() and text.isalnum() else rf"\text{{{escaped(text)}}}"


def _operator(text: str) -> str:
    if text in ("", _HIDDEN, " "):
        return r"\," if text == " " else " "
    if text in "{}":
        return "\\" + text
    return _name(text) if text.isalpha() and text.isascii() else "".join(map(_sign, text))


def _maths(node: _Node | str) -> str:
    """A node in a formula. An element of no other meaning stands for what is in it."""
    if isinstance(node, str):
        return "".join(map(_sign, node.strip()))
    made = _ELEMENTS.get(node.tag)
    return _row(node.children) if made is None else made(node)


def _row(children: Sequence[_Node | str]) -> str:
    """Parts side by side; brackets that grow do so in pairs."""
    if any(isinstance(child, _Node) and child.attributes.get("class") == "cases" for child in children):
        # Cases bring their own brace.
        children = children[1:]
    grows = [_bracket(child) for child in children]
    paired = grows.count("(") == grows.count(")")
    return "".join(
        (r"\left(" if bracket == "(" else r"\right)") if bracket and paired else _maths(child)
        for bracket, child in zip(grows, children)
    )


def _bracket(child: _Node | str) -> str:
    """The bracket that `child` is, where it grows with what it holds."""
    if isinstance(child, str) or child.tag != "mo" or child.attributes.get("stretchy") == "false":
        return ""
    text = _plain(child)
    return text if text in ("(", ")") else ""


def _parts(node: _Node) -> list[str]:
    return [_maths(child) for child in node.children if not isinstance(child, str) or child.strip()]


def _scripted(form: str) -> Callable[[_Node], str]:
    def made(node: _Node) -> str:
        base, *scripts = _parts(node)
        # A base of one letter or one command needs no braces.
        held = base if re.fullmatch(r"[A-Za-z0-9]|\\[A-Za-z]+ ?", base) else f"{{{base}}}"
        return held.rstrip() + form.format(*scripts)

    return made


def _table(node: _Node) -> str:
    """A matrix, or the lines of a long formula."""
    rows = [[_maths(cell) for cell in line.children] for line in node.children if isinstance(line, _Node)]
    if node.attributes.get("class") == "broken":
        # Rows of the display itself, so that a page may end between them.
        return " \\\\\n& \\quad ".join("".join(cells) for cells in rows)
    if node.attributes.get("class") == "cases":
        return r"\begin{cases}" + r" \\ ".join(" & ".join(cells) for cells in rows) + r"\end{cases}"
    return r"\begin{pmatrix}" + r" \\ ".join(" & ".join(cells) for cells in rows) + r"\end{pmatrix}"


def _dotted(node: _Node) -> str:
    """A derivative, which is the only accent of a page; of a letter with an index the letter has the dot."""
    letter = node.children[0]
    base, *below = _parts(letter) if isinstance(letter, _Node) and letter.tag == "msub" else [_maths(letter)]
    command = r"\ddot" if _plain(node.children[1]) == "¨" else r"\dot"
    return rf"{command}{{{base}}}" + "".join(f"_{{{index}}}" for index in below)


_ELEMENTS: Mapping[str, Callable[[_Node], str]] = {
    "mi": lambda node: _name(_plain(node)),
    "mn": lambda node: "".join(map(_sign, _plain(node))),
    "mo": lambda node: _operator(_plain(node)),
    "mtext": lambda node: rf"\text{{{escaped(_plain(node))}}}",
    "mspace": lambda node: r"\,",
    "mfrac": lambda node: r"\frac{{{}}}{{{}}}".format(*_parts(node)),
    "msqrt": lambda node: rf"\sqrt{{{_row(node.children)}}}",
    "mroot": lambda node: r"\sqrt[{1}]{{{0}}}".format(*_parts(node)),
    "menclose": lambda node: rf"\overline{{{_row(node.children)}}}",
    "mover": _dotted,
    "msup": _scripted("^{{{}}}"),
    "msub": _scripted("_{{{}}}"),
    "msubsup": _scripted("_{{{}}}^{{{}}}"),
    "mtable": _table,
}


def display(rows: Sequence[tuple[Markup, Markup]]) -> Tex:
    """Displayed equations, each in two halves that the column is aligned by."""
    lines = (f"{_formula(left)} & {_formula(right)}" for left, right in rows)
    return Tex("\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}")


def _formula(markup: Markup) -> str:
    return tex(markup).removeprefix(r"\(").removesuffix(r"\)")
