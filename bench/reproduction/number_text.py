"""Number text: numbers as the page and the document with the paper's experiments show them."""

from __future__ import annotations

import math
from typing import Final

THOUSANDS_SEPARATOR: Final = "\u202f"
"""Narrow no-break space between thousands."""


def whole(number: int) -> str:
    """Return a number with narrow spaces between thousands, which do not break lines."""
    return f"{number:,}".replace(",", THOUSANDS_SEPARATOR)


def seconds(value: float) -> str:
    """Return a simulated time, s."""
    return whole(round(value)) if value >= 100.0 else f"{value:.1f}"


def figure(value: float) -> str:
    """Return a number with two significant digits; rounding errors count as 0."""
    size = abs(value)
    if size < 1e-9:
        return "0"
    if size >= 100.0:
        return whole(round(value)).replace("-", "−")
    digits = max(0, 1 - math.floor(math.log10(size)))
    text = f"{value:.{digits}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")
