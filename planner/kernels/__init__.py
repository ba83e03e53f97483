"""Compiled inner loops. Everything here takes and gives plain arrays.

A kernel is compiled for each combination of argument types that it is called with, which takes up
to some seconds; a written 0 is a type of its own to the compiler, and so is a read-only array.
Kernels therefore call each other with ``ZERO``, and what moves a chain hands over read-only angles.
"""

from __future__ import annotations

from typing import Final, cast

import numpy as np

ZERO: Final = cast(int, np.int64(0))
"""A 0 of the type that kernels hand to each other, so that no second version is compiled."""
