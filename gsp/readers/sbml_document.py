"""SBML documents of strangers: looked through before libSBML sees them.

A document type declaration, and with it every entity, is refused; so are elements nested too deeply, numbers that a
double does not hold, and packages that change what a model means. The XML declaration is replaced, so that what is
looked through here is what libSBML reads.
"""

from __future__ import annotations

import re
from typing import Any, NoReturn
from xml.parsers import expat

from gsp.errors import ModelFileError
from gsp.readers.expressions import CHARACTERS, DEPTH

ELEMENTS_DEEP = 200
INTEGER = 2**31 - 1

# Packages without which a model says something else, though files mark some of them as not required.
_PACKAGES = {"comp": "submodels", "qual": "a logical model", "multi": "species with parts", "arrays": "arrays"}
_HARMLESS = ("l3v2extendedmath",)
_PACKAGE = re.compile(r"http://www\.sbml\.org/sbml/level3/version\d/([a-z0-9]+)/version\d")
_SBML = re.compile(r"http://www\.sbml\.org/sbml/level(\d)(?:/version(\d))?(?:/core)?")
_MATHML = "http://www.w3.org/1998/Math/MathML"
_DECLARATION = re.compile(r"\s*<\?xml[^>]*\?>")
_NUMBERS = ("value", "size", "volume", "initialAmount", "initialConcentration", "stoichiometry")
_NUMBER = re.compile(r"(?<![A-Za-z0-9_.])(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SIGNED = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NO_VALUES = ("INF", "-INF", "NaN")
_SEPARATOR = "/"


class _Scan:
    """One pass of expat over the text; what it refuses, it raises."""

    def __init__(self) -> None:
        self.parser = expat.ParserCreate("UTF-8", namespace_separator=" ")
        self.parser.StartDoctypeDeclHandler = self.doctype
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.characters
        self.depth = 0
        self.skipped = 0
        # Type, pieces and depth of the number that is open.
        self.number: tuple[str, list[str], int] | None = None
        self.packages: dict[str, bool] = {}
        self.left_out: list[str] = []

    def fail(self, fact: str, remedy: str) -> NoReturn:
        raise ModelFileError(f"line {self.parser.CurrentLineNumber}: {fact}.", remedy)

    def doctype(self, *_: Any) -> None:
        self.fail("a document type declaration is not read, nor any entity", "Remove it.")

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.depth += 1
        if self.depth > ELEMENTS_DEEP:
            self.fail(f"elements are nested more than {ELEMENTS_DEEP} deep", "Simplify the model.")
        space, _, word = name.rpartition(" ")
        if self.depth == 1:
            self.root(space, word, attributes)
        # What notes and annotations hold is no part of the model.
        if self.skipped or (word in ("annotation", "notes") and _SBML.fullmatch(space)):
            self.skipped += 1
            return
        if space == _MATHML and word == "cn":
            kind = attributes.get("type", "real")
            if (
                kind not in ("real", "integer", "e-notation", "rational")
                or attributes.get("base", "10") != "10"
            ):
                self.fail(
                    f"a number of the type {kind[:40]!r} or of a base is not read", "Write it in decimals."
                )
            self.number = kind, [], self.depth
        elif space == _MATHML and word == "sep" and self.number is not None:
            self.number[1].append(_SEPARATOR)
        for key, value in attributes.items() if _SBML.fullmatch(space) else ():
            if key in _NUMBERS and value.strip() not in _NO_VALUES:
                self.check_number(value, whole=False)
            elif key == "formula":
                self.check_formula(value)

    def root(self, space: str, word: str, attributes: dict[str, str]) -> None:
        if word != "sbml" or not _SBML.fullmatch(space):
            self.fail(f"the first element is {word[:40]}, and not sbml of SBML", "Give an SBML file.")
        for key, value in attributes.items():
            uri, _, attribute = key.rpartition(" ")
            found = _PACKAGE.fullmatch(uri)
            if attribute != "required" or not uri:
                continue
            package = found[1] if found else uri[:80]
            if package in _HARMLESS:
                continue
            if value.strip() not in ("false", "0") or package in _PACKAGES:
                what = f" ({_PACKAGES[package]})" if package in _PACKAGES else ""
                self.fail(
                    f"the package {package}{what} changes what the model means, and is not read",
                    "Write the model without it; tools flatten comp.",
                )
            self.left_out.append(f"the package {package}")

    def end(self, _: str) -> None:
        if self.skipped:
            self.skipped -= 1
        elif self.number is not None and self.depth == self.number[2]:
            kind, pieces = self.number[:2]
            self.number = None
            self.check_constant(kind, "".join(pieces))
        self.depth -= 1

    def characters(self, text: str) -> None:
        if self.number is not None and not self.skipped:
            self.number[1].append(text)

    def check_constant(self, kind: str, text: str) -> None:
        parts = [part.strip() for part in text.split(_SEPARATOR)]
        if len(parts) != (2 if kind in ("e-notation", "rational") else 1):
            self.fail(f"the number {text[:40]!r} is not of the type {kind}", "Correct it.")
        if kind == "e-notation":
            self.check_number("e".join(parts), whole=False)
        else:
            for part in parts:
                self.check_number(part, whole=kind != "real")

    def check_number(self, text: str, *, whole: bool) -> None:
        """A finite double that is not rounded to zero, and an integer that 32 bits hold."""
        shown = text.strip()[:40]
        if not _SIGNED.fullmatch(text.strip()):
            self.fail(f"{shown!r} is no number", "Correct it.")
        value = float(text)
        if value - value != 0.0 or (value == 0.0 and re.match(r"[+-]?[0.]*[1-9]", text.strip())):
            self.fail(f"the number {shown} is not one that a double holds", "Rescale the model.")
        if whole and (not re.fullmatch("[+-]?[0-9]+", text.strip()) or abs(value) > INTEGER):
            self.fail(f"{shown} is no integer of 32 bits", "Leave its type out, so that it is a real number.")

    def check_formula(self, text: str) -> None:
        if len(text) > CHARACTERS:
            self.fail(f"a formula has {len(text)} characters; {CHARACTERS} are allowed", "Split it.")
        depth = 0
        for character in text:
            depth += (character == "(") - (character == ")")
            if depth > DEPTH:
                self.fail(f"a formula is nested more than {DEPTH} deep", "Remove parentheses.")
        for number in _NUMBER.findall(text):
            self.check_number(number, whole=False)


def read_document(text: str) -> tuple[Any, list[str]]:
    """libSBML's document of `text`, and the packages that are left out.

    Raises `ModelFileError` for what is refused, for XML that is not well formed, and for what libSBML calls an error.
    """
    libsbml = library()
    declaration = _DECLARATION.match(text)
    body = text[declaration.end() :] if declaration else text
    # The line numbers stay.
    body = '<?xml version="1.0" encoding="UTF-8"?>' + "\n" * text[: len(text) - len(body)].count("\n") + body
    scan = _Scan()
    try:
        scan.parser.Parse(body.encode(), True)
    except expat.ExpatError as error:
        raise ModelFileError(
            f"line {error.lineno}: this is no XML ({expat.ErrorString(error.code)}).", "Give an SBML file."
        ) from None
    document = libsbml.readSBMLFromString(body)
    _refuse_errors(document, libsbml)
    if document.getModel() is None:
        raise ModelFileError("the file holds no model.", "Give an SBML file with one.")
    for check in (
        libsbml.LIBSBML_CAT_UNITS_CONSISTENCY,
        libsbml.LIBSBML_CAT_MODELING_PRACTICE,
        libsbml.LIBSBML_CAT_SBO_CONSISTENCY,
    ):
        document.setConsistencyChecks(check, False)
    document.checkConsistency()
    _refuse_errors(document, libsbml)
    return document, scan.left_out


def _refuse_errors(document: Any, libsbml: Any) -> None:
    for i in range(document.getNumErrors()):
        error = document.getError(i)
        if error.getSeverity() >= libsbml.LIBSBML_SEV_ERROR:
            # What the rule says at length, its reference, and what breaks it here.
            _, reference, here = error.getMessage().partition("Reference:")
            detail = here.partition("\n")[2] if reference else error.getMessage()
            words = " ".join(f"{error.getShortMessage()}: {detail}".split())[:400].rstrip(". ")
            raise ModelFileError(f"line {error.getLine()}: this is no valid SBML: {words}.", "Correct it.")


def library() -> Any:
    """The package libsbml; raises `ModelFileError` with the remedy where it is not installed."""
    try:
        import libsbml  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ModelFileError(
            "SBML is read with python-libsbml, which is not installed.", "Install gsp-toolkit[sbml]."
        ) from None
    return libsbml
