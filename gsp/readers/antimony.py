"""Antimony: text that its own library turns into SBML.

The library runs in a process of its own with bounds on memory and work: a text of a few lines can make it crash, or
write submodels out until memory ends. Files that a text would import are refused, not opened.
"""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from typing import Any

from gsp.errors import ModelFileError
from gsp.readers.expressions import CHARACTERS
from gsp.readers.foreign import ForeignModel
from gsp.readers.limits import at_most
from gsp.readers.sbml import read_sbml

MEMORY = 1 << 30
"""Bytes that the library may have. Processor time has a bound too, for what makes no progress."""
SECONDS = 20
DIGITS = 15
"""Digits of a number that the library writes."""

# What the library calls a model without a name.
_NAMELESS = "__main"
_IMPORT = re.compile(r"\bimport\b", re.IGNORECASE)
# A comment to the end of its line, before which nothing opens or closes a text or a longer comment.
_COMMENT = re.compile(r"""[^"'*]*(?://|\#)[^"'*]*""")
_NUMBER = re.compile(r"(?<![\w.])(\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
# What is no statement, what assigns, and a number with a word behind it.
_UNREAD = re.compile(r"""//[^\n]*|\#[^\n]*|/\*.*?\*/|"[^"]*"|```.*?```|'''.*?'''""", re.DOTALL)
_ASSIGNS = re.compile(r"=(?!>)")
_WITH_WORD = re.compile(rf"((?>{_NUMBER.pattern}))[A-Za-z_]\w*")

_CHILD = f"""
import json, sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
    resource.setrlimit(resource.RLIMIT_CPU, ({SECONDS}, {SECONDS}))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except (ImportError, OSError, ValueError):
    pass
try:
    import antimony
except ImportError:
    sys.exit(3)
answer = {{}}
if antimony.loadAntimonyString(sys.stdin.buffer.read().decode()) < 0:
    try:
        answer["error"] = antimony.getLastError()
    except UnicodeDecodeError:
        # The library cuts what it quotes between the bytes of a letter.
        answer["error"] = "its library takes no names with letters beyond ASCII"
else:
    answer["sbml"] = antimony.getSBMLString(antimony.getMainModuleName())
    answer["warnings"] = [antimony.getWarnings(), antimony.getSBMLWarnings(antimony.getMainModuleName())]
sys.stdout.buffer.write(json.dumps(answer).encode())
"""


def read_antimony(text: str) -> ForeignModel:
    """What the Antimony `text` says; raises `ModelFileError` for what it or the SBML of it may not hold."""
    refuse_imports(text)
    hidden = next((c for c in text if ord(c) < 32 and c not in "\t\n\r"), None)
    if hidden is not None:
        # The library reads no further than a NUL.
        raise ModelFileError(f"the file holds the hidden character U+{ord(hidden):04X}.", "Remove it.")
    longest = max(map(len, re.split(r"[;\n]", text)))
    # The library takes quadratic time in a sum.
    at_most(CHARACTERS, longest, "a statement is", "characters long", "Split it.")
    for found in _NUMBER.finditer(text):
        # The library takes the exponent for a unit.
        if not (0 < float(found[0]) < math.inf) and found[1].strip("0."):
            raise ModelFileError(
                f"no double holds the number {found[0][:60]}.", "Use one from 1e-300 to 1e300."
            )
    for statement in re.split(r"[;\n]", _UNREAD.sub("", text)):
        equals = _ASSIGNS.search(statement)
        if equals and (found := _WITH_WORD.search(statement, equals.end())):
            raise ModelFileError(
                f"the library reads {found[0][:60]} as {found[1]} in a unit of its own.",
                "Write numbers as 0.001 or 1e-3, and a blank before a unit.",
            )
    answer = converted(text)
    model = read_sbml(answer["sbml"], origin="an Antimony file")
    if model.title == _NAMELESS:
        model.title = ""
    long = [number for number in _NUMBER.findall(text) if significant(number) > DIGITS]
    if long:
        model.notes.append(f"Antimony's library rounds numbers to {DIGITS} digits: {', '.join(long)[:200]}")
    warnings = " ".join(" ".join(filter(None, answer["warnings"])).split())
    if warnings:
        model.notes.append(f"Antimony's library says: {warnings[:300]}")
    return model


def refuse_imports(text: str) -> None:
    """Raise `ModelFileError` where the word import stands anywhere but in a comment that is one beyond doubt."""
    for found in _IMPORT.finditer(text):
        begin = max(text.rfind("\n", 0, found.start()), text.rfind("\r", 0, found.start())) + 1
        if not _COMMENT.fullmatch(text, begin, found.start()):
            number = text.count("\n", 0, found.start()) + 1
            raise ModelFileError(
                f"line {number}: import opens another file, which is not read.",
                "Write what it holds into this one.",
            )


def significant(number: str) -> int:
    """Significant digits of a decimal."""
    return len(number.replace(".", "").lstrip("0"))


def converted(text: str) -> dict[str, Any]:
    """SBML of the main model of `text`, its submodels written out, and the library's warnings."""
    # With -P nothing of ours can stand for the library's modules.
    done = subprocess.run(
        [sys.executable, "-P", "-c", _CHILD], input=text.encode(), capture_output=True, check=False
    )
    if done.returncode == 3:
        raise ModelFileError(
            "Antimony is read with its own library, antimony, which is not installed.",
            "Install gsp-toolkit[sbml].",
        )
    try:
        answer = json.loads(done.stdout)
    except ValueError:
        raise ModelFileError(
            "Antimony's library broke down over the file, or took more memory than it may have.",
            "Use a smaller model, or one without submodels.",
        ) from None
    if "error" in answer:
        raise ModelFileError(
            f"this is no Antimony: {' '.join(answer['error'].split())[:400].rstrip('.')}.", "Correct it."
        )
    if not answer["sbml"]:
        raise ModelFileError("the file holds no model.", "Give an Antimony file with one.")
    return answer
