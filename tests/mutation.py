"""Deliberate faults: how many of a random sample of one-token changes the tests of a module see.

    python tests/mutation.py gsp/comparison/comparison.py --sample 20
    python tests/mutation.py gsp/readers --sample 40 --seed 7
    python tests/mutation.py gsp/kernels/radau.py --tests tests/kernels/test_integrators.py

The tests are those of the package with its long lists, or those named. They run once under coverage, which says which
of them reach which lines. Mutants are made of the syntax tree: comparisons, arithmetic and logic swapped, numbers and
truth values changed, the two values of a conditional expression exchanged. Each stands in a copy of the repository,
where first the tests that reach its lines run, the quickest first, then all of them: what is compiled, or runs in
another process, no coverage sees. It is caught when a test fails, or they take several times as long as without it.

Every run is a new process in the copy, which keeps numba's cache but that of the kernels when a kernel changes: a
kernel does not see that another one which it calls has changed. That is why no tool that changes files in place, or
that forks within one process, can be used here. What survives is printed, with the number of tests that reach it; a
survivor is either a missing test or no fault at all (an equivalent program, a message, a limit of patience), which a
reader has to judge.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from coverage import CoverageData

ROOT = Path(__file__).resolve().parent.parent
_COMPARE = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not",
    ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_ARITHMETIC = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*", ast.FloorDiv: "*"}
# Tests have ended badly when they take as many times their own time, after so many seconds to begin.
PATIENCE, STARTING = 5, 120
PYTEST = ("-m", "pytest", "-m", "", "-n", "0", "--dist", "no", "-p", "no:randomly", "-p", "no:cacheprovider")


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
        return f"({_operand(node.left)} {_COMPARE[type(node.ops[0])]} {_operand(node.comparators[0])})"
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        if isinstance(node.left, (ast.JoinedStr, ast.Constant)) and not _is_number(node.left):
            return None
        return f"({_operand(node.left)} {_ARITHMETIC[type(node.op)]} {_operand(node.right)})"
    if isinstance(node, ast.BoolOp):
        word = " or " if isinstance(node.op, ast.And) else " and "
        return f"({word.join(map(_operand, node.values))})"
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return str(not node.value)
    if isinstance(node, ast.Constant) and _is_number(node):
        return f"({node.value!r} + 1)" if isinstance(node.value, int) else f"({node.value!r} * 1.5 + 1e-9)"
    if isinstance(node, ast.IfExp):
        return f"({_operand(node.orelse)} if {_operand(node.test)} else {_operand(node.body)})"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return f"({ast.unparse(node.operand)})"
    return None


def _operand(node: ast.expr) -> str:
    """The text of an operand, in parentheses where another operator beside it might bind what is in it."""
    text = ast.unparse(node)
    return (
        text
        if isinstance(node, (ast.Name, ast.Constant, ast.Attribute, ast.Call, ast.Subscript))
        else f"({text})"
    )


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


def run(copy: Path, arguments: list[str], limit: float | None = None) -> subprocess.CompletedProcess[str]:
    """pytest in `copy`, in one process and always in the same order."""
    command = [sys.executable, *PYTEST, *arguments]
    return subprocess.run(command, cwd=copy, capture_output=True, text=True, timeout=limit, check=False)


class Reach:
    """Which of `tests` run which lines, and how long each takes, from one run of them without any mutant."""

    def __init__(self, copy: Path, tests: list[str]) -> None:
        done = run(
            copy,
            ["--durations=0", "--durations-min=0", "--cov=gsp", "--cov-context=test", "--cov-report=", *tests],
        )
        if done.returncode:
            sys.exit(f"the tests fail without any mutant:\n{(done.stdout + done.stderr)[-2000:]}")
        timed = re.findall(r"^([\d.]+)s call +(.+?)$", done.stdout, re.MULTILINE)
        self.seconds = {test: float(seconds) for seconds, test in timed}
        self.asked, self._copy, self._data = tests, copy, CoverageData(str(copy / ".coverage"))
        self._data.read()

    def tests(self, module: str, mutant: Mutant) -> list[str]:
        """The tests that run the lines of `mutant`, the quickest first; of a line run on import, of its module."""
        lines = self._data.contexts_by_lineno(str(self._copy / module))
        there = {context for k in range(mutant.line, mutant.end_line + 1) for context in lines.get(k, [])}
        contexts = there - {""} or {context for found in lines.values() for context in found} - {""}
        found = set()
        for test, _, phase in (context.rpartition("|") for context in contexts):
            # What one test sets up may serve all of its file.
            file = test.partition("::")[0] + "::"
            found |= {test} if phase == "run" else {other for other in self.seconds if other.startswith(file)}
        return sorted(found & set(self.seconds), key=lambda test: (self.seconds[test], test))

    def limit(self, tests: list[str]) -> float:
        """Seconds after which `tests` are taken not to end."""
        known = [self.seconds[test] for test in tests if test in self.seconds]
        return STARTING + PATIENCE * sum(known if tests is not self.asked else self.seconds.values())


class Copy:
    """A copy of the repository in which one module at a time is changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sources: dict[str, bytes] = {}
        ignored = shutil.ignore_patterns(".git", "build", "*.egg-info", ".hypothesis")
        shutil.copytree(ROOT, folder, ignore=ignored)

    def source(self, module: str) -> bytes:
        """The module as it was when the copy was made: work on the repository goes on meanwhile."""
        return self._sources.setdefault(module, (self.folder / module).read_bytes())

    def survives(self, module: str, mutant: Mutant, reach: Reach) -> bool:
        """Whether the tests pass with `mutant` in `module`; says where it is when they do."""
        source = self.source(module)
        changed = self.folder / module
        self._forget_kernels(module)
        changed.write_bytes(applied(source, mutant))
        try:
            near = reach.tests(module, mutant)
            if any(self._is_caught(tests, reach.limit(tests)) for tests in (near, reach.asked) if tests):
                return False
        finally:
            changed.write_bytes(source)
            self._forget_kernels(module)
        line = source.splitlines()[mutant.line - 1].decode().strip()
        print(f"survives {len(near)} near: {module}:{mutant.line}: {line}  ->  {mutant.text}", flush=True)
        return True

    def _is_caught(self, tests: list[str], limit: float) -> bool:
        try:
            return run(self.folder, ["-x", *tests], limit).returncode != 0
        except subprocess.TimeoutExpired:
            return True

    def _forget_kernels(self, module: str) -> None:
        if "kernels" in module:
            for cached in (self.folder / "gsp").rglob("*.nb?"):
                cached.unlink()


