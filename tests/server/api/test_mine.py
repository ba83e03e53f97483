"""Folds of an owner token: lists, names and transfers."""

import json
import time
from contextlib import closing
from typing import Any

import pytest

from foldback.client import Client, Problem
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.owned_items import change_fold, folds_made
from foldback.server.store.owner import Owner, new_token
from tests.server.rows import SOMEBODY, a_fold, store_of
from tests.server.service_process import SNAKE, FinishedFold, Service, bearer
from tests.server.service_thread import ServiceThread


def create(service: Service, token: str, list_name: str = "folds", **query: Any) -> dict[str, Any]:
    answer = service.http.get(f"/api/mine/{list_name}", params=query, headers=bearer(token))
    assert answer.status_code == 200, answer.text
    assert answer.headers["cache-control"] == "no-store, no-transform"
    return answer.json()


def view_preview(service: Service, token: str, **form: Any) -> dict[str, Any]:
    data = None if "preview" in form else json.dumps(SNAKE)
    return service.preview("part.json", data, token=token, full="false", **form)


def test_folds_of_an_owner_are_listed_in_pages(idle: Service) -> None:
    my_token, stranger = new_token(), new_token()
    ids = [idle.fold(SNAKE, seed=str(seed), token=my_token)["id"] for seed in range(3)]
    idle.fold(SNAKE, seed="9", token=stranger)
    page = create(idle, my_token, limit=2)
    assert (page["total"], [fold["id"] for fold in page["folds"]]) == (3, ids[:0:-1])
    next_page = idle.http.get(page["next"], headers=bearer(my_token)).json()
    assert ([fold["id"] for fold in next_page["folds"]], next_page["next"]) == (ids[:1], None)
    fold = page["folds"][0]
    assert (fold["public"], fold["expires_at"], fold["status"]) == (False, None, "queued")
    assert fold["links"]["drawing"] == f"/folds/{fold['id']}/drawing.svg"
    for before in ("x", "1,", "nan,a", "1e9,a", "-1,a", "1,a'"):
        answer = idle.http.get(
            "/api/mine/folds", params={"before": before}, headers=bearer(my_token)
        )
        assert answer.status_code == 422, before


def test_pages_of_folds_with_equal_times_are_complete(store: Store) -> None:
    for name in "bdac":
        store.add(a_fold(name, created_at=1.7e9 + 0.1), SOMEBODY)
    first = folds_made(store, SOMEBODY, before=None, limit=3)
    remaining_folds_made = folds_made(store, SOMEBODY, before=first.next, limit=3)
    assert [row.id for row in (*first.rows, *remaining_folds_made.rows)] == list("dcba")
    assert (remaining_folds_made.next, remaining_folds_made.total) == (None, 4)


def test_renamed_fold_shows_its_name_everywhere_at_once(finished: FinishedFold) -> None:
    path, token = finished.page, finished.token
    finished.http.get(path)  # fills the response cache
    before, plan = finished.service.state(finished.id), finished.http.get(f"/api{path}/plan.json")
    answer = finished.http.patch(
        f"/api{path}", json={"name": " wrench-7 \u202e\n"}, headers=bearer(token)
    )
    assert (answer.json()["name"], answer.json()["title"]) == ("wrench-7", "wrench-7")
    for address in (path, f"{path}/facts", f"/api{path}", f"/embed/{finished.id}"):
        assert "wrench-7" in finished.http.get(address).text, address
    assert 'property="og:title" content="wrench-7' in finished.http.get(path).text
    assert finished.http.get(f"/api{path}/plan.json").content == plan.content
    finished.http.patch(f"/api{path}", json={"name": before["name"]}, headers=bearer(token))


def test_bad_names_and_tokens_are_refused(idle: Service) -> None:
    fold = idle.fold(SNAKE, seed="20")
    path, own_bearer = f"/api/folds/{fold['id']}", bearer(fold["owner_token"])
    before = idle.state(fold["id"])["name"]
    names = (" \u200b\x00", "n" * 201, ["a"])
    bodies: list[dict[str, object]] = [{"name": name} for name in names]
    for body in (*bodies, {"names": "a"}, {"owner_token": "short"}, {"owner_token": "é" * 30}):
        assert idle.http.patch(path, json=body, headers=own_bearer).status_code == 422, body
    assert idle.state(fold["id"])["name"] == before


