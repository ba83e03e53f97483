"""Types of the API's answers, with which the pages' scripts are checked."""

from docs.make_api_types import FILE, types


def test_types_of_answers_are_those_of_the_description() -> None:
    assert types() == FILE.read_text(encoding="utf-8"), "run `python -m docs.make_api_types`"
