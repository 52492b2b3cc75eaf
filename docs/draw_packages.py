"""Draw docs/images/packages.svg from docs/packages.toml with Graphviz: `python docs/draw_packages.py`.

An arrow leads from a package to those that it imports, where no longer way leads there too. `--table` prints the table
of docs/architecture.md instead.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

HERE = Path(__file__).parent
TABLE = HERE / "packages.toml"
PICTURE = HERE / "images" / "packages.svg"


def table() -> dict[str, dict]:
    """The packages by name, each with `holds`, `ours` and `others`."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def mark() -> str:
    """The comment in the picture that tells which table it was made from."""
    return f"<!-- packages.toml {hashlib.sha256(TABLE.read_bytes()).hexdigest()[:16]} -->"


def arrows(packages: dict[str, dict]) -> list[tuple[str, str]]:
    """The imports (importer, imported) that no longer way stands for."""
    below: dict[str, set[str]] = {}
    for name in TopologicalSorter({n: p["ours"] for n, p in packages.items()}).static_order():
        ours = packages[name]["ours"]
        below[name] = set(ours).union(*(below[other] for other in ours))
    return [
        (name, other)
        for name, package in packages.items()
        for other in package["ours"]
        if not any(other in below[third] for third in package["ours"])
    ]


def as_dot(packages: dict[str, dict]) -> str:
    """The graph in Graphviz's language."""
    nodes = [f'  {name} [tooltip="{package["holds"]}"]' for name, package in packages.items()]
    edges = [f"  {upper} -> {lower}" for upper, lower in arrows(packages)]
    style = [
        'node [shape=box style="rounded,filled" fillcolor="#eef3f8" color="#2f5d8a" fontname="sans-serif" fontsize=13]',
        'edge [color="#8a99a8" arrowsize=0.6]',
        "ranksep=0.35 nodesep=0.3",
    ]
    return "\n".join(["digraph {", *style, *nodes, *edges, "}"])


def as_markdown(packages: dict[str, dict]) -> str:
    """The table of docs/architecture.md."""
    lines = ["| package | holds | imports of ours |", "|---|---|---|"]
    for name, package in packages.items():
        ours = ", ".join(f"`{other}`" for other in package["ours"]) or "nothing"
        lines.append(f"| `{name}` | {package['holds']} | {ours} |")
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:] == ["--table"]:
        print(as_markdown(table()))
    else:
        done = subprocess.run(
            ["dot", "-Tsvg"], input=as_dot(table()), capture_output=True, text=True, check=True
        )
        PICTURE.write_text(done.stdout.replace("<svg ", f"{mark()}\n<svg ", 1), encoding="utf-8")