def tests_of(place: str) -> list[str]:
    """The tests of the nearest package around a module or a package that has any."""
    inside = Path("tests", *Path(place).parts[1:])
    return next(([str(folder)] for folder in (inside, *inside.parents[:-1]) if (ROOT / folder).is_dir()), [])


def main() -> None:
    """Measure a module or a package; print what survives and the share caught."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("place", help="a module or a package, as gsp/readers")
    parser.add_argument("--tests", nargs="+")
    parser.add_argument("--sample", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    place = ROOT / asked.place
    if not place.exists():
        parser.error(f"there is no {asked.place}. Name a module or a package by its path.")
    modules = [str(path.relative_to(ROOT)) for path in (sorted(place.rglob("*.py")) or [place])]
    with tempfile.TemporaryDirectory() as scratch:
        copy = Copy(Path(scratch, "copy"))
        everything = [
            (module, mutant)
            for module in modules
            for mutant in sorted(set(mutants(ast.parse(copy.source(module)))))
        ]
        chosen = random.Random(asked.seed).sample(everything, min(asked.sample, len(everything)))
        reach = Reach(copy.folder, asked.tests or tests_of(asked.place))
        caught = 0
        for tried, (module, mutant) in enumerate(chosen, start=1):
            caught += not copy.survives(module, mutant, reach)
            print(f"{caught} of {tried} caught, of {len(everything)} mutants there are", flush=True)


if __name__ == "__main__":
    main()
