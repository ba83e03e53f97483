"""Plain values: dataclasses as dictionaries and lists, as JSON files hold them, and back."""

from __future__ import annotations

from typing import Any, TypeVar, cast

import msgspec
import numpy as np
from numpy.typing import DTypeLike, NDArray

T = TypeVar("T")


def from_plain(values: Any, kind: type[T]) -> T:
    """Build a value from plain ones; entries of a dictionary that are no fields are ignored.

    Args:
        values: The plain values.
        kind: Type of the value: a dataclass, or a type of several of them.

    Raises:
        ValueError: A value is missing, or has another type.
    """
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from error


def to_plain(value: Any) -> Any:
    """Return a dataclass as plain values, which ``from_plain`` inverts."""
    return msgspec.to_builtins(value)


def array_from(values: Any, dtype: DTypeLike) -> NDArray[Any]:
    """Build an array from nested lists of numbers.

    Raises:
        ValueError: An entry has another type, or the lists differ in length.
    """
    try:
        return np.asarray(values, dtype=dtype)
    except TypeError as error:
        raise ValueError(str(error)) from error


def plain_lists(values: Any) -> Any:
    """Return plain values with lists for tuples, as JSON files hold them."""
    if isinstance(values, dict):
        return {key: plain_lists(value) for key, value in cast("dict[str, Any]", values).items()}
    if isinstance(values, list | tuple):
        return [plain_lists(value) for value in cast("list[Any]", values)]
    return values
