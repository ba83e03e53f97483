"""Errors of the planner. A failed plan is data; a broken call raises one of these."""

from __future__ import annotations

import os
import struct
import zlib
from typing import Final
from zipfile import BadZipFile


class PlannerError(Exception):
    """Root of everything the planner raises on purpose."""


class InputError(PlannerError):
    """An input that cannot be used.

    Attributes:
        code: Short stable word for programs, for example ``not-adjacent``.
        where: Place in the input ("line 4", "cells 41 and 42"), or None.
        detail: One plain sentence: what was found, what was expected, what to do.
    """

    def __init__(self, code: str, detail: str, *, where: str | None = None) -> None:
        super().__init__(f"{where}: {detail}" if where and where not in detail else detail)
        self.code = code
        self.where = where
        self.detail = detail


def unexpected(code: str, place: str, value: object, expected: str) -> InputError:
    """The error for a value that is not what is expected; a long one is shortened."""
    try:
        text = "nothing" if value is None else value if isinstance(value, str) else repr(value)
    except RecursionError:
        text = "deeply nested values"
    short = text if len(text) <= 40 else f"{text[:39]}…"
    return InputError(code, f"got {short}, expected {expected}.", where=place)


def named(error: InputError, name: str) -> InputError:
    """The error with the name of the file that it is about, if it doesn't tell."""
    if name in str(error):
        return error
    return InputError(error.code, f"{name}: {error.detail}", where=error.where)


def checked_fraction(value: float, name: str) -> float:
    """Return a figure that lies between 0 and 1, so that no other is ever reported.

    Raises:
        ArithmeticError: For any other value: a fault of the product, not of an input.
    """
    if not 0.0 <= value <= 1.0:
        raise ArithmeticError(f"got {value:g} as {name}, expected 0 to 1.")
    return value


class TimelineError(PlannerError):
    """A timeline on disk that is missing, damaged, or used in the wrong order."""


class DamagedError(TimelineError):
    """Stored data that is missing, or is not what was written.

    Attributes:
        path: File that it is about.
        reason: Short sentence without a full stop.
    """

    def __init__(self, path: str | os.PathLike[str], reason: str) -> None:
        super().__init__(f"{os.fspath(path)} is damaged: {reason}; restore it from a copy.")
        self.path = os.fspath(path)
        self.reason = reason


class SimulationError(PlannerError):
    """A simulation that cannot be set up or that left the numbers it can trust."""


UNREADABLE: Final = (
    OSError,
    EOFError,
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    RuntimeError,
    SystemError,
    TypeError,
    ValueError,
    struct.error,
    BadZipFile,
    zlib.error,
)
"""Exceptions that mean, when a stored file is read, that the file is damaged: zip, NumPy, zarr,
blosc and JSON each raise their own."""
