"""The decorator of kernels: compiled by numba, and kept on disk where that can be done."""

from __future__ import annotations

import hashlib
import pickle
import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys
from numba.core.types import unliteral


class CacheWarning(UserWarning):
    """Compiled kernels cannot be kept on disk, so that every process compiles them again."""


# Options that numba's types do not know: what only kernels call needs no way in from Python and none from C.
_NO_WAYS_IN: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def kernel(function: Callable[..., Any]) -> Any:
    """`function` compiled when first called, with IEEE division and without the lock of the interpreter."""
    return _kept(njit(error_model="numpy", nogil=True)(function), function)


def is_kept(kernel: Any, arguments: tuple[Any, ...]) -> bool:
    """Whether the machine code of `kernel` for these types of arguments is on disk, or can never be."""
    files = kernel._cache
    return not isinstance(files, _Cache) or files.has(arguments, kernel.targetctx)


def inner_kernel(function: Callable[..., Any]) -> Any:
    """A kernel that kernels alone call: no code is made for calls from Python or by address.

    Called from Python, as by the `py_func` of another kernel, it is interpreted.
    """
    compiled = njit(error_model="numpy", nogil=True, pipeline_class=_InnerCompiler, **_NO_WAYS_IN)(function)
    dispatcher: Any = _kept(compiled, function)
    # Python would call what is compiled at an address where there is nothing.
    dispatcher._insert, dispatcher._compile_for_args = (lambda *_: None), (lambda *_, **__: function)
    return dispatcher


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """A kernel whose code goes into that of its callers, kernels alone, for each number in a call with that number."""
    return njit(error_model="numpy", nogil=True, forceinline=True, **_NO_WAYS_IN)(function)


class _InnerCode(JITCodeLibrary):
    """Code for callers, which take it in and optimise it as a part of theirs.

    To optimise it by itself, and to write it for the machine, would be done for nothing.
    """

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalized = True
        self._finalize_dynamic_globals()
        environments = [
            found.name for found in self._final_module.global_variables if found.linkage == llvm.Linkage.common
        ]
        self._shared_module = self._get_module_for_linking()
        # numba puts the environment of a function where the engine has it.
        text = "\n".join(f'@"{name}" = common global i64 0' for name in environments)
        self._final_module = llvm.parse_assembly(text)
        super()._finalize_final_module()


class _InnerCompiler(Compiler):
    def compile_extra(self, func):
        self.state.library = _InnerCode(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


def _kept(dispatcher: Any, function: Callable[..., Any]) -> Any:
    """The dispatcher with numbers for what they are, and with a cache."""
    # A number in a kernel's call is an integer like any other: numba would compile the callee again for each.
    template = dispatcher.get_call_template
    dispatcher.get_call_template = lambda args, kws: template(tuple(map(unliteral, args)), kws)
    # What `cache=True` does, but that a cache is a convenience: without one the same code is compiled again.
    try:
        dispatcher._cache = _Cache(function)
    except (RuntimeError, OSError) as error:
        # numba finds no folder that can be written.
        _say(error)
    return dispatcher


class _Files(IndexDataCacheFile):
    """One file for each signature and processor, named after both.

    numba numbers its files and keeps the numbers in an index. Two processes that compile at the same time, or two hosts
    that share a home folder, can take the same number for different code, and the index then hands out the wrong one.
    """

    def save(self, key, data):
        self._save_data(self._name(key), (self._version, self._source_stamp, data))

    def load(self, key):
        try:
            version, stamp, data = self._load_data(self._name(key))
        except FileNotFoundError:
            return None
        return data if (version, stamp) == (self._version, self._source_stamp) else None

    def _load_data(self, name):
        data = Path(self._data_path(name)).read_bytes()
        # To read code is to import what it names, and these import SciPy's linear algebra unless they are made ready.
        if b"numba.np.arraymath" in data:
            _ready()
        return pickle.loads(data)

    def flush(self):
        """Nothing: the file that could not be read is replaced by the next `save`."""

    def _name(self, key) -> str:
        return (
            f"{self._index_name.removesuffix('.nbi')}.{hashlib.sha256(repr(key).encode()).hexdigest()[:24]}.nbc"
        )


class _Cache(FunctionCache):
    def __init__(self, function):
        super().__init__(function)
        impl: Any = self._impl
        self._cache_file = _Files(
            cache_path=self._cache_path,
            filename_base=impl.filename_base,
            source_stamp=(impl.locator.get_source_stamp(), _stamp(Path(function.__code__.co_filename).parent)),
        )

    def load_overload(self, sig, target_context):
        # numba's own way makes ready all that typing and lowering need, as long as all else in a process's first solve.
        # Machine code needs the functions for memory alone, and who compiles makes the rest ready.
        rtsys.initialize(target_context)
        try:
            found = self._load_overload(sig, target_context)
        except Exception:
            # A file that is cut off or overwritten can raise anything. It is replaced, and only if that fails told.
            found = None
        if found is None:
            _ready()
        return found

    def has(self, sig, target_context) -> bool:
        try:
            return self._cache_file.load(self._index_key(sig, target_context.codegen())) is not None
        except Exception:
            # As above.
            return False

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self.disable()
            _say(error)


@cache
@global_compiler_lock
def _ready() -> None:
    """Have numba's functions on arrays ready without SciPy's BLAS, which no kernel calls.

    numba imports SciPy's linear algebra to see that it is there. Here it is: the package requires SciPy. Whoever
    multiplies matrices in compiled code still has numba look for it then.
    """
    linalg: Any = import_module("numba.np.linalg")
    look = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = look


@cache
def _stamp(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Names, times and sizes of the sources in a folder: a kernel holds the code of those that it calls."""
    found = ((path.name, path.stat()) for path in sorted(folder.glob("*.py")))
    return tuple((name, about.st_mtime_ns, about.st_size) for name, about in found)


_said = False


def _say(error: Exception) -> None:
    """Once in a process: there are dozens of kernels."""
    global _said
    if not _said:
        _said = True
        warnings.warn(
            f"compiled kernels cannot be kept on disk, so that this process compiles them itself: {error}. "
            "Set NUMBA_CACHE_DIR to a folder that can be written.",
            CacheWarning,
            stacklevel=2,
        )
