"""The decorator of kernels: compiled by numba, and kept on disk where that can be done."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


class CacheWarning(UserWarning):
    """Compiled kernels cannot be kept on disk, so that every process compiles them again."""


def kernel(function: Callable[..., Any]) -> Any:
    """`function` compiled when first called, with IEEE division and without the lock of the interpreter."""
    return _kept(njit(error_model="numpy", nogil=True)(function), function)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """A kernel whose code goes into that of its callers."""
    return _kept(njit(error_model="numpy", nogil=True, forceinline=True)(function), function)


def _kept(dispatcher: Any, function: Callable[..., Any]) -> Any:
    # What `cache=True` does, but that a cache is a convenience: without one the same code is compiled again.
    try:
        dispatcher._cache = _Cache(function)
    except (RuntimeError, OSError) as error:
        # numba finds no folder that can be written.
        _say(error)
    return dispatcher


class _Cache(FunctionCache):
    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:
            # A file that is cut off or overwritten can raise anything. It is replaced, and only if that fails told.
            try:
                self.flush()
            except OSError:
                self.disable()
                _say(error)
            return None

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self.disable()
            _say(error)


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
