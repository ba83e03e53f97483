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
    got: Any, expected: Any, name: str, *, rtol: float = 0.0, atol: float = 0.0
) -> Differences:
    """Yield ``name.key[3]: got …, expected …`` for each leaf of plain JSON values that differs.

    Args:
        got, expected: The values.
        name: Name of the values in messages.
        rtol, atol: Relative and absolute tolerance between numbers that are not integers.
    """
    if isinstance(got, Mapping) and isinstance(expected, Mapping):
        mine, theirs = cast("dict[str, Any]", got), cast("dict[str, Any]", expected)
        for key in dict.fromkeys((*theirs, *mine)):
            yield from value_differences(
                mine.get(key, MISSING),
                theirs.get(key, MISSING),
                f"{name}.{key}",
                rtol=rtol,
                atol=atol,
            )
    elif isinstance(got, list | tuple) and isinstance(expected, list | tuple):
        some, others = cast("list[Any]", got), cast("list[Any]", expected)
        if len(some) != len(others):
            yield f"{name}: got {len(some)} entries, expected {len(others)}"
            return
        for k, (one, other) in enumerate(zip(some, others, strict=True)):
            yield from value_differences(one, other, f"{name}[{k}]", rtol=rtol, atol=atol)
    elif not _same(got, expected, rtol, atol):
        yield f"{name}: got {_shown(got)}, expected {_shown(expected)}"


def figure_differences(got: Any, expected: Any, name: str) -> Differences:
    """Yield the differences of figures from those that were computed again."""
    return value_differences(got, expected, name, rtol=FIGURES_RTOL, atol=FIGURES_ATOL)


def array_difference(got: Any, expected: Any, name: str, *, atol: float = 0.0) -> Differences:
    """Yield the first difference between two arrays; NaN equals NaN.

    Args:
        got, expected: The arrays.
        name: Name of the arrays in the message.
        atol: Absolute tolerance between floating-point numbers.
    """
    got, expected = np.asarray(got), np.asarray(expected)
    if got.shape != expected.shape:
        yield f"{name}: got the shape {got.shape}, expected {expected.shape}"
        return
    if got.dtype.kind != "f" or expected.dtype.kind != "f":
        off = got != expected
    else:
        with np.errstate(invalid="ignore"):
            near = np.abs(got.astype(np.float64) - expected) <= atol
            off = ~(near | (got == expected) | (np.isnan(got) & np.isnan(expected)))
    if np.any(off):
        place = tuple(int(k) for k in np.argwhere(off)[0])
        where = f"[{', '.join(map(str, place))}]" if place else ""
        one, other = _shown(got[place].item()), _shown(expected[place].item())
        yield f"{name}{where}: got {one}, expected {other}"


def _same(got: Any, expected: Any, rtol: float, atol: float) -> bool:
    if isinstance(got, bool) or isinstance(expected, bool):
        return got is expected
    if isinstance(got, int | float) and isinstance(expected, int | float):
        if got != got or expected != expected:
            return got != got and expected != expected
        if isinstance(got, int) and isinstance(expected, int):
            return got == expected
        return got == expected or abs(got - expected) <= atol + rtol * abs(expected)
    return type(got) is type(expected) and got == expected


def _shown(value: Any) -> str:
    if value is MISSING:
        return "nothing"
    text = json.dumps(value, default=str)
    return text if len(text) <= MAX_VALUE_CHARACTERS else f"{text[: MAX_VALUE_CHARACTERS - 1]}…"
