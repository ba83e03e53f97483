"""Types of the API's answers, with which the pages' scripts are checked."""

import pytest

from docs.make_api_types import FILE, type_of, types


def test_types_of_answers_are_those_of_the_description() -> None:
    assert types() == FILE.read_text(encoding="utf-8"), "run `python -m docs.make_api_types`"


def test_schemas_become_types() -> None:
    listed = {"type": "array", "items": {"anyOf": [{"type": "integer"}, {"type": "null"}]}}
    assert type_of(listed) == "(number | null)[]"
    assert type_of({"enum": ["a", "b"], "type": "string"}) == '"a" | "b"'
    assert type_of({"type": "object", "additionalProperties": {"type": "number"}}) == (
        "Record<string, number>"
    )
    with pytest.raises(KeyError):
        type_of({"type": "object"})
