"""The cache of compiled kernels is a convenience: damaged, full or absent, the same numbers come out."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import FunctionCache, IndexDataCacheFile

from gsp.kernels import compilation
from gsp.kernels.compilation import CacheWarning, kernel
from gsp.kernels.engine import processor

KNOWN_FROM_WITHIN = pytest.mark.skipif(compilation._Cache is None, reason="numba's public names alone are used")

SUM = """
import warnings
warnings.simplefilter("always")
import numpy as np
from {package} import all_finite, step_towards
print(all_finite(np.ones(3)), step_towards(2.0, 1.0, 0.7))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Copies of two kernel modules under a package of their own, which compile quickly."""
    root = tmp_path / "kernels_apart"
    root.mkdir()
    here = Path(compilation.__file__).parent
    shutil.copy(here / "compilation.py", root / "compilation.py")
    (root / "__init__.py").write_text(
        "import math\n"
        "from kernels_apart.compilation import kernel\n"
        "@kernel\n"
        "def all_finite(values):\n"
        "    bad = 0\n"
        "    for i in range(values.shape[0]):\n"
        "        bad += 0 if abs(values[i]) < math.inf else 1\n"
        "    return bad == 0\n"
        "@kernel\n"
        "def step_towards(stop, t, h):\n"
        "    return 0.5 * (stop - t) if 2.0 * abs(h) > abs(stop - t) else h\n"
    )
    return root


def numbers(package: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    known = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    return subprocess.run(
        [sys.executable, "-c", SUM.format(package=package.name)],
        env={**known, "PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1", **environment},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.exhaustive
def test_cut_off_files_are_replaced(package: Path) -> None:
    first = numbers(package)
    assert first.stdout == "True 0.5\n", first.stderr
    kept = list(package.rglob("*.nbc"))
    assert len(kept) == 2
    for share in (0.5, 0.0):
        sizes = {path: path.stat().st_size for path in kept}
        for path in kept:
            os.truncate(path, int(share * sizes[path]))
        again = numbers(package)
        assert again.stdout == first.stdout, again.stderr
        assert again.stderr == ""
        assert all(path.stat().st_size == size for path, size in sizes.items())


@KNOWN_FROM_WITHIN
def test_processes_that_compile_at_once_never_share_a_file(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package))
    files = [compilation._Cache(compilation._warn)._cache_file for _ in range(2)]
    waiting = {"float64": "code for doubles", "int64": "code for integers"}
    with monkeypatch.context() as at_once:
        # Neither has seen the other's, so that numba's index gives both the first free number.
        at_once.setattr(IndexDataCacheFile, "_load_index", lambda self: {})
        for file, (signature, code) in zip(files, waiting.items()):
            file.save((signature, "a processor"), code)
    for file in files:
        assert [file.load((signature, "a processor")) for signature in waiting] == list(waiting.values())
        assert file.load(("float64", "another processor")) is None


@pytest.mark.exhaustive
@KNOWN_FROM_WITHIN
def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(package: Path) -> None:
    (package / "inner.py").write_text(
        "from kernels_apart.compilation import kernel\n@kernel\ndef factor(x):\n    return 2.0 * x\n"
    )
    (package / "outer.py").write_text(
        "from kernels_apart.compilation import kernel\nfrom kernels_apart.inner import factor\n"
        "@kernel\ndef doubled(x):\n    return factor(x)\n"
    )
    run = [sys.executable, "-c", "from kernels_apart.outer import doubled; print(doubled(1.0))"]
    environment = {**os.environ, "PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    for text, value in (("2.0 * x", "2.0"), ("3.0 * x ", "3.0")):
        source = (package / "inner.py").read_text().replace("2.0 * x", text)
        (package / "inner.py").write_text(source)
        found = subprocess.run(run, env=environment, capture_output=True, text=True, timeout=300, check=False)
        assert found.stdout.strip() == value, found.stderr


@pytest.mark.exhaustive
def test_without_a_folder_for_it_the_cache_is_left_out_and_that_is_said_once(
    package: Path, tmp_path: Path
) -> None:
    # A file where a folder should be stands for every folder that cannot be made, for root as for anybody.
    (package / "__pycache__").write_text("")
    (tmp_path / "home").write_text("")
    environment = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home")}
    found = numbers(package, **environment)
    assert found.stdout == "True 0.5\n", found.stderr
    assert found.stderr.count("CacheWarning") == 1
    assert "Set NUMBA_CACHE_DIR" in found.stderr


@KNOWN_FROM_WITHIN
def test_a_full_disk_costs_the_cache_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FunctionCache, "save_overload", full)
    monkeypatch.setattr(compilation, "_warned", False)

    def half(x):
        return 0.5 * x

    def third(x):
        return x / 3.0

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert kernel(half)(3.0) == 1.5
        assert kernel(third)(3.0) == 1.0
    assert [w.category for w in told] == [CacheWarning]
    assert "No space left on device" in str(told[0].message)


@KNOWN_FROM_WITHIN
@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_waits_until_the_code_of_a_kernel_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """In LLVM's callback its exception was dropped, and the code with it: the next call went to address 0."""
    loaded = []

    def load(self, signature, context):
        signal.raise_signal(signal.SIGINT)
        loaded.append(signature)

    monkeypatch.setattr(FunctionCache, "load_overload", load)
    before = signal.getsignal(signal.SIGINT)
    files = compilation._Cache.__new__(compilation._Cache)
    with pytest.raises(KeyboardInterrupt):
        files.load_overload("code", None)
    assert loaded == ["code"]
    assert signal.getsignal(signal.SIGINT) is before


