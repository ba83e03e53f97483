"""Texts that others rely on: the description of the API, help texts, and pages."""

import json
from pathlib import Path

import pytest

from tests.server.contract.texts import STORE, stored, texts


def test_texts_for_programs_and_people_are_the_stored_ones(tmp_path: Path) -> None:
    known_stored, current = stored(), texts(tmp_path / "data")
    assert current.keys() == known_stored.keys(), STORE
    for name, text in current.items():
        assert text == known_stored[name], f"{name} differs; {STORE}"


def test_description_of_the_api_names_each_operation() -> None:
    api = json.loads(stored()["openapi.json"])
    operations = [o for methods in api["paths"].values() for o in methods.values()]
    ids = [operation["operationId"] for operation in operations]
    assert len(ids) == len(set(ids))
    assert all(operation.get("summary") for operation in operations)
    refused = api["paths"]["/api/folds"]["post"]["responses"]["422"]["content"]
    assert list(refused) == ["application/problem+json"]


@pytest.mark.long
def test_description_of_the_api_is_valid() -> None:
    from openapi_spec_validator import validate  # imported only here, as it takes long

    validate(json.loads(stored()["openapi.json"]))
