"""Compiled inner loops. Everything here takes and gives plain arrays.

A kernel is compiled for each combination of argument types that it is called with, which takes up
to some seconds; a written 0 is a type of its own to the compiler, and so is a read-only array.
Kernels therefore call each other with ``ZERO``, and callers pass writable, contiguous arrays.
"""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np

from planner.inner_kernels import leave_inner_kernels_to_callers

leave_inner_kernels_to_callers()

ZERO: Final = cast(int, np.int64(0))
"""A 0 of the type that kernels hand to each other, so that no second version is compiled."""

KERNEL: Final[dict[str, Any]] = {"cache": True, "no_cfunc_wrapper": True}
"""Options of ``njit`` for a kernel that Python calls. Nothing calls kernels from C."""
INNER: Final[dict[str, Any]] = {**KERNEL, "no_cpython_wrapper": True}
"""Options of ``njit`` for a kernel that only other kernels call, which saves a quarter of the time
that compiling takes. A call from Python crashes the process; a test looks for such imports."""