def test_code_for_a_flow_is_for_the_processor_that_kernels_are_for(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.core import config
    from numba.core.registry import cpu_target

    monkeypatch.setattr(config, "CPU_NAME", None)
    monkeypatch.setattr(config, "CPU_FEATURES", None)
    codegen = cpu_target.target_context.codegen()
    assert processor() == (codegen._get_host_cpu_name(), codegen._get_host_cpu_features())
    monkeypatch.setattr(config, "CPU_NAME", "generic")
    monkeypatch.setattr(config, "CPU_FEATURES", "")
    assert processor() == ("generic", "")


@pytest.mark.exhaustive
def test_a_flow_runs_on_a_generic_processor() -> None:
    text = (
        "import sympy as sp; from gsp.lowering.compiled_flow import compile_function\n"
        "x = sp.Symbol('x')\n"
        "f = compile_function([x**2 + sp.sin(x)], arguments=[x], epsilon=None, parameters=[])\n"
        "print(repr(float(f([2.0], [float('nan')])[0])))"
    )
    environment = {**os.environ, "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    found = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert float(found.stdout) == pytest.approx(4 + np.sin(2), rel=1e-15), found.stderr


def compiled_by(call: str, folder: Path) -> set[str]:
    """The kernels, `module.function`, that a process without a cache compiles for one call on van der Pol's field."""
    text = (
        "from numba.core import event\n"
        "class Names(event.Listener):\n"
        "    def on_start(self, event):\n"
        "        kernel = event.data['dispatcher'].py_func\n"
        "        print(f'{kernel.__module__}.{kernel.__name__}')\n"
        "    def on_end(self, event): pass\n"
        "event.register('numba:compile', Names())\n"
        "import gsp, numpy as np, sympy as sp\n"
        "x, y = sp.symbols('x y')\n"
        "field = gsp.VectorField({x: y, y: (1 - x**2) * y - x}, epsilon=None)\n"
        f"{call}\n"
    )
    # LLVM takes a quarter of the time, and has no say in what is compiled.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "NUMBA_OPT": "0"}
    found = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True, timeout=300, check=True
    )
    return {name.removeprefix("gsp.kernels.") for name in found.stdout.split() if name.startswith("gsp.")}


@pytest.mark.exhaustive
def test_times_of_an_explicit_run_compile_no_linear_algebra(tmp_path: Path) -> None:
    call = "gsp.integrate(field, start={x: 2, y: 0}, span=(0, 3), method='dop853', at=np.linspace(0, 3, 99))"
    compiled = compiled_by(call, tmp_path)
    assert {"grid.read_grid", "corrections.correct_grid", "corrections._worst"} <= compiled
    assert not any(name.startswith(("linear", "sparse")) for name in compiled)


@pytest.mark.exhaustive
def test_a_solve_compiles_what_it_runs_and_nothing_else(tmp_path: Path) -> None:
    compiled = compiled_by("gsp.integrate(field, start={x: 2, y: 0}, span=(0, 3), method='radau9')", tmp_path)
    # That a Jacobian is dense is read off the pattern; nothing is done with one.
    assert {name for name in compiled if name.startswith("sparse")} == {"sparse_systems.pattern_of"}
    assert {name.partition(".")[0] for name in compiled} == {
        "launch", "radau", "radau_block", "radau_iteration", "sparse_systems", "step_control",
    }  # fmt: skip


@pytest.mark.exhaustive
def test_orbits_by_collocation_compile_their_linear_system_alone(tmp_path: Path) -> None:
    call = (
        "from gsp.collocation.bordered import Conditions, FlowEquations, linearise\n"
        "from gsp.collocation.gauss import gauss\n"
        "from gsp.lowering.compiled_function import compile_function\n"
        "made = [compile_function(of, arguments=(x, y), epsilon=None, parameters=())\n"
        "        for of in ([y, -x], [0, 1, -1, 0])]\n"
        "equations = FlowEquations(made[0].address, made[1].address, 0, 1)\n"
        "states, stages = np.ones((4, 2)), np.ones((3, 2, 2))\n"
        "first = linearise(equations, gauss(2), np.zeros(1), 1.0, np.ones(3) / 3, states, stages)\n"
        "first.solve(Conditions(np.eye(3, 2), np.eye(3, 2)[::-1], np.eye(3, 1), np.ones(3)))"
    )
    assert compiled_by(call, tmp_path) == {
        "bordered_collocation.condense", "bordered_collocation.border",
        "linear_algebra.factorise", "linear_algebra.solve",
    }  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("plain", ["", "1"])
def test_with_and_without_its_own_cache_the_package_solves_and_leaves_the_process_as_it_was(
    plain: str, tmp_path: Path
) -> None:
    text = (
        "import gc, sys, numba, numba.np.linalg, llvmlite.binding\n"
        "modules = [m for name, m in sys.modules.items() if name.split('.')[0] in ('numba', 'llvmlite')]\n"
        "before = gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()\n"
        "held = [(m, name, of) for m in modules for name, of in vars(m).items()\n"
        "        if callable(of) and getattr(of, '__module__', '') == m.__name__]\n"
        "inside = [(c, name, of) for _, _, c in held if isinstance(c, type)\n"
        "          for name, of in vars(c).items() if callable(of)]\n"
        "import gsp, sympy as sp\n"
        "from gsp.kernels.compilation import _Cache\n"
        "x = sp.Symbol('x')\n"
        "field = gsp.VectorField({x: -1000 * (x - sp.cos(x))}, epsilon=None)\n"
        "run = gsp.integrate(field, start={x: 2}, span=(0, 3), rtol=1e-6)\n"
        "assert (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()) == before\n"
        "changed = [name for owner, name, of in held + inside if vars(owner).get(name) is not of]\n"
        "print(_Cache is None, round(float(run['x'][-1]), 5), changed)"
    )
    environment = {**os.environ, "GSP_PLAIN_NUMBA": plain}
    found = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert found.stdout.strip() == f"{bool(plain)} 0.73909 []", found.stderr


@KNOWN_FROM_WITHIN
def test_a_numba_that_was_not_tried_is_used_by_its_public_names_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    assert compilation._cache_of_named_files() is not None
    monkeypatch.setattr(numba, "__version__", "0.99.0")
    assert compilation._cache_of_named_files() is None
