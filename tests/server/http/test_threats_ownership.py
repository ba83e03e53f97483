"""Attacks on whose a fold is: by its link, by the same file, by the same shape."""

from __future__ import annotations

from typing import Any

from server.store.owner import new_token
from tests.server.http.test_threats_strangers import path_file
from tests.server.service_process import SNAKE, Service, bearer, owner


def sent(desk: Service, filename: str, data: bytes, token: str | None = None) -> dict[str, Any]:
    headers = {} if token is None else bearer(token)
    answer = desk.http.post("/api/folds", files={"file": (filename, data)}, headers=headers)
    assert answer.status_code == 202, answer.text
    return answer.json()


def changes(desk: Service, fold_id: str, token: str) -> list[int]:
    """How a cancellation and a deletion are answered."""
    here, headers = f"/api/folds/{fold_id}", bearer(token)
    cancelled = desk.http.post(f"{here}/cancel", headers=headers)
    return [cancelled.status_code, desk.http.delete(here, headers=headers).status_code]


def test_link_to_a_fold_gives_no_ownership(desk: Service) -> None:
    mine, stranger = desk.fold(SNAKE, seed="101"), new_token()
    asked = desk.fold(fold=mine["id"], seed="101", token=stranger)
    assert (asked["id"], asked["existing"], asked["owner_token"]) == (mine["id"], True, None)
    # With other options it is a fold of his own; nobody else's claim keeps mine.
    other = desk.fold(fold=mine["id"], seed="102", token=stranger)
    assert (other["existing"], other["owner_token"]) == (False, stranger)
    assert other["id"] != mine["id"]
    assert changes(desk, mine["id"], mine["owner_token"]) == [202, 204]


def test_folds_made_by_strangers_from_one_fold_are_separate(
    service: Service, finished: dict[str, Any]
) -> None:
    for use, cells in (("smooth", None), ("refold", SNAKE[::-1])):
        wanted = {use: finished["id"], "seed": "103"}
        asked = [service.fold(cells, **wanted, token=new_token()) for _ in range(2)]
        for fold in asked:
            service.http.delete(f"/api/folds/{fold['id']}", headers=owner(fold))
        assert [fold["existing"] for fold in asked] == [False, False]
        assert asked[0]["id"] != asked[1]["id"]


def test_same_file_of_another_visitor_reveals_nothing(desk: Service) -> None:
    data, me, stranger = path_file("a shape", 101), new_token(), new_token()
    mine = sent(desk, "secret.json", data, me)
    for token in (stranger, None):
        theirs = sent(desk, "guess.json", data, token)
        assert theirs["existing"] is False
        assert theirs["id"] != mine["id"]
        assert theirs["owner_token"] and (token is None or theirs["owner_token"] == token)
        assert (desk.directory(theirs["id"]) / "request.json").read_text().count("secret") == 0
        assert changes(desk, theirs["id"], theirs["owner_token"]) == [202, 204]
    again = sent(desk, "again.json", data, me)
    other = desk.fold(fold=mine["id"], module_size="0.9", token=me)
    assert other["id"] != mine["id"]  # with other options
    assert (again["id"], again["existing"], again["owner_token"]) == (mine["id"], True, me)
    assert changes(desk, mine["id"], me) == [202, 204]


def test_gallery_fold_does_not_publish_an_equal_upload(desk: Service) -> None:
    data = desk.http.get("/api/shapes/mallet-24.json").content
    mine = sent(desk, "mine.json", data)
    asked = desk.fold(shape="mallet-24")
    assert asked["id"] != mine["id"]
    listed = {fold["id"] for fold in desk.http.get("/api/folds").json()["folds"]}
    assert asked["id"] in listed and mine["id"] not in listed
    assert desk.state(mine["id"])["shape"] is None
    again = desk.fold(shape="mallet-24")
    assert (again["id"], again["existing"], again["owner_token"]) == (asked["id"], True, None)


def test_cancelled_folds_are_not_listed(desk: Service) -> None:
    fold = desk.fold(shape="hammer")
    cancelled = desk.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))
    assert cancelled.json()["status"] == "cancelled"
    for page in ("/", "/gallery", "/api/folds"):
        assert fold["id"] not in desk.http.get(page).text
