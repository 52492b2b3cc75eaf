"""The house: a package imports exactly what docs/packages.toml allows, and the page and the picture show that table."""

import ast
import importlib.util
import os
import subprocess
import sys
from collections.abc import Collection, Container, Mapping
from dataclasses import dataclass
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import gsp

ROOT = Path(gsp.__file__).parent
DOCS = Path(__file__).parent.parent / "docs"


def drawing():
    spec = importlib.util.spec_from_file_location("draw_packages", DOCS / "draw_packages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PACKAGES = drawing().table()


def modules() -> list[tuple[str, Path]]:
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        # What is public, and `python -m gsp`, are no packages.
        if parts not in (("__init__",), ("__main__",)):
            # A package's faces name charts, and lie above all of them: nobody imports them.
            found.append(("faces" if parts[1:] == ("faces",) else parts[0], path))
    return found


@dataclass(frozen=True)
class Module:
    """What the tests ask of one module's syntax: a tree itself takes as much memory as an analysis."""

    imports: frozenset[str]
    forbidden: tuple[str, ...]
    arguments: dict[str, int]
    reached: frozenset[str]
    is_dynamic: bool
    named_numbers: int


@cache
def read(path: Path) -> Module:
    """Parsed once, by whichever test asks first."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(ast.walk(tree))
    return Module(
        imports(nodes),
        tuple(forbidden(nodes)),
        arguments(nodes),
        reached(nodes, NAMES),
        any(map(is_dynamic, nodes)),
        named_numbers(tree),
    )


def is_dynamic(node: ast.AST) -> bool:
    """Whether a module is imported whose name is no string in the source."""
    if not isinstance(node, ast.Call) or not node.args or isinstance(node.args[0], ast.Constant):
        return False
    return getattr(node.func, "attr", getattr(node.func, "id", "")) in {"import_module", "__import__"}


def imports(nodes: list[ast.AST]) -> frozenset[str]:
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import of {node.module}"
            module = node.module or ""
            names |= {f"gsp.{alias.name}" for alias in node.names} if module == "gsp" else {module}
    return frozenset(names - {"gsp", "gsp.__version__"})


def of_package(name: str) -> tuple[set[str], set[str]]:
    """What the modules of a package import of ours and of others, the standard library and numpy apart."""
    ours: set[str] = set()
    others: set[str] = set()
    for package, path in modules():
        for imported in read(path).imports if package == name else ():
            head, *rest = imported.split(".")
            if head == "gsp":
                ours |= {rest[0]} - {name}
            elif head not in sys.stdlib_module_names and head != "numpy":
                others.add(head)
    return ours, others


def test_the_table_has_every_package_and_no_other() -> None:
    assert set(PACKAGES) == {package for package, _ in modules()}


def test_few_modules_lie_outside_the_packages() -> None:
    assert len(list(ROOT.glob("*.py"))) <= 5


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_imports_exactly_what_the_table_says(name: str) -> None:
    ours, others = of_package(name)
    assert ours == set(PACKAGES[name]["ours"]), "of ours"
    assert others == set(PACKAGES[name]["others"]), "of others"


def test_no_package_imports_itself_by_a_circle() -> None:
    list(TopologicalSorter({name: package["ours"] for name, package in PACKAGES.items()}).static_order())


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_of(path): path for path in ROOT.rglob("*.py") if path.parent != ROOT}
# Modules that call `import_module` with what is no name in quotes, and why.
BY_OTHER_MEANS = {
    "gsp.results.registry": "the faces of a noun, by the package of its class",
    "gsp.models": "a model's own module",
    "gsp.results.table": "libraries of others",
    "gsp.sweeps.tasks": "functions of users",
}


def reached(nodes: list[ast.AST], names: Container[str]) -> frozenset[str]:
    """Modules that a module imports, in any function, or names in a string; types alone do not count."""
    typing = {
        id(inner)
        for node in nodes
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and id(node) not in typing:
            within = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in names else str(node.module) for name in within}
    return frozenset(name for name in found if name in names)


def circles(graph: Mapping[str, Collection[str]]) -> list[frozenset[str]]:
    """Strongly connected components of two modules or more."""

    def all_from(start: str) -> frozenset[str]:
        seen, left = set(), [start]
        while left:
            for name in graph[left.pop()]:
                if name not in seen:
                    seen.add(name)
                    left.append(name)
        return frozenset(seen)

    below = {name: all_from(name) for name in graph}
    found = {frozenset(n for n in below[name] if name in below[n]) for name in graph}
    return sorted((circle for circle in found if len(circle) > 1), key=sorted)


def test_no_modules_are_a_circle_whether_by_import_or_by_name() -> None:
    graph = {name: read(path).reached - {name} for name, path in NAMES.items()}
    assert circles(graph) == []


def test_nobody_imports_the_faces_of_a_package() -> None:
    assert [name for name, path in NAMES.items() if any(n.endswith(".faces") for n in read(path).imports)] == []


def test_few_modules_import_by_other_means() -> None:
    found = {name for name, path in NAMES.items() if read(path).is_dynamic}
    assert found == set(BY_OTHER_MEANS)


def test_a_circle_closed_by_a_name_in_a_string_is_found() -> None:
    sources = {"gsp.a.b": "import_module('gsp.c.d')", "gsp.c.d": "def f():\n    from gsp.a import b"}
    graph = {name: reached(list(ast.walk(ast.parse(text))), sources) for name, text in sources.items()}
    assert circles(graph) == [frozenset(sources)]


def test_symbols_and_compiled_loops_do_not_meet() -> None:
    for name, package in PACKAGES.items():
        assert not {"numba", "sympy"} <= set(package["others"]), name


def test_the_page_has_the_table() -> None:
    assert drawing().as_markdown(PACKAGES) in (DOCS / "architecture.md").read_text(encoding="utf-8")


def test_the_picture_was_made_from_the_table() -> None:
    # The remedy: python docs/draw_packages.py
    assert drawing().mark() in (DOCS / "images" / "packages.svg").read_text(encoding="utf-8")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, gsp, gsp.models, gsp.cli; gsp.models.summary(); gsp.models.names();"
        "heavy = {'numpy', 'sympy', 'scipy', 'numba', 'llvmlite', 'matplotlib', 'flint', 'jinja2', 'rich'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_runs_of_declared_fields_import_nothing_of_series() -> None:
    code = (
        "import sys, sympy, gsp; x = sympy.Symbol('x');"
        "stiff, mild = (gsp.VectorField({x: rate}, epsilon=None) for rate in (-1000 * (x - sympy.cos(x)), -x));"
        "gsp.integrate(stiff, start={'x': 2}, span=(0, 3), rtol=1e-6);"
        "gsp.integrate(mild, start={'x': 1}, span=(0, 1));"
        "late = {'gsp.slow.series', 'gsp.integration.reduced_flow', 'gsp.integration.reduction_end.endings'};"
        "print(sorted(late & set(sys.modules)))"
    )
    environment = {key: value for key, value in os.environ.items() if key != "EAGER_IMPORT"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.splitlines() == ["[]"]


@pytest.mark.exhaustive
def test_the_eager_switch_imports_every_public_name() -> None:
    environment = {**os.environ, "EAGER_IMPORT": "1"}
    code = "import gsp; print(all(name in vars(gsp) for name in gsp.__all__))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.strip() == "True"


def test_every_public_name_has_a_docstring() -> None:
    for name in gsp.__all__:
        value = getattr(gsp, name)
        if name != "__version__":
            assert value.__doc__, name


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="slowly"):
        gsp.slowly  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]


FORBIDDEN = {"eval", "exec", "sympify", "parse_expr", "lambdify", "compile"}


def forbidden(nodes: list[ast.AST]) -> list[str]:
    """Calls that evaluate text."""
    found = []
    for node in nodes:
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        name = called.id if isinstance(called, ast.Name) else getattr(called, "attr", "")
        own_method = isinstance(called, ast.Attribute) and name == "compile"
        strict = name == "sympify" and any(k.arg == "strict" for k in node.keywords)
        if name in FORBIDDEN and not own_method and not strict:
            found.append(f"{name} in line {node.lineno}")
    return found


def test_no_module_evaluates_text() -> None:
    assert {path.name: found for _, path in modules() if (found := read(path).forbidden)} == {}


@pytest.mark.parametrize("text", ["eval(a)", "sympy.sympify(a)", "b.parse_expr(a)", "compile(a)"])
def test_an_evaluation_of_text_is_found(text: str) -> None:
    (found,) = forbidden(list(ast.walk(ast.parse(f"a = '1'\n{text}"))))
    assert found.endswith(" in line 2")


def test_a_strict_conversion_and_a_compiler_of_its_own_evaluate_no_text() -> None:
    assert forbidden(list(ast.walk(ast.parse("sympify(a, strict=True); program.compile(a)")))) == []


MOST_ARGUMENTS = 10
# The verb itself, as it is called by users and, in `trajectory_of`, by other verbs.
VERBS = {"integrate", "integrate_many", "trajectory_of"}


def arguments(nodes: list[ast.AST]) -> dict[str, int]:
    """How many arguments each function takes, the most where several have one name."""
    counts: dict[str, int] = {}
    for node in nodes:
        if isinstance(node, ast.FunctionDef):
            count = len(node.args.posonlyargs) + len(node.args.args) + len(node.args.kwonlyargs)
            counts[node.name] = max(count, counts.get(node.name, 0))
    return counts


def test_a_run_is_one_record_and_no_row_of_arguments() -> None:
    long = [
        f"{path.name}:{name}"
        for package, path in modules()
        if package == "integration"
        for name, count in read(path).arguments.items()
        if name not in VERBS and count > MOST_ARGUMENTS
    ]
    assert long == []


def named_numbers(tree: ast.Module) -> int:
    """How many constants of a module are numbers, as A = 1 and A, B = 1, -2.0 are three."""
    count = 0
    for node in tree.body:
        for target in node.targets if isinstance(node, ast.Assign) else ():
            are_many = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            for name, value in zip(target.elts, node.value.elts) if are_many else [(target, node.value)]:
                number = value.operand if isinstance(value, ast.UnaryOp) else value
                is_number = isinstance(number, ast.Constant) and type(number.value) in (int, float)
                count += is_number and isinstance(name, ast.Name) and name.id.strip("_").isupper()
    return count


def test_few_numbers_have_names() -> None:
    """Each is a decision: what the tolerance, rounding or the problem's scale gives is computed from it."""
    assert named_numbers(ast.parse("A, B = 1, -2.0\nC = 3\nD = A\nE = (1, 2)\nlower = 1\nF = True")) == 3
    assert sum(read(path).named_numbers for _, path in modules()) <= 600


def test_no_public_function_has_the_name_of_a_module() -> None:
    # Importing a submodule binds its name in the package, and would hide the function.
    assert not set(gsp.__all__) & set(PACKAGES) - {"models", "charts", "mechanics", "readers"}
