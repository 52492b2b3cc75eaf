"""The layers of the house: a module imports only from stages before it, and each library has its place."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import gsp

ROOT = Path(gsp.__file__).parent

# In this order; a module may import only from those above it.
LAYERS = [
    "errors",
    "interrupts",
    "attempts",
    "drawn",
    "tables",
    "arguments",
    "flow",
    "region",
    "laurent",
    "declaration",
    "system",
    "kernels",
    "differentiation",
    "functions",
    "instructions",
    "machine_code",
    "remembering",
    "lowering",
    "polynomials",
    "factorisation",
    "ring",
    "power_series",
    "truncation",
    "inversion",
    "integrals",
    "layer",
    "splitting",
    "elimination",
    "branch",
    "critical",
    "normal_forms",
    "continuation",
    "spectrum",
    "sampling",
    "losses",
    "hyperbolicity",
    "singularities",
    "tape",
    "slow_points",
    "slow_track",
    "gauss",
    "orbit_segments",
    "chebyshev",
    "manifold",
    "chart",
    "series",
    "raw",
    "reduced",
    "validity",
    "surface_flow",
    "solvers",
    "integrators",
    "crossings",
    "events",
    "endings",
    "explanations",
    "trajectory",
    "parallel",
    "members",
    "ensemble",
    "periodic",
    "canard_orbits",
    "exponentials",
    "decaying",
    "landing",
    "inner",
    "shadowing",
    "fibres",
    "layers",
    "passage",
    "relaxation",
    "mixed_modes",
    "scene",
    "settings",
    "mechanics",
    "models",
    "readers",
    "placement",
    "comparison",
    "classical_methods",
    "methods",
    "peers",
    "work_runs",
    "work_curves",
    "claims",
    "failures",
    "prediction",
    "outlook",
    "candidates",
    "verdict",
    "choice",
    "pieces",
    "switching",
    "simulation",
    "boundary",
    "analysis",
    "charts",
    "report",
    "cli",
]

# Who may import what, beyond the standard library. A trailing dot means the package and all below it.
LIBRARIES = {
    "numpy": None,
    "sympy": None,
    "flint": {"factorisation", "passage", "polynomials", "ring", "singularities"},
    "numba": {"kernels"},
    "llvmlite": {"kernels", "lowering", "machine_code"},
    "scipy": {"branch", "hyperbolicity", "losses", "passage", "peers", "periodic", "sampling"},
    "matplotlib": {"charts"},
    "mpl_toolkits": {"charts"},
    "jinja2": {"report"},
    "markupsafe": {"report"},
    "click": {"cli"},
    "rich": {"cli"},
    "casadi": {"peers"},
    "diffrax": {"peers"},
    "heyoka": {"peers"},
    "jax": {"peers"},
    "numbalsoda": {"peers"},
    "pydiffsol": {"peers"},
    "sksundae": {"peers"},
}
# Symbols stop here: nothing below may know SymPy, and what knows SymPy may not know numba.
WITHOUT_SYMPY = {"errors", "kernels", "cli"}


def modules() -> list[tuple[str, Path]]:
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts != ("__init__",):
            found.append((parts[0], path))
    return found


def imports(path: Path) -> list[str]:
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in {path.name}"
            names.append(node.module or "")
            if node.module == "gsp":
                names += [f"gsp.{alias.name}" for alias in node.names]
    return names


@pytest.mark.parametrize(("layer", "path"), modules(), ids=lambda value: getattr(value, "stem", value))
def test_a_module_imports_only_from_earlier_layers(layer: str, path: Path) -> None:
    assert layer in LAYERS, f"{layer} has no place in the table of layers"
    for name in imports(path):
        parts = name.split(".")
        if parts[0] != "gsp" or len(parts) < 2 or parts[1] not in LAYERS:
            continue
        other = parts[1]
        assert other == layer or LAYERS.index(other) < LAYERS.index(layer), f"{layer} imports {other}"


@pytest.mark.parametrize(("layer", "path"), modules(), ids=lambda value: getattr(value, "stem", value))
def test_third_party_libraries_are_imported_where_the_table_allows(layer: str, path: Path) -> None:
    for name in imports(path):
        library = name.split(".")[0]
        if library in sys.stdlib_module_names or library == "gsp":
            continue
        assert library in LIBRARIES, f"{layer} imports {library}, which the table does not know"
        allowed = LIBRARIES[library]
        assert allowed is None or layer in allowed, f"{layer} imports {library}"
        assert not (library == "sympy" and layer in WITHOUT_SYMPY), f"{layer} imports sympy"


def test_every_layer_of_the_table_exists() -> None:
    present = {layer for layer, _ in modules()}
    assert set(LAYERS) == present


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
        "print(sorted({'gsp.slow.series', 'gsp.integration.reduced_flow', 'gsp.integration.reduction_end.endings'} & set(sys.modules)))"
    )
    environment = {key: value for key, value in os.environ.items() if key != "GSP_EAGER"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.strip() == "[]"


def test_the_eager_switch_imports_every_public_name() -> None:
    environment = {**os.environ, "GSP_EAGER": "1"}
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
    with pytest.raises(AttributeError, match="no attribute 'slow'"):
        gsp.slow  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]


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
    clashes = set(gsp.__all__) & {layer for layer, _ in modules()} - {
        "models",
        "charts",
        "mechanics",
        "readers",
    }
    assert not clashes
