"""Kernels: compiled inner loops over arrays and named tuples of arrays.

A kernel is compiled for each combination of argument types that it is called with, which takes up
to some seconds; a written 0 is a type of its own to the compiler, and so is a read-only array.
Kernels therefore call each other with ``ZERO`` and ``ONE``, and callers pass writable, contiguous
arrays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

Levels = NDArray[np.int8]
"""Levels of the hinges of a chain that turns by right angles: −1, 0 or 1 quarter turns each."""

TABLE_FULL: Final = -1
"""Result of a kernel whose table has no room for more."""
ZERO: Final = cast(int, np.int64(0))
"""The number 0 as a 64-bit integer, for arguments and counters of compiled functions. A plain
Python 0 could have another type, for which a second version would be compiled."""
ONE: Final = cast(int, np.int64(1))
"""The number 1 as a 64-bit integer, for arguments and counters of compiled functions. A plain
Python 1 could have another type, for which a second version would be compiled."""

_OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "KERNEL": {"no_cfunc_wrapper": True},
    "INNER": {"no_cfunc_wrapper": True, "no_cpython_wrapper": True},
}

if TYPE_CHECKING:
    KERNEL: dict[str, Any]
    """Options of ``njit`` for a kernel that Python calls. Nothing calls kernels from C."""
    INNER: dict[str, Any]
    """Options of ``njit`` for a kernel that only other kernels call, which saves a quarter of the
    time that compiling takes. A call from Python crashes the process; a test looks for such
    imports."""


def __getattr__(name: str) -> Any:
    """Return options of ``njit``; the first module of kernels that takes them sets up numba.

    This package is imported by processes that compute nothing, and must not import numba itself.
    """
    if name not in _OPTIONS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from foldback.planner.compilation.inner_kernels import leave_inner_kernels_to_callers
    from foldback.planner.compilation.kernel_cache import compare_all_sources, find_cache

    compare_all_sources()
    leave_inner_kernels_to_callers()
    return _OPTIONS[name] | {"cache": find_cache()}
