"""Damaged values: those of a plan's file are refused by name, and a fault of the program is not."""

import json
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any
from unittest.mock import Mock

import pytest

from foldback.planner.errors import UNREADABLE, PlannerError
from foldback.planner.pipeline.fold import fold
from foldback.planner.plan.plan import Plan
from tests.planner.chains import coil
from tests.refusal import refused

WRONG = (None, "x", -1.5, [], {}, [[1]])
"""Values of all types, of which each place of a file expects another."""


FAULT = TypeError("a fault of the program")


def places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the keys that lead to each value, and to the first entry of each list."""
    yield place
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from places(entry, (*place, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*place, 0))


def with_value(values: Any, place: tuple[Any, ...], value: Any) -> Any:
    """Return a copy of JSON values with another one in a place."""
    if not place:
        return value
    copy = values.copy()
    copy[place[0]] = with_value(values[place[0]], place[1:], value)
    return copy


@pytest.fixture(scope="module")
def values() -> Any:
    return json.loads(fold(coil(3), settings="robots=0").json_bytes())


def test_wrong_values_never_raise_another_error_than_a_refusal(
    values: Any, tmp_path: FilePath
) -> None:
    file = tmp_path / "plan.json"
    refusals = 0
    for place in places(values):
        for wrong in WRONG:
            file.write_text(json.dumps(with_value(values, place, wrong)))
            try:
                Plan.load(file)
            except PlannerError:
                refusals += 1
    assert refusals > 100


def test_fault_of_the_program_is_no_damaged_file(
    values: Any, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not any(issubclass(TypeError, kind) for kind in UNREADABLE)
    assert not any(issubclass(AttributeError, kind) for kind in UNREADABLE)
    file = tmp_path / "plan.json"
    file.write_text(json.dumps({**values, "chain": None}))
    with refused("not-a-plan"):
        Plan.load(file)
    file.write_text(json.dumps(values))
    monkeypatch.setattr("foldback.planner.plan.plan.chain_from_attributes", Mock(side_effect=FAULT))
    with pytest.raises(TypeError, match="a fault"):
        Plan.load(file)
