"""Deliberate faults: how many of a random sample of one-token changes the tests of a module see.

    python tests/mutation.py gsp/comparison/comparison.py --sample 20
    python tests/mutation.py gsp/kernels/radau.py --tests tests/kernels/test_integrators.py
    python tests/mutation.py --sample 200

The first runs the test file of the module's own name, or else all tests of its package; the second names the tests,
the third samples every module that has a test file of its own name.

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
    """Every mutant of a module but those in annotations, decorators and the words of an error."""
    aside = {id(child) for node in ast.walk(tree) for child in _aside(node)}
    places = [tree]
    while places:
        children = [child for child in ast.iter_child_nodes(places.pop()) if id(child) not in aside]
        places += children
        for child in children:
            found = _mutated(child)
            if found is not None:
                yield Mutant(child.lineno, child.col_offset, child.end_lineno, child.end_col_offset, found)  # pyright: ignore


def _aside(node: ast.AST) -> list[ast.AST | None]:
    """Children of a node in which a change is no fault that a test should see."""
    if isinstance(node, (ast.AnnAssign, ast.arg)):
        return [node.annotation]
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return [*node.decorator_list, *([node.returns] if isinstance(node, ast.FunctionDef) else [])]
    if isinstance(node, ast.Raise):
        return [node.exc, node.cause]
    return []


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
        return f"({node.value!r} + 1)" if isinstance(node.value, int) else f"({node.value!r} * 1.5 + 1e-9)"
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


class Copy:
    """A copy of the repository in which one module at a time is changed."""

    def __init__(self, folder: Path, limit: float) -> None:
        self.folder, self.limit = folder, limit
        self._sources: dict[str, bytes] = {}
        ignored = shutil.ignore_patterns(".git", "build", "*.egg-info", ".hypothesis")
        shutil.copytree(ROOT, folder, ignore=ignored)

    def source(self, module: str) -> bytes:
        """The module as it was when the copy was made: work on the repository goes on meanwhile."""
        return self._sources.setdefault(module, (self.folder / module).read_bytes())

    def survives(self, module: str, mutant: Mutant, tests: list[str]) -> bool:
        """Whether the tests pass with `mutant` in `module`; says where it is when they do."""
        source = self.source(module)
        changed = self.folder / module
        self._forget_kernels(module)
        changed.write_bytes(applied(source, mutant))
        try:
            if is_caught(self.folder, tests, self.limit):
                return False
        finally:
            changed.write_bytes(source)
            self._forget_kernels(module)
        line = source.splitlines()[mutant.line - 1].decode().strip()
        print(f"survives: {module}:{mutant.line}: {line}  ->  {mutant.text}", flush=True)
        return True

    def _forget_kernels(self, module: str) -> None:
        if "kernels" in module:
            for cached in (self.folder / "gsp").rglob("*.nb?"):
                cached.unlink()


def mirrored() -> dict[str, list[str]]:
    """Every module that has a test file of its own name, and that file."""
    found = {}
    for path in sorted((ROOT / "gsp").rglob("*.py")):
        inside = path.relative_to(ROOT / "gsp")
        test = Path("tests", *inside.parts[:-1], f"test_{inside.name}")
        if (ROOT / test).is_file():
            found[str(path.relative_to(ROOT))] = [str(test)]
    return found


def of_package(module: str) -> list[str]:
    """The tests of the nearest package around a module that has any."""
    folders = (Path("tests", *folder.parts[1:]) for folder in Path(module).parents if len(folder.parts) > 1)
    return next(([str(folder)] for folder in folders if (ROOT / folder).is_dir()), [])


def main() -> None:
    """Measure one module, or a sample over all that have a test file; print what survives and the share caught."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module", nargs="?")
    parser.add_argument("--tests", nargs="+")
    parser.add_argument("--sample", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=float, default=300.0)
    asked = parser.parse_args()
    modules = mirrored()
    if asked.module is not None:
        tests = asked.tests or modules.get(asked.module) or of_package(asked.module)
        if not tests:
            parser.error(f"{asked.module} has no tests of its own name or package. Name some with --tests.")
        modules = {asked.module: tests}
    with tempfile.TemporaryDirectory() as scratch:
        copy = Copy(Path(scratch, "copy"), asked.limit)
        everything = [
            (module, mutant)
            for module in modules
            for mutant in sorted(set(mutants(ast.parse(copy.source(module)))))
        ]
        chosen = random.Random(asked.seed).sample(everything, min(asked.sample, len(everything)))
        used = {tuple(modules[module]) for module, _ in chosen}
        if any(is_caught(copy.folder, list(tests), asked.limit) for tests in sorted(used)):
            sys.exit("the tests fail, or do not end, without any mutant")
        caught = 0
        for tried, (module, mutant) in enumerate(chosen, start=1):
            caught += not copy.survives(module, mutant, modules[module])
            print(f"{caught} of {tried} caught, of {len(everything)} mutants there are", flush=True)


if __name__ == "__main__":
    main()
