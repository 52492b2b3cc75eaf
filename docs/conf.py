"""The documentation site: `sphinx-build -W -n docs docs/_build`. Nothing is fetched while it is built."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from docutils import nodes

import gsp
from gsp.demos.page import frame_script
from gsp.results.lettering import in_unicode

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "gsp"
author = copyright = "The gsp developers"
version = release = gsp.__version__
language = "en-GB"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_gallery.gen_gallery"]
exclude_patterns = ["_build", "paper", "images/*.py", "gallery/**/*.ipynb", "gallery/**/*.py"]
default_role = "code"
nitpicky = True
# Types of other packages, and those of ours that are no public names, are not documented here.
nitpick_ignore_regex = [("py:.*", r"(?!gsp\.[a-z]+$).*")]

myst_heading_anchors = 3
# A file of the repository that is no page of the site is handed over as it is.
suppress_warnings = ["config.cache", "myst.xref_missing"]

html_theme = "furo"
html_title = "gsp"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"

sphinx_gallery_conf = {
    "examples_dirs": ["../examples"],
    "gallery_dirs": ["gallery"],
    # Every script is run, and one that fails ends the build.
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "parallel": 2,
    "image_scrapers": ("gallery_figures.keep",),
    "reset_modules": (),
    "capture_repr": (),
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "write_computation_times": False,
    "min_reported_time": 1,
    "within_subsection_order": "FileNameSortKey",
    "subsection_order": [
        f"../examples/{name}"
        for name in ("manifolds", "hyperbolicity", "passage", "runs", "scales", "mechanics")
    ],
    "thumbnail_size": (480, 300),
}

DEMO = re.compile(r"<!-- demo (\w+) -->")
OPEN = re.compile(r"<!-- open (\w+) -->")
CONTENTS = re.compile(r"<!-- contents\n(.*?)-->", re.DOTALL)


def with_demos(app, docname: str, source: list[str]) -> None:
    """A comment `<!-- demo NAME -->`, which nobody sees in the plain page, is the running demo on the site.

    `<!-- open NAME -->` is a link to its page.
    """
    folder = "../" * docname.count("/") + "demos"
    frame = (
        '<iframe class="demo" src="{0}/{1}.html" title="Demo of {1}" loading="lazy" allowfullscreen></iframe>'
    )
    source[0] = DEMO.sub(lambda found: frame.format(folder, found[1]), source[0])
    source[0] = OPEN.sub(lambda found: f' (<a href="{folder}/{found[1]}.html">open it</a>)', source[0])


def with_links(app, docname: str, source: list[str]) -> None:
    """What the plain pages cannot have: the folder of examples as a gallery, and the contents of the site."""
    source[0] = source[0].replace("](../examples)", "](gallery/index.rst)")
    source[0] = CONTENTS.sub(lambda found: contents(found[1]), source[0])


def contents(text: str) -> str:
    """A table of contents for each line "Heading: page page ..."."""
    tables = []
    for line in text.strip().splitlines():
        heading, _, pages = line.partition(": ")
        tables.append(
            "\n".join(["```{toctree}", ":hidden:", f":caption: {heading}", "", *pages.split(), "```"])
        )
    return "\n\n".join(tables)


def write_demos(app, error) -> None:
    """The told demos beside the pages that show them."""
    if error is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir, "demos")
    folder.mkdir(exist_ok=True)
    pages = [HERE / f"{name}.md" for name in app.env.found_docs if (HERE / f"{name}.md").is_file()]
    texts = [page.read_text(encoding="utf-8") for page in pages]
    for name in sorted({found for kind in (DEMO, OPEN) for text in texts for found in kind.findall(text)}):
        gsp.write_demo(gsp.models.load(name), folder / f"{name}.html")


def with_letters(app, doctree) -> None:
    """Formulas in running text, headings and tables with their Greek letters and powers; code stays as it is typed."""
    code = (nodes.literal, nodes.literal_block, nodes.doctest_block, nodes.raw, nodes.comment)
    for text in list(doctree.findall(nodes.Text)):
        above, typed = text.parent, False
        while above is not None and not typed:
            typed, above = isinstance(above, code) or above.tagname == "desc_signature", above.parent
        if not typed:
            text.parent.replace(text, list(raised(in_unicode(str(text)))))


# What stands behind ^ and _: a letter or a number, or brackets with one pair of brackets within, ^(n/(2n - 1)).
BRACKETS = r"\((?:[^()]|\([^()]*\))+\)"
SCRIPTS = re.compile(rf"(?<=[\w)\]|])(\^(?:\w|-\w+|{BRACKETS})(?!\w)|(?<=\b\w)_(?:\w|{BRACKETS})(?!\w))")


def raised(text: str) -> Iterator[nodes.Node]:
    """Text with what stands behind ^ above it, and a letter or brackets behind _ below it, as in A^(k + 1) and z_i."""
    for part in SCRIPTS.split(text):
        kind = {"^": nodes.superscript, "_": nodes.subscript}.get(part[:1]) if len(part) > 1 else None
        yield nodes.Text(part) if kind is None else kind("", part[2:-1] if part[1] == "(" else part[1:])


def as_restructured_text(app, what, name, obj, options, lines: list[str]) -> None:
    """Docstrings are plain text: |x|, x* and h_ mean what they say, outside code and doctests."""
    in_doctest = False
    for i, line in enumerate(lines):
        in_doctest = line.lstrip().startswith(">>>") or (in_doctest and bool(line.strip()))
        if in_doctest:
            continue
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [
            re.sub(r"([|*])|(?<=\w)(_)(?=\W|$)", lambda found: "\\" + found[0], part) for part in parts[::2]
        ]
        lines[i] = "".join(parts)


def setup(app) -> dict[str, bool]:
    app.add_js_file(None, body=frame_script()[0])
    app.connect("source-read", with_demos)
    app.connect("source-read", with_links)
    app.connect("build-finished", write_demos)
    # Before the titles are collected.
    app.connect("doctree-read", with_letters, priority=400)
    app.connect("autodoc-process-docstring", as_restructured_text)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
