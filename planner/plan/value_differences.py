"""Differences: where two plain values, or two sets of arrays, are not the same, by name."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final, cast

import numpy as np

SINGLE_PRECISION_ATOL_RAD: Final = 1e-6
"""Maximum difference, in rad, between a plan's joint errors and those in its timeline, which are in
single precision: their rounding below 16 rad."""
RECOMPUTED_RTOL: Final = 1e-3
"""Maximum relative difference between a bound, a margin or a torque of a certificate and the same
one computed again: rounding decides which proof of a search fails first, and linear programs are
solved to such a tolerance (for torques in w·p, too)."""
FIGURES_RTOL: Final = 1e-7
"""Maximum relative difference between a certificate's figures and the same figures computed again
by a verification, to allow for rounding on another processor."""
FIGURES_ATOL: Final = 1e-9
"""Maximum absolute difference between a certificate's figures and the same figures computed again,
in their units. Sums over a thousand modules lose 1e-12, and processors differ in the last digit."""
Differences = Iterator[str]
MAX_VALUE_CHARACTERS: Final = 60
"""Maximum length, in characters, of a value that a message about a difference between two files
quotes; the rest is cut off."""
MISSING: Final = object()
"""Placeholder for a value that only one of two compared files has; messages about the difference
print it as “nothing”."""


def versus_plan(name: str, field: str) -> str:
    """Return the name of a difference between a file and the plan."""
    return f"{name} and plan.npz differ in {field}"


def value_differences(
    actual: Any, expected: Any, name: str, *, rtol: float = 0.0, atol: float = 0.0
) -> Differences:
    """Yield ``name.key[3]: got …, expected …`` for each leaf of plain JSON values that differs.

    Args:
        actual, expected: The values.
        name: Name of the values in messages.
        rtol, atol: Relative and absolute tolerance between numbers that are not integers.
    """
    if isinstance(actual, Mapping) and isinstance(expected, Mapping):
        actual_items, expected_items = (
            cast("dict[str, Any]", actual),
            cast("dict[str, Any]", expected),
        )
        for key in dict.fromkeys((*expected_items, *actual_items)):
            yield from value_differences(
                actual_items.get(key, MISSING),
                expected_items.get(key, MISSING),
                f"{name}.{key}",
                rtol=rtol,
                atol=atol,
            )
    elif isinstance(actual, list | tuple) and isinstance(expected, list | tuple):
        actual_list, expected_list = cast("list[Any]", actual), cast("list[Any]", expected)
        if len(actual_list) != len(expected_list):
            yield f"{name}: got {len(actual_list)} entries, expected {len(expected_list)}"
            return
        for k, (actual_item, expected_item) in enumerate(
            zip(actual_list, expected_list, strict=True)
        ):
            yield from value_differences(
                actual_item, expected_item, f"{name}[{k}]", rtol=rtol, atol=atol
            )
    elif not _same(actual, expected, rtol, atol):
        yield f"{name}: got {_shown(actual)}, expected {_shown(expected)}"


def figure_differences(actual: Any, expected: Any, name: str) -> Differences:
    """Yield the differences of figures from those that were computed again."""
    return value_differences(actual, expected, name, rtol=FIGURES_RTOL, atol=FIGURES_ATOL)


def array_difference(actual: Any, expected: Any, name: str, *, atol: float = 0.0) -> Differences:
    """Yield the first difference between two arrays; NaN equals NaN.

    Args:
        actual, expected: The arrays.
        name: Name of the arrays in the message.
        atol: Absolute tolerance between floating-point numbers.
    """
    actual, expected = np.asarray(actual), np.asarray(expected)
    if actual.shape != expected.shape:
        yield f"{name}: got the shape {actual.shape}, expected {expected.shape}"
        return
    if actual.dtype.kind != "f" or expected.dtype.kind != "f":
        off = actual != expected
    else:
        with np.errstate(invalid="ignore"):
            near = np.abs(actual.astype(np.float64) - expected) <= atol
            off = ~(near | (actual == expected) | (np.isnan(actual) & np.isnan(expected)))
    if np.any(off):
        place = tuple(int(k) for k in np.argwhere(off)[0])
        element = f"[{', '.join(map(str, place))}]" if place else ""
        actual_text, expected_text = _shown(actual[place].item()), _shown(expected[place].item())
        yield f"{name}{element}: got {actual_text}, expected {expected_text}"


def _same(actual: Any, expected: Any, rtol: float, atol: float) -> bool:
    if isinstance(actual, bool) or isinstance(expected, bool):
        return actual is expected
    if isinstance(actual, int | float) and isinstance(expected, int | float):
        if actual != actual or expected != expected:
            return actual != actual and expected != expected
        if isinstance(actual, int) and isinstance(expected, int):
            return actual == expected
        return actual == expected or abs(actual - expected) <= atol + rtol * abs(expected)
    return type(actual) is type(expected) and actual == expected


def _shown(value: Any) -> str:
    if value is MISSING:
        return "nothing"
    text = json.dumps(value, default=str)
    return text if len(text) <= MAX_VALUE_CHARACTERS else f"{text[: MAX_VALUE_CHARACTERS - 1]}…"
