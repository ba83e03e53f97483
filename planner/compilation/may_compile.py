"""Compiler: whether this process may compile kernels.

A process that answers requests must not: a kernel takes seconds to compile, and all pages would
wait. It calls ``forbid_compiling`` and gets the same numbers, to rounding, from NumPy.
"""

from __future__ import annotations

_forbidden = False


def forbid_compiling() -> None:
    """Have ``may_compile`` return False from now on in this process."""
    global _forbidden
    _forbidden = True


def may_compile() -> bool:
    """Return True unless ``forbid_compiling`` was called in this process."""
    return not _forbidden
