"""LLVM's intermediate code to machine code at an address, which `call` runs."""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
import threading
from collections import OrderedDict
from collections.abc import Sequence
from functools import cache

import llvmlite.binding as llvm
from numba import config

Engine = llvm.ExecutionEngine
# Code with a longer function is selected instruction by instruction. In one of 2200 lines LLVM's schedules take a
# tenth of a second, in one of 10,000 one to two and a half, of which 0.1 s is left; what was selected so takes up to
# three times as long to run: a few microseconds of a field, and twice the time of every step of twenty states.
LONGEST_SCHEDULED = 4000
# Bytes of object files that are kept to be linked again; that of a small function has one kilobyte.
MOST_KEPT = 2**24


def processor() -> tuple[str, str]:
    """Name and features of the processor that code is for: this one's, unless `NUMBA_CPU_NAME` and `NUMBA_CPU_FEATURES`
    say otherwise, so that kernels and the code that they call are for the same."""
    name, features = config.CPU_NAME, config.CPU_FEATURES  # pyright: ignore[reportAttributeAccessIssue]
    own_name, own_features = _host()
    return own_name if name is None else name, own_features if features is None else features


@cache
def _host() -> tuple[str, str]:
    """Name and features of this processor, which every build asks for."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def effort(text: str) -> int:
    """LLVM's level of code generation for a module."""
    longest = max(function.count("\n") for function in text.split("\ndefine "))
    return 1 if longest <= LONGEST_SCHEDULED else 0


class ObjectFiles:
    """Object files by what they were made of: those last used, `MOST_KEPT` bytes of them."""

    def __init__(self) -> None:
        self._known: OrderedDict[bytes, bytes] = OrderedDict()
        self._size = 0

    def get(self, key: bytes) -> bytes | None:
        """The file of `key`, if it is still there."""
        found = self._known.get(key)
        if found is not None:
            self._known.move_to_end(key)
        return found

    def keep(self, key: bytes, file: bytes) -> None:
        """Keep a file that is not there."""
        self._known[key] = file
        self._size += len(file)
        while self._size > MOST_KEPT:
            self._size -= len(self._known.popitem(last=False)[1])


_files = ObjectFiles()
_building = threading.Lock()


def build(text: str, *, library: Sequence[str], scheduled: bool = True) -> Engine:
    """Machine code of an IR module that may call the functions of the C library named in `library`.

    LLVM's passes are left out: straight-line code in which no value is computed twice is as fast without, and built in
    half the time, long code in a twentieth. Without `scheduled` it is selected instruction by instruction, however
    short: made in two thirds of the time, a long one in a quarter, and up to twice as slow, which 200,000 calls make up
    for.
    Its addresses are good for as long as the engine lives.
    What was built of the same text before is only linked, in a sixth of the time of a small function.
    """
    with _building:
        return _built(text, library, scheduled)


def _built(text: str, library: Sequence[str], scheduled: bool) -> Engine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    for symbol in library:
        if not llvm.address_of_symbol(symbol):
            # Where libm is not among the process's global symbols the linker must be told.
            function = getattr(ctypes.CDLL(ctypes.util.find_library("m")), symbol)
            llvm.add_symbol(symbol, ctypes.cast(function, ctypes.c_void_p).value)
    name, features = processor()
    level = effort(text) if scheduled else 0
    key = hashlib.sha256("\0".join((name, features, str(level), text)).encode()).digest()
    file = _files.get(key)
    if file is None:
        file = emit(text, _emitting(name, features, level))
        _files.keep(key, file)
    # An engine begins with a module, here an empty one that it need not compile; it copies the object file.
    empty = llvm.parse_assembly("", context=llvm.create_context())
    engine = llvm.create_mcjit_compiler(empty, _machine(name, features, level))
    engine.remove_module(empty)
    empty.close()
    engine.add_object_file(llvm.ObjectFileRef.from_data(file))
    engine.finalize_object()
    return engine


def _machine(name: str, features: str, level: int) -> llvm.TargetMachine:
    return llvm.Target.from_default_triple().create_target_machine(
        opt=level, cpu=name, features=features, jit=True, codemodel="jitdefault"
    )


# An engine keeps the machine that it was made with, and one that has written code keeps half a megabyte of tables. So
# code is written by machines that all builds share, and that of an engine writes none.
_emitting = cache(_machine)


def emit(text: str, machine: llvm.TargetMachine) -> bytes:
    """The object file of a module."""
    # In a context of its own: what is unique to a module stays in LLVM's global one for ever.
    module = llvm.parse_assembly(text, context=llvm.create_context())
    try:
        module.triple = llvm.get_process_triple()
        module.verify()
        module.data_layout = str(machine.target_data)
        return machine.emit_object(module)
    finally:
        module.close()
