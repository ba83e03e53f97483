"""The API describes itself, in a way that client generators accept."""

from __future__ import annotations

from typing import Any

from tests.server.service import Service


def test_description_is_valid(desk: Service) -> None:
    """What it describes is stored and compared: see tests/server/contract."""
    from openapi_spec_validator import validate  # loaded only where it is used: it takes long

    api: dict[str, Any] = desk.http.get("/api/openapi.json").json()
    validate(api)
    operations = [o for methods in api["paths"].values() for o in methods.values()]
    ids = [operation["operationId"] for operation in operations]
    assert len(ids) == len(set(ids))
    assert all(operation.get("summary") for operation in operations)
    post = api["paths"]["/api/folds"]["post"]
    assert set(post["responses"]) >= {"202", "413", "422", "429"}
    assert list(post["responses"]["422"]["content"]) == ["application/problem+json"]