def test_upload_repeated_after_a_transfer_is_a_new_fold(idle: Service) -> None:
    old = new_token()
    fold = idle.fold(SNAKE, seed="21", token=old)
    path, body = f"/api/folds/{fold['id']}", {"owner_token": new_token()}
    assert idle.http.patch(path, json=body, headers=bearer(old)).status_code == 200
    assert idle.fold(SNAKE, seed="21", token=old)["id"] != fold["id"]


def test_name_of_the_input_does_not_replace_that_of_the_owner(store: Store) -> None:
    for name in ("renamed", "left"):
        store.add(a_fold(name, status="queued"), SOMEBODY)
    assert change_fold(store, "renamed", SOMEBODY, name="Mine", heir=None)
    for name, shown_title in (("renamed", "Mine"), ("left", "of its file")):
        store.describe(name, name="of its file", modules=5, module="cube", module_words=None)
        assert store.fold(name).name == shown_title


def test_expiry_of_folds_by_their_kind(tmp_path: Any) -> None:
    kinds: dict[str, tuple[dict[str, object], float | None]] = {
        "seen": ({"seen_at": 1e9}, 1e9 + 172800),
        "ended": ({"ended_at": 2e9}, 2e9 + 172800),
        "pinned": ({"pinned": True}, None),
        "running": ({"status": "running"}, None),
        "public": ({"public": True}, None),
    }
    with closing(Store(Settings(data_dir=tmp_path, keep_days=2))) as store:
        for name, (values, until) in kinds.items():
            assert store.kept_until(a_fold(name, **values)) == until, name


def test_listing_folds_does_not_postpone_their_expiry(finished: FinishedFold) -> None:
    token = finished.token
    drawing = create(finished.service, token)["folds"][0]["links"]["drawing"]
    with store_of(finished.service) as store:
        store._change(finished.id, seen_at=1e9)
        answer = finished.http.get(drawing)
        assert answer.headers["content-type"] == "image/svg+xml" and "<svg" in answer.text
        assert answer.headers["content-security-policy"] == "default-src 'none'"
        create(finished.service, token)
        assert store.fold(finished.id).seen_at == 1e9
        finished.http.get(f"{finished.page}/facts")
        assert (store.fold(finished.id).seen_at or 0) > 1e9


def test_previews_of_an_owner_are_listed_with_their_last_options(idle: Service) -> None:
    my_token, stranger = new_token(), new_token()
    sent = view_preview(idle, my_token)
    view_preview(idle, my_token, preview=sent["id"], seed="3", start="0,0,0", as_voxels="true")
    view_preview(idle, stranger, preview=sent["id"], seed="4")  # anyone with the link may do so
    (listed,) = create(idle, my_token, "previews")["previews"]
    assert listed["id"] == sent["id"] and listed["modules"] == len(SNAKE)
    assert listed["page"].startswith(f"/previews/{sent['id']}?")
    options = {"seed=3", "start=0,0,0", "as_voxels=true"}
    assert set(listed["page"].partition("?")[2].split("&")) == options
    for address in (listed["page"], listed["drawing"]):
        assert idle.http.get(address).status_code == 200, address
    assert create(idle, stranger, "previews")["previews"] == []
    path = f"/api/mine/previews/{sent['id']}"
    assert idle.http.delete(path, headers=bearer(my_token)).status_code == 204
    assert idle.http.get(listed["page"]).status_code == 404
    assert create(idle, my_token, "previews")["previews"] == []


def test_client_lists_and_renames(idle: ServiceThread) -> None:
    with Client(str(idle.http.base_url)) as client, store_of(idle) as store:
        fold = client.fold(SNAKE, seed=30)
        client_owner = Owner.from_token(client.token)
        later = [a_fold(f"later{k}", created_at=time.time() + k) for k in range(25)]
        assert all(store.add(row, client_owner) for row in later)  # fills two pages
        rows = [row.id for row in later]
        assert [my_fold.id for my_fold in client.mine()] == [*rows[::-1], fold.id]
        assert fold.rename("A snake").state["title"] == "A snake"
        assert next(iter(client.mine())).state["title"] != "A snake"
        with pytest.raises(Problem, match="empty-name"):
            fold.rename("")
