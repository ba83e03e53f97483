"""The API describes itself, in a way that client generators accept."""

from __future__ import annotations

from typing import Any

from tests.server.service import Service


def test_the_description_is_valid_and_complete(desk: Service) -> None:
    from openapi_spec_validator import validate  # loaded only where it is used: it takes long

    api: dict[str, Any] = desk.http.get("/api/openapi.json").json()
    validate(api)
    paths = api["paths"]
    assert {
        "/api/folds",
        "/api/folds/{fold_id}",
        "/api/folds/{fold_id}/cancel",
        "/api/folds/{fold_id}/events",
        "/api/folds/{fold_id}/frames",
        "/api/folds/{fold_id}/plan.json",
        "/api/folds/{fold_id}/plan.npz",
        "/api/folds/{fold_id}/model.xml",
        "/api/folds/{fold_id}/exports",
        "/api/folds/{fold_id}/exports/{name}",
        "/api/shapes",
        "/api/mine/folds",
        "/api/mine/previews",
        "/api/mine/movies",
        "/api/mine/key",
    } <= set(paths)
    operations = [o for methods in paths.values() for o in methods.values()]
    ids = [operation["operationId"] for operation in operations]
    assert len(ids) == len(set(ids))
    assert all(operation.get("summary") for operation in operations)
    post = paths["/api/folds"]["post"]
    assert set(post["responses"]) >= {"202", "413", "422", "429"}
    refused = post["responses"]["422"]["content"]
    assert list(refused) == ["application/problem+json"]
