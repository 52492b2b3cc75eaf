"""The decorators of kernels, and the one place that knows numba from within.

numba numbers the files of its cache and keeps the numbers in an index: two processes that compile at the same time can
take one number for different code. Nor does it see that a kernel which another one calls has changed. So files are
named after what they hold here, and carry a stamp of all the sources beside a kernel's. That rests on what numba does
not promise. With a numba that was not tried, or with `GSP_PLAIN_NUMBA` in the environment, kernels are compiled with
`njit(cache=True)` and nothing else.
"""

from __future__ import annotations

import hashlib
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import cfunc, njit

_TRIED = (0, 61), (0, 68)
"""The first and the last numba that the tests were run with."""
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}


class CacheWarning(UserWarning):
    """Compiled kernels cannot be kept on disk, so that every process compiles them again."""


def kernel(function: Callable[..., Any]) -> Any:
    """`function` compiled when first called, with IEEE division and without the lock of the interpreter."""
    try:
        if _Cache is None:
            return njit(cache=True, **_OPTIONS)(function)
        compiled: Any = njit(**_OPTIONS)(function)
        compiled._cache = _Cache(function)
        return compiled
    except (RuntimeError, OSError) as error:
        # numba finds no folder that can be written. Without a cache the same code is compiled again.
        _warn(error)
        return njit(**_OPTIONS)(function)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """A kernel whose code goes into that of its callers, kernels alone, for each number in a call with that number."""
    return njit(forceinline=True, **_OPTIONS)(function)


@cache
def address_of(kernel: Any, signature: Any) -> int:
    """Where the machine code of `kernel` for this signature begins; it is compiled, or read from the cache, if need be.

    The address is good for as long as the process lives.
    """
    if _Cache is None:
        callback: Any = cfunc(signature, cache=True, error_model="numpy")(kernel.py_func)
        _callbacks.append(callback)
        return callback.address
    kernel.compile(signature.args)
    compiled = kernel.get_compile_result(signature)
    assert compiled.signature.return_type == signature.return_type, compiled.signature
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)


# What holds the machine code at an address.
_callbacks: list[Any] = []


@cache
def _stamp(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Names, times and sizes of the sources in a folder: a kernel holds the code of those that it calls."""
    found = ((path.name, path.stat()) for path in sorted(folder.glob("*.py")))
    return tuple((name, about.st_mtime_ns, about.st_size) for name, about in found)


def _warn(error: Exception) -> None:
    """Once in a process: there are dozens of kernels."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(
            f"compiled kernels cannot be kept on disk, so that this process compiles them itself: {error}. "
            "Set NUMBA_CACHE_DIR to a folder that can be written.",
            CacheWarning,
            stacklevel=2,
        )


_warned = False


def _cache_of_named_files() -> Any:
    """A cache with one file for each signature and processor, or None where numba is not known from within."""
    version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    if os.environ.get("GSP_PLAIN_NUMBA") or not _TRIED[0] <= version <= _TRIED[1]:
        return None
    try:
        from numba.core.caching import FunctionCache, IndexDataCacheFile
    except ImportError:
        return None

    class Files(IndexDataCacheFile):
        """Files that are named after what they are for, and need no index."""

        def save(self, key, data):
            self._save_data(self._name(key), (self._version, self._source_stamp, data))

        def load(self, key):
            try:
                version, stamp, data = self._load_data(self._name(key))
            except FileNotFoundError:
                return None
            return data if (version, stamp) == (self._version, self._source_stamp) else None

        def flush(self):
            """Nothing: the file that could not be read is replaced by the next `save`."""

        def _name(self, key):
            digest = hashlib.sha256(repr(key).encode()).hexdigest()[:24]
            return f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"

    class NamedFiles(FunctionCache):
        """What `cache=True` uses, over such files; a cache that fails is left out."""

        def __init__(self, function):
            super().__init__(function)
            impl: Any = self._impl
            stamp = impl.locator.get_source_stamp(), _stamp(Path(function.__code__.co_filename).parent)
            self._cache_file = Files(
                cache_path=self._cache_path, filename_base=impl.filename_base, source_stamp=stamp
            )

        def load_overload(self, sig, target_context):
            try:
                with _interrupt_held():
                    return super().load_overload(sig, target_context)
            except Exception:
                # A file that is cut off or overwritten can raise anything. It is replaced, and only if that fails told.
                return None

        def save_overload(self, sig, data):
            try:
                super().save_overload(sig, data)
            except OSError as error:
                self.disable()
                _warn(error)

    return NamedFiles


@contextmanager
def _interrupt_held() -> Iterator[None]:
    """Ctrl-C waits: in LLVM's callback, which asks for the code of a file, its exception is dropped, and the code with
    it, so that what is called next lies at address 0."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)


_Cache = _cache_of_named_files()
