"""Attacks on the key of a browser, and by names that owners give."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from server.settings import Settings
from server.store.folds import Store
from server.store.owned import change_fold, folds_made
from server.store.owner import Owner, new_token
from server.store.previews import Previews
from tests.server.rows import new_owner, statements
from tests.server.service_process import SNAKE, Service, bearer

LISTS = ("folds", "previews", "movies")


def test_lists_need_a_key_in_their_header(desk: Service) -> None:
    """Keys that are missing, short or of others: see tests/server/api/test_access_rights.py."""
    for what in LISTS:
        here = f"/api/mine/{what}"
        for headers in (bearer("a" * 201), {"Authorization": "Basic YTpi"}):
            assert desk.http.get(here, headers=headers).status_code == 401
        # In an address it would stand in logs and histories: it is no key there.
        assert desk.http.get(here, params={"token": new_token()}).status_code == 401


def test_key_is_never_stored_or_sent_back(desk: Service) -> None:
    token = new_token()
    fold = desk.fold(SNAKE, seed="202", token=token)
    here = f"/api/folds/{fold['id']}"
    answers = [desk.http.patch(here, json={"name": "Mine"}, headers=bearer(token))]
    for path in (*(f"/api/mine/{what}" for what in LISTS), "/my-folds", here):
        answers.append(desk.http.get(path, headers=bearer(token)))
    for answer in answers:
        assert token not in answer.text and "set-cookie" not in answer.headers
    assert token not in desk.log.read_text()
    kept = [path for path in desk.data_dir.rglob("*") if path.is_file()]
    assert kept and not [path for path in kept if token.encode() in path.read_bytes()]


def test_replaced_key_opens_nothing(desk: Service) -> None:
    """What else it does not change: see tests/server/api/test_access_rights.py."""
    leaked = new_token()
    fold = desk.fold(SNAKE, seed="203", token=leaked)
    answer = desk.http.post("/api/mine/key", headers=bearer(leaked))
    assert (answer.status_code, answer.headers["cache-control"]) == (200, "no-store")
    key, folds = answer.json()["owner_token"], answer.json()["folds"]
    assert key != leaked and folds == 1 and leaked not in answer.text
    here = f"/api/folds/{fold['id']}"
    taken = desk.http.patch(here, json={"name": "Taken"}, headers=bearer(leaked))
    assert (taken.status_code, mine(desk, leaked, "folds")) == (403, [])
    # The old one takes nothing back, nor does it move what is another's now.
    assert desk.http.post("/api/mine/key", headers=bearer(leaked)).json()["folds"] == 0
    again = desk.http.post("/api/mine/key", json={"owner_token": key}, headers=bearer(leaked))
    assert (again.status_code, again.json()["folds"]) == (200, 0)
    assert [each["id"] for each in mine(desk, key, "folds")] == [fold["id"]]
    assert desk.fold(SNAKE, seed="203", token=leaked)["id"] != fold["id"]


def test_bad_keys_replace_none(desk: Service) -> None:
    token = new_token()
    fold = desk.fold(SNAKE, seed="204", token=token)
    here = "/api/mine/key"
    assert desk.http.post(here).status_code == 401
    for body in ({"owner_token": "short"}, {"owner_token": "é" * 30}, {"token": "a" * 30}, [1]):
        assert desk.http.post(here, json=body, headers=bearer(token)).status_code == 422, body
    same = desk.http.post(here, json={"owner_token": token}, headers=bearer(token))
    assert (same.status_code, same.json()["code"]) == (400, "same-key")
    foreign = {**bearer(token), "Origin": "https://elsewhere.example"}
    assert desk.http.post(here, headers=foreign).status_code == 403
    assert [each["id"] for each in mine(desk, token, "folds")] == [fold["id"]]


def mine(desk: Service, token: str, what: str) -> list[dict[str, Any]]:
    return desk.http.get(f"/api/mine/{what}", headers=bearer(token)).json()[what]


def test_database_is_queried_by_hashes_only(store: Store, tmp_path: Path) -> None:
    token = new_token()
    owner, previews = Owner.from_token(token), Previews(Settings(data_dir=tmp_path), store)
    with statements() as asked:
        folds_made(store, owner, before=None, limit=1)
        previews.owned(owner)
        previews.remove("x", owner)
        change_fold(store, "x", owner, name="a", heir=new_owner())
    assert len(asked) >= 4 and token not in repr(asked)
