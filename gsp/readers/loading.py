"""A path to a `Scene`: TOML as it stands, and foreign formats by way of the model file that says the same."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gsp.errors import DeclarationError, ModelFileError
from gsp.readers.antimony import read_antimony
from gsp.readers.foreign import ForeignModel, Import, imported
from gsp.readers.sbml import read_sbml
from gsp.readers.toml import BYTES, parsed, read_document, scene_of, text_of
from gsp.readers.xppaut import read_ode
from gsp.scenes.scene import Scene
from gsp.systems.arguments import shown

FORMATS: dict[str, Callable[[str], ForeignModel]] = {
    ".ode": read_ode,
    ".xml": read_sbml,
    ".sbml": read_sbml,
    ".ant": read_antimony,
}
# What a model file says of itself, in no words of its equations.
PROSE = ("name", "title", "source", "description")
# SBML says in markup, units and annotations ten times what a model file says.
LARGEST = {".xml": 4 * 1024 * 1024, ".sbml": 4 * 1024 * 1024}


def load(path: str | os.PathLike[str]) -> Scene:
    """`Scene` from the file at `path`: TOML as `gsp.readers.toml` shows it, or a foreign model.

    Foreign are XPPAUT's `.ode`, SBML (`.xml`, `.sbml`) and Antimony (`.ant`). The name defaults to the file's. Raises
    `ModelFileError`, prefixed with the file's name and the key, for a file that is missing, unreadable, too large,
    malformed, or says something unknown or impossible; nothing is returned half read.

    >>> load("enzyme.toml").epsilon                                               # doctest: +SKIP
    0.01
    """
    return load_noted(path)[0]


def load_noted(path: str | os.PathLike[str]) -> tuple[Scene, list[str]]:
    """What `load` returns, and notes on what was understood of a foreign model, or on what of TOML is not used."""
    file = _path(path, "load")
    try:
        if file.suffix.lower() not in FORMATS:
            document = read_document(file)
            scene = scene_of(document, file)
            unused = _unused(document)
            told = f"nothing in the file uses {', '.join(unused)} of its parameters"
            return scene, [told] if unused else []
        found, scene = _imported(file)
        return scene, found.notes
    except (ModelFileError, DeclarationError) as error:
        # Words of the file stand in the message, and the message may go to a terminal.
        raise ModelFileError.of(error, file.name) from None


def import_model(path: str | os.PathLike[str], *, small: str | None = None) -> Import:
    """The foreign model at `path` as the text of a model file, with notes on it.

    `small` names the parameter that is the small one. Raises `ModelFileError` for what `load` would not take either.
    """
    file = _path(path, "import_model")
    try:
        if file.suffix.lower() not in FORMATS:
            raise ModelFileError(
                f"a foreign model ends in {', '.join(FORMATS)}.",
                "Give such a file.",
                got=f"{file.suffix[:20]!r}",
            )
        found, _ = _imported(file, small)
    except (ModelFileError, DeclarationError) as error:
        raise ModelFileError.of(error, file.name) from None
    return found


def _unused(document: dict) -> list[str]:
    """The parameters that no other entry of a model file mentions, as a key or in a text."""
    texts: list[str] = []
    waiting: list[Any] = [part for key, part in document.items() if key not in ("parameters", *PROSE)]
    waiting += document.get("parameters", {}).values()
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict):
            texts += part
            waiting += part.values()
        elif isinstance(part, list):
            waiting += part
        elif isinstance(part, str):
            texts.append(part)
    words = set(re.findall(r"\w+", " ".join(texts)))
    return [name for name in document.get("parameters", {}) if name not in words]


def _path(path: str | os.PathLike[str], verb: str) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise ModelFileError(f"{verb} takes the path of a file.", got=shown(path), value=path)
    return Path(path)


def _imported(file: Path, small: str | None = None) -> tuple[Import, Scene]:
    suffix = file.suffix.lower()
    if small is not None and suffix == ".ode":
        # Capital letters are small ones for XPPAUT.
        small = small.lower()
    # Comments in .ode files are older than UTF-8.
    model = FORMATS[suffix](text_of(file, other_bytes=suffix == ".ode", most=LARGEST.get(suffix, BYTES)))
    found, scene = imported(model, small=small, read=lambda draft: scene_of(parsed(draft), file))
    if len(found.text.encode()) > BYTES:
        raise ModelFileError(
            f"as a model file it would be larger than {BYTES // 1024} KiB.", "Use a smaller model."
        )
    return found, scene
