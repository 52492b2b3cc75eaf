"""Deliberate faults: how many of a random sample of one-token changes the tests of a module see.

    python tests/mutation.py gsp/comparison/comparison.py --tests tests/comparison/test_comparison.py --sample 20

Mutants are made of the syntax tree: comparisons, arithmetic and logic swapped, numbers and truth values changed, `if`
negated. Each stands in a copy of the repository, where the tests named run with -x; it is caught when they fail or
take more than `--limit` seconds. The copy keeps numba's cache but that of the kernels when a kernel changes: a kernel
does not see that another one which it calls has changed. That is why no tool that changes files in place, or that
forks within one process, can be used here. What survives is printed; a survivor is either a missing test or no fault
at all (an equivalent program, a message, a limit of patience), which a reader has to judge.
"""

from __future__ import annotations

import argparse
import ast
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
_COMPARE = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not",
    ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_ARITHMETIC = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*", ast.FloorDiv: "*"}


class Mutant(NamedTuple):
    """A piece of the source, by lines and columns (bytes), and what stands in its place."""

    line: int
    begin: int
    end_line: int
    end: int
    text: str


def mutants(tree: ast.AST) -> Iterator[Mutant]:
    """Every mutant of a module but those in annotations and docstrings."""
    for node in ast.walk(tree):
        for child in ast.iter_child_nodes(node):
            if isinstance(node, ast.AnnAssign) and child is node.annotation:
                continue
            found = _mutated(child)
            if found is not None:
                yield Mutant(child.lineno, child.col_offset, child.end_lineno, child.end_col_offset, found)  # pyright: ignore


def _mutated(node: ast.AST) -> str | None:
    """The text of a changed `node`; None where it is not one to change."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in _COMPARE and len(node.ops) == 1:
        return f"({ast.unparse(node.left)} {_COMPARE[type(node.ops[0])]} {ast.unparse(node.comparators[0])})"
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        if isinstance(node.left, (ast.JoinedStr, ast.Constant)) and not _is_number(node.left):
            return None
        return f"({ast.unparse(node.left)} {_ARITHMETIC[type(node.op)]} {ast.unparse(node.right)})"
    if isinstance(node, ast.BoolOp):
        word = " or " if isinstance(node.op, ast.And) else " and "
        return f"({word.join(f'({ast.unparse(value)})' for value in node.values)})"
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return str(not node.value)
    if isinstance(node, ast.Constant) and _is_number(node):
        return f"({node.value!r} + 1)" if isinstance(node.value, int) else f"({node.value!r} * 1.5)"
    if isinstance(node, ast.IfExp):
        return f"({ast.unparse(node.orelse)} if {ast.unparse(node.test)} else {ast.unparse(node.body)})"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return f"({ast.unparse(node.operand)})"
    return None


def _is_number(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, (int, float))
        and not isinstance(node.value, bool)
    )


def applied(source: bytes, mutant: Mutant) -> bytes:
    """The module with one mutant in it."""
    lines = source.splitlines(keepends=True)
    head = b"".join(lines[: mutant.line - 1]) + lines[mutant.line - 1][: mutant.begin]
    tail = lines[mutant.end_line - 1][mutant.end :] + b"".join(lines[mutant.end_line :])
    return head + mutant.text.encode() + tail


def is_caught(copy: Path, tests: list[str], limit: float) -> bool:
    """Whether the tests fail in `copy`, or do not end."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:randomly",
        "-p",
        "no:cacheprovider",
        *tests,
    ]
    try:
        return (
            subprocess.run(command, cwd=copy, capture_output=True, timeout=limit, check=False).returncode != 0
        )
    except subprocess.TimeoutExpired:
        return True


def main() -> None:
    """Measure one module, print what survives and the share that was caught."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module")
    parser.add_argument("--tests", nargs="+", required=True)
    parser.add_argument("--sample", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=float, default=300.0)
    asked = parser.parse_args()
    source = (ROOT / asked.module).read_bytes()
    everything = sorted(set(mutants(ast.parse(source))))
    chosen = random.Random(asked.seed).sample(everything, min(asked.sample, len(everything)))
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch, "copy")
        ignored = shutil.ignore_patterns(".git", "build", "*.egg-info", ".hypothesis")
        shutil.copytree(ROOT, copy, ignore=ignored)
        if "kernels" in asked.module:
            for cached in (copy / "gsp").rglob("*.nb?"):
                cached.unlink()
        if is_caught(copy, asked.tests, asked.limit):
            sys.exit("the tests fail, or do not end, without any mutant")
        caught = 0
        for mutant in chosen:
            (copy / asked.module).write_bytes(applied(source, mutant))
            seen = is_caught(copy, asked.tests, asked.limit)
            caught += seen
            if not seen:
                line = source.splitlines()[mutant.line - 1].decode().strip()
                print(f"survives: {asked.module}:{mutant.line}: {line}  ->  {mutant.text}", flush=True)
            if "kernels" in asked.module:
                for cached in (copy / "gsp").rglob("*.nb?"):
                    cached.unlink()
    print(f"{asked.module}: {caught} of {len(chosen)} caught, of {len(everything)} mutants there are")


if __name__ == "__main__":
    main()
