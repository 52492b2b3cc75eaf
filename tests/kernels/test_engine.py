"""Machine code at an address: made once of a text, linked as often as it is asked for."""

from __future__ import annotations

import ctypes

import llvmlite.binding as llvm
import numpy as np
import pytest

from gsp.kernels import engine

POINTER = ctypes.POINTER(ctypes.c_double)
FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def scaled(factor: float) -> str:
    """A module whose f writes exp(`factor` z_0)."""
    return f"""
declare double @exp(double)
define void @f(double %t, double* %z, double* %p, double* %out) {{
entry:
  %x = load double, double* %z
  %y = fmul double %x, {factor:e}
  %e = call double @exp(double %y)
  store double %e, double* %out
  ret void
}}
"""


def value(built: engine.Engine, at: float) -> float:
    z, p, out = np.array([at]), np.empty(1), np.empty(1)
    FUNCTION(built.get_function_address("f"))(0.0, *(a.ctypes.data_as(POINTER) for a in (z, p, out)))
    return float(out[0])


@pytest.fixture
def emitted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The texts that machine code is made of from here on, where none is known."""
    texts, emit = [], engine.emit

    def counted(text: str, *arguments) -> bytes:
        texts.append(text)
        return emit(text, *arguments)

    monkeypatch.setattr(engine, "emit", counted)
    monkeypatch.setattr(engine, "_files", engine.ObjectFiles())
    return texts


def built(factor: float, **options) -> engine.Engine:
    return engine.build(scaled(factor), library=("exp",), **options)


def test_code_of_the_same_text_is_made_once_and_each_engine_has_its_own(emitted) -> None:
    one, again, other = built(2.0), built(2.0), built(3.0)
    assert emitted == [scaled(2.0), scaled(3.0)]
    assert one.get_function_address("f") != again.get_function_address("f")
    del one
    assert [value(each, 0.5) for each in (again, other)] == pytest.approx([np.exp(1.0), np.exp(1.5)], rel=1e-15)


def test_code_for_another_processor_or_of_another_effort_is_made_again(emitted, monkeypatch) -> None:
    built(2.0)
    assert value(built(2.0, scheduled=False), 0.5) == pytest.approx(np.e, rel=1e-15)
    assert len(emitted) == 2
    name, _ = engine.processor()
    another = llvm.get_host_cpu_name() if name == "generic" else "generic"
    monkeypatch.setattr(engine, "processor", lambda: (another, ""))
    built(2.0)
    built(2.0)
    assert len(emitted) == 3


def test_one_machine_writes_all_code_of_an_effort_and_no_engine_keeps_its_tables(emitted, monkeypatch) -> None:
    writers, write = [], llvm.TargetMachine.emit_object

    def counted(machine: llvm.TargetMachine, module: llvm.ModuleRef) -> bytes:
        writers.append(machine)
        return write(machine, module)

    given, create = [], llvm.create_mcjit_compiler
    monkeypatch.setattr(llvm.TargetMachine, "emit_object", counted)
    monkeypatch.setattr(
        llvm, "create_mcjit_compiler", lambda module, machine: given.append(machine) or create(module, machine)
    )
    engines = [built(factor) for factor in (2.0, 3.0, 4.0)]
    assert [value(one, 0.5) for one in engines] == pytest.approx(np.exp([1.0, 1.5, 2.0]), rel=1e-15)
    assert len(writers) == 3
    assert all(writer is writers[0] for writer in writers)
    assert all(machine is not writers[0] for machine in given)


def test_what_was_not_used_for_long_is_forgotten(emitted, monkeypatch) -> None:
    machine_code = engine.ObjectFiles()
    monkeypatch.setattr(engine, "_files", machine_code)
    built(1.0)
    (size,) = map(len, machine_code._known.values())
    monkeypatch.setattr(engine, "MOST_KEPT", 2 * size + size // 2)
    for factor in (2.0, 1.0, 3.0, 1.0, 2.0):
        built(factor)
    # 1 was used after 2, which had to go for 3.
    assert emitted == [scaled(k) for k in (1.0, 2.0, 3.0, 2.0)]


def test_a_module_that_is_wrong_is_refused_each_time(emitted) -> None:
    for _ in range(2):
        with pytest.raises(RuntimeError, match="undefined value"):
            engine.build("define double @f() {\n  ret double %x\n}\n", library=())
    assert len(emitted) == 2
