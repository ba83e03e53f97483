"""Joint error of a request: an angle with its unit, as text."""

from __future__ import annotations

import math
import re
from typing import Final

from foldback.planner.errors import InputError

UNITS_RAD: Final = {"deg": math.radians(1.0), "°": math.radians(1.0), "rad": 1.0}
"""Units of a joint error, in rad."""
RANGE_DEG: Final = (0.001, 10.0)
"""Smallest and largest joint error that can be requested, degrees: an expensive encoder reads
0.001°, and with 10° no chain of a few modules keeps its shape."""
MIN_SIZE: Final = 0.25
"""Smallest module size, in pitches, that is tried for a joint error: smaller modules hardly fill
the shape."""
MAX_CHARS: Final = 20
"""Maximum number of characters of a joint error; longer texts are refused."""
ANGLE_TEXT: Final = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(deg|°|rad)\s*", re.ASCII)
"""Regular expression of a joint error."""


def read_joint_error(text: str) -> float:
    """Return a joint error in rad.

    Args:
        text: A number with a unit, such as ``0.3deg``, ``0.3°`` or ``0.005rad``.

    Raises:
        InputError: ``bad-joint-error``.
    """
    low, high = RANGE_DEG
    if len(text) <= MAX_CHARS and (match := ANGLE_TEXT.fullmatch(text)):
        error_rad = float(match[1]) * UNITS_RAD[match[2]]
        if math.radians(low) <= error_rad <= math.radians(high):
            return error_rad
    raise InputError(
        "bad-joint-error",
        f"got the joint error {text[:MAX_CHARS]!r}, expected an angle from {low:g} to {high:g} "
        "degrees with its unit, deg or rad; write, for example, 0.3deg.",
        where="joint_error",
    )
