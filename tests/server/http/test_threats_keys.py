"""Attacks on the key of a browser, and attacks by names that owners set."""

from pathlib import Path
from typing import Any

from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.owned_items import change_fold, folds_made
from foldback.server.store.owner import Owner, new_token
from foldback.server.store.previews import Previews
from tests.server.rows import new_owner, statements
from tests.server.service_process import SNAKE, Service, bearer

LISTS = ("folds", "previews", "movies")


def test_lists_need_a_key_in_their_header(idle: Service) -> None:
    """tests/server/api/test_access_rights.py tests missing, short and foreign keys."""
    for list_name in LISTS:
        path = f"/api/mine/{list_name}"
        for headers in (bearer("a" * 201), {"Authorization": "Basic YTpi"}):
            assert idle.http.get(path, headers=headers).status_code == 401
        # An address would appear in logs and histories, so that a key in it is ignored.
        assert idle.http.get(path, params={"token": new_token()}).status_code == 401


def test_key_is_never_stored_or_sent_back(idle: Service) -> None:
    token = new_token()
    fold = idle.fold(SNAKE, seed="202", token=token)
    fold_path = f"/api/folds/{fold['id']}"
    answers = [idle.http.patch(fold_path, json={"name": "Mine"}, headers=bearer(token))]
    for path in (*(f"/api/mine/{list_name}" for list_name in LISTS), "/my-folds", fold_path):
        answers.append(idle.http.get(path, headers=bearer(token)))
    for answer in answers:
        assert token not in answer.text and "set-cookie" not in answer.headers
    assert token not in idle.log.read_text()
    files = [path for path in idle.data_dir.rglob("*") if path.is_file()]
    assert files and not [path for path in files if token.encode() in path.read_bytes()]


def test_replaced_key_opens_nothing(idle: Service) -> None:
    """tests/server/api/test_access_rights.py checks that nothing else changes."""
    leaked = new_token()
    fold = idle.fold(SNAKE, seed="203", token=leaked)
    answer = idle.http.post("/api/mine/key", headers=bearer(leaked))
    assert (answer.status_code, answer.headers["cache-control"]) == (200, "no-store, no-transform")
    key, folds = answer.json()["owner_token"], answer.json()["folds"]
    assert key != leaked and folds == 1 and leaked not in answer.text
    path = f"/api/folds/{fold['id']}"
    taken_s = idle.http.patch(path, json={"name": "Taken"}, headers=bearer(leaked))
    assert (taken_s.status_code, list_mine(idle, leaked, "folds")) == (403, [])
    # The old key transfers nothing back, and cannot take what now belongs to the new key.
    assert idle.http.post("/api/mine/key", headers=bearer(leaked)).json()["folds"] == 0
    second_answer = idle.http.post(
        "/api/mine/key", json={"owner_token": key}, headers=bearer(leaked)
    )
    assert (second_answer.status_code, second_answer.json()["folds"]) == (200, 0)
    assert [listed_fold["id"] for listed_fold in list_mine(idle, key, "folds")] == [fold["id"]]
    assert idle.fold(SNAKE, seed="203", token=leaked)["id"] != fold["id"]


def test_bad_keys_replace_none(idle: Service) -> None:
    token = new_token()
    fold = idle.fold(SNAKE, seed="204", token=token)
    path = "/api/mine/key"
    assert idle.http.post(path).status_code == 401
    for body in ({"owner_token": "short"}, {"owner_token": "é" * 30}, {"token": "a" * 30}, [1]):
        assert idle.http.post(path, json=body, headers=bearer(token)).status_code == 422, body
    same_answer = idle.http.post(path, json={"owner_token": token}, headers=bearer(token))
    assert (same_answer.status_code, same_answer.json()["code"]) == (400, "same-key")
    foreign = {**bearer(token), "Origin": "https://elsewhere.example"}
    assert idle.http.post(path, headers=foreign).status_code == 403
    assert [listed_fold["id"] for listed_fold in list_mine(idle, token, "folds")] == [fold["id"]]


def list_mine(idle: Service, token: str, list_name: str) -> list[dict[str, Any]]:
    return idle.http.get(f"/api/mine/{list_name}", headers=bearer(token)).json()[list_name]


def test_database_is_queried_by_hashes_only(store: Store, tmp_path: Path) -> None:
    token = new_token()
    owner, previews = Owner.from_token(token), Previews(Settings(data_dir=tmp_path), store)
    with statements() as queries:
        folds_made(store, owner, before=None, limit=1)
        previews.owned(owner)
        previews.remove("x", owner)
        change_fold(store, "x", owner, name="a", heir=new_owner())
    assert len(queries) >= 4 and token not in repr(queries)
