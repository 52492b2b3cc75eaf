"""The page of a demo: one HTML file that holds the model's program, its data, and the scripts that run and draw it.

Nothing of a model stands in code: names and texts are JSON data, escaped so that no end of a script can stand in them.
The policy in the page's head lets run this script and this style only, and fetches nothing.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gsp.demos import rodas5p_tableau
from gsp.demos.program import PageProgram
from gsp.errors import printable

# In the order in which they stand on the page: each uses those before.
SCRIPTS = (
    "functions.js",
    "integrator.js",
    "eigenvalues.js",
    "reduction.js",
    "state.js",
    "views.js",
    "pictures.js",
    "body.js",
    "scales.js",
    "work.js",
    "controls.js",
    "notes.js",
    "save.js",
    "page.js",
)
STYLE = "page.css"


def rodas5p() -> dict[str, Any]:
    """The coefficients of Rodas5P as the page's integrator takes them."""
    return {
        "gamma": rodas5p_tableau.GAMMA,
        "A": rodas5p_tableau.A.tolist(),
        "C": rodas5p_tableau.C.tolist(),
        "dense": rodas5p_tableau.DENSE.tolist(),
    }


def source(name: str) -> str:
    """The text of a script or style of the page."""
    return files("gsp.demos").joinpath("page", name).read_text(encoding="utf-8")


def render(program: PageProgram, data: Mapping[str, Any], *, title: str) -> tuple[str, str]:
    """The page as self-contained HTML, and the hash by which a policy lets its script run.

    `data` is what the scripts read beside the program.
    """
    script = "\n".join(['"use strict";', program.code, *(source(name) for name in SCRIPTS)])
    style = source(STYLE)
    environment = Environment(
        loader=PackageLoader("gsp.demos", "page"), autoescape=True, undefined=StrictUndefined
    )
    page = environment.get_template("page.html").render(
        title=printable(title),
        script=Markup(script),
        style=Markup(style),
        script_hash=_hash(script),
        style_hash=_hash(style),
        data=Markup(embedded({**data, "model": program.parts, "rodas5p": rodas5p()})),
    )
    return page, _hash(script)


def frame_script() -> tuple[str, str]:
    """The script of a page with demos in frames, which makes each as high as its demo, and its hash for a policy."""
    script = source("frame.js")
    return script, _hash(script)


def embedded(data: Any) -> str:
    """JSON that may stand inside a script element: without the characters with which HTML or JavaScript begins anew."""
    text = json.dumps(data, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
