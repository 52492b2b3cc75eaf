"""The house: a package imports exactly what docs/packages.toml allows, and the page and the picture show that table."""

import ast
import importlib.util
import os
import subprocess
import sys
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
# What knows symbols may not know numba, and what is compiled may not know symbols, but for the two that join them.
JOINING = {"peers"}


def modules() -> list[tuple[str, Path]]:
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts != ("__init__",):
            found.append((parts[0], path))
    return found


def imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in {path.name}"
            module = node.module or ""
            names |= {f"gsp.{alias.name}" for alias in node.names} if module == "gsp" else {module}
    return names - {"gsp", "gsp.__version__"}


def of_package(name: str) -> tuple[set[str], set[str]]:
    """What the modules of a package import of ours and of others, the standard library and numpy apart."""
    ours: set[str] = set()
    others: set[str] = set()
    for package, path in modules():
        for imported in imports(path) if package == name else ():
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


def test_symbols_and_compiled_loops_do_not_meet() -> None:
    for name, package in PACKAGES.items():
        assert name in JOINING or not {"numba", "sympy"} <= set(package["others"]), name


def test_the_page_has_the_table() -> None:
    assert drawing().as_markdown(PACKAGES) in (DOCS / "architecture.md").read_text(encoding="utf-8")


def test_the_picture_was_made_from_the_table() -> None:
    # The remedy: python docs/draw_packages.py
    assert drawing().mark() in (DOCS / "images" / "packages.svg").read_text(encoding="utf-8")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, gsp, gsp.models, gsp.cli; gsp.models.summary();"
        "heavy = {'numpy', 'sympy', 'scipy', 'numba', 'llvmlite', 'matplotlib', 'flint', 'jinja2', 'rich'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_run_of_a_declared_field_imports_nothing_of_series() -> None:
    code = (
        "import sys, sympy, gsp; x = sympy.Symbol('x');"
        "gsp.integrate(gsp.VectorField({x: -x}, epsilon=None), start={'x': 1}, span=(0, 1));"
        "late = {'gsp.slow.series', 'gsp.integration.reduced_flow', 'gsp.integration.reduction_end.endings'};"
        "print(sorted(late & set(sys.modules)))"
    )
    environment = {key: value for key, value in os.environ.items() if key != "EAGER_IMPORT"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.strip() == "[]"


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


def test_no_module_evaluates_text() -> None:
    forbidden = {"eval", "exec", "sympify", "parse_expr", "lambdify", "compile"}
    for _, path in modules():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = node.func
            name = called.id if isinstance(called, ast.Name) else getattr(called, "attr", "")
            own_method = isinstance(called, ast.Attribute) and name == "compile"
            if name == "sympify":
                strict = any(k.arg == "strict" for k in node.keywords)
                assert strict, f"sympify without strict in {path.name}:{node.lineno}"
            elif not own_method:
                assert name not in forbidden, f"{name} in {path.name}:{node.lineno}"


def test_no_public_function_has_the_name_of_a_module() -> None:
    # Importing a submodule binds its name in the package, and would hide the function.
    assert not set(gsp.__all__) & set(PACKAGES) - {"models", "charts", "mechanics", "readers"}
