"""Calls functions of the core with wrong arguments, and prints what happened as JSON.

A program of its own, since the point is whether it crashes. Folds say how functions are called;
then one argument, or item of a named tuple, is changed at a time.
"""

import json
from collections.abc import Callable, Iterator
from copy import deepcopy
from importlib import import_module
from pathlib import Path
from types import BuiltinFunctionType
from typing import Any

import numpy as np

from foldback.planner import core

SHAPES = Path(__file__).parents[3] / "examples" / "shapes"
FOLDED = ("wrench-24",)
FUNCTIONS = sorted(
    name
    for name in core.__all__
    if callable(getattr(core, name)) and not isinstance(getattr(core, name), type)
)


def record_calls() -> dict[str, tuple[Any, ...]]:
    """Return arguments of a call of each function that folds make, as they were before it."""
    calls: dict[str, tuple[Any, ...]] = {}

    def recording(name: str, function: BuiltinFunctionType) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            if name not in calls:
                calls[name] = deepcopy(arguments)
            return function(*arguments)

        return call

    real = {name: getattr(core, name) for name in FUNCTIONS}
    for name, function in real.items():
        setattr(core, name, recording(name, function))
    fold = import_module("foldback.planner.pipeline.fold").fold
    read = import_module("foldback.planner.readers").read
    for shape in FOLDED:
        fold(read((SHAPES / f"{shape}.json").read_bytes()))
    find_sequence = import_module("foldback.planner.pathfinding.snake_cubes").find_sequence
    find_sequence(np.argwhere(np.ones((2, 2, 3))), 6)
    for name, function in real.items():
        setattr(core, name, function)
    return calls


def wrong_types(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield what each function must refuse in place of a value."""
    yield "None", None
    if isinstance(value, np.ndarray):
        yield "a list", value.tolist()
        yield "complex numbers", value.astype(complex)
        yield "one more axis", value[np.newaxis].copy()
        yield "one element", value.dtype.type(0)
        if value.ndim > 1 and min(value.shape) > 1:
            yield "another order", np.asfortranarray(value)
    else:
        yield "text", "1"


def wrong_sizes(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield arrays of other shapes, and numbers, that may be wrong."""
    if isinstance(value, np.ndarray):
        for axis in range(value.ndim):
            one = np.take(value, [0] if value.shape[axis] else [], axis)
            yield f"longer axis {axis}", np.ascontiguousarray(np.concatenate([value, one], axis))
            shorter = value.shape[axis] - 1
            if shorter >= 0:
                yield (
                    f"shorter axis {axis}",
                    np.ascontiguousarray(np.take(value, range(shorter), axis)),
                )
                yield f"empty axis {axis}", np.ascontiguousarray(np.take(value, [], axis))
        frozen = value.copy()
        frozen.flags.writeable = False
        yield "read-only", frozen
    elif isinstance(value, int) and not isinstance(value, bool):
        yield "negative", -1


def changed(
    arguments: tuple[Any, ...], change: Callable[[Any], Iterator[tuple[str, Any]]]
) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Yield copies of a tuple with one value changed, in it or in tuples in it."""
    for place, value in enumerate(arguments):
        if isinstance(value, tuple):
            variants = [("too few items", tuple(value[:-1])), *changed(value, change)]
        else:
            variants = change(value)
        for label, wrong in variants:
            items = [*arguments[:place], wrong, *arguments[place + 1 :]]
            named = getattr(type(arguments), "_make", tuple)
            yield f"{place}: {label}", named(items)


def outcome(function: BuiltinFunctionType, arguments: tuple[Any, ...]) -> str:
    """Return the error's type and text, or "accepted"."""
    try:
        function(*deepcopy(arguments))
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "accepted"


def main() -> None:
    """Print which functions were called, accepted calls that must fail, and other errors."""
    calls = record_calls()
    accepted, others = [], []
    for name, arguments in sorted(calls.items()):
        function = getattr(core, name)
        for change, must_fail in ((wrong_types, True), (wrong_sizes, False)):
            for label, wrong in changed(arguments, change):
                print(f"{name}, argument {label}", flush=True)
                text = outcome(function, wrong)
                if text == "accepted" and must_fail:
                    accepted.append(f"{name}, argument {label}")
                elif text != "accepted" and not text.startswith(("TypeError: ", "ValueError: ")):
                    others.append(f"{name}, argument {label}: {text}")
    print(json.dumps({"called": sorted(calls), "accepted": accepted, "others": others}))


if __name__ == "__main__":
    main()
