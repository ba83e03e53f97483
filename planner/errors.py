"""Errors of the planner. A failed plan is data; a broken call raises one of these."""

from __future__ import annotations

import os
import struct
import zlib
from typing import Any, Final
from zipfile import BadZipFile


class PlannerError(Exception):
    """Root of everything the planner raises on purpose."""


INDICES: Final = frozenset({"modules", "cells", "angle", "triangle", "node"})
"""Values of an ``InputError`` that number parts of an input, counted from 0: numbers, or lists."""


class InputError(PlannerError):
    """An input that cannot be used.

    Attributes:
        code: Short stable word for programs, for example ``not-adjacent``.
        template: One plain sentence: what was found, what was expected, what to do. If there are
            values, it names them in braces, as in ``str.format``.
        place: Template of the place in the input ("line 4", "cells {cells}"), or None.
        values: Plain JSON values that the templates name; see ``INDICES``.
    """

    def __init__(
        self, code: str, template: str, *, where: str | None = None, **values: Any
    ) -> None:
        self.code = code
        self.template = template
        self.place = where
        self.values = values
        self._message: str | None = None
        super().__init__(located(self.detail, self.where))

    @classmethod
    def reported(
        cls, code: str, detail: str, where: str | None, message: str, values: dict[str, Any]
    ) -> InputError:
        """Return the error that another process reports, whose texts are no templates."""
        error = cls(code, detail, where=where)
        error.values, error._message = values, message
        return error

    @property
    def detail(self) -> str:
        """The sentence; parts of an input count from 0."""
        return self._text(self.template, 0)

    @property
    def where(self) -> str | None:
        """The place in the input, counted from 0, or None."""
        return None if self.place is None else self._text(self.place, 0)

    @property
    def message(self) -> str:
        """The place and the sentence for people; parts of an input count from 1."""
        if self._message is not None:
            return self._message
        place = None if self.place is None else self._text(self.place, 1)
        return located(self._text(self.template, 1), place)

    def changed(self, template: str | None = None, *, where: str | None = None) -> InputError:
        """Return the error with another template, or with another place; the values stay."""
        place = self.place if where is None else where
        values = self.values if self._message is None else {}
        return InputError(self.code, template or self.template, where=place, **values)

    def _text(self, template: str, first: int) -> str:
        """Return a text with the values, whose parts of an input count from ``first``."""
        if not self.values or self._message is not None:
            return template
        return template.format(
            **{
                name: _numbers(value, first) if name in INDICES else value
                for name, value in self.values.items()
            }
        )


def _numbers(value: int | list[int], first: int) -> str:
    """Return one number or several as text, counted from ``first``."""
    numbers = value if isinstance(value, list) else [value]
    return " and ".join(str(number + first) for number in numbers)


def located(text: str, where: str | None) -> str:
    """Return a text that names its place in the input."""
    if not where or where in text or where.replace("_", " ") in text:
        return text
    return f"{where}: {text}"


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
    prefix = name.replace("{", "{{").replace("}", "}}") if error.values else name
    return error.changed(f"{prefix}: {error.template}")


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
    LookupError,
    MemoryError,
    OverflowError,
    RuntimeError,
    ValueError,
    struct.error,
    BadZipFile,
    zlib.error,
)
"""Exceptions that mean, when a stored file is read, that the file is damaged: zip, NumPy and JSON
each raise their own. Others, such as ``TypeError``, are faults of the program: values of a JSON
file are read by ``planner.storage.plain_values``, which checks their types."""
