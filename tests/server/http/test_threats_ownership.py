"""Attacks on whose a fold is: by its link, by the same file, by the same shape."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import pytest

from server.store.owner import new_token
from tests.server.here import ServiceHere
from tests.server.http.test_threats_strangers import path_file
from tests.server.service import SNAKE, Service, bearer, owner


@pytest.fixture(scope="module")
def counter(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service without a worker whose gallery nobody else has asked for anything."""
    service = ServiceHere(tmp_path_factory.mktemp("counter") / "data").start()
    yield service
    assert service.stop() == 0


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


@pytest.mark.parametrize("use", ["smooth", "refold"])
def test_folds_made_by_strangers_from_one_fold_are_separate(
    service: Service, finished: dict[str, Any], use: str
) -> None:
    cells = SNAKE[::-1] if use == "refold" else None
    asked = [
        service.fold(cells, **{use: finished["id"]}, seed="103", token=new_token())
        for _ in range(2)
    ]
    for fold in asked:
        service.http.delete(f"/api/folds/{fold['id']}", headers=owner(fold))
    assert [fold["existing"] for fold in asked] == [False, False]
    assert len({fold["id"] for fold in asked}) == 2


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
    assert (again["id"], again["existing"], again["owner_token"]) == (mine["id"], True, me)
    assert changes(desk, mine["id"], me) == [202, 204]


def test_gallery_fold_does_not_publish_an_equal_upload(counter: Service) -> None:
    data = counter.http.get("/api/shapes/mallet-24.json").content
    mine = sent(counter, "mine.json", data)
    asked = counter.fold(shape="mallet-24")
    assert asked["id"] != mine["id"]
    listed = {fold["id"] for fold in counter.http.get("/api/folds").json()["folds"]}
    assert asked["id"] in listed and mine["id"] not in listed
    assert counter.state(mine["id"])["shape"] is None
    again = counter.fold(shape="mallet-24")
    assert (again["id"], again["existing"], again["owner_token"]) == (asked["id"], True, None)


def test_cancellation_and_request_at_once_give_nobody_a_cancelled_fold(
    counter: Service,
) -> None:
    with ThreadPoolExecutor(2) as threads:
        for _ in range(12):
            first = counter.fold(shape="wrench-24")
            if first["owner_token"] is None:  # two want the one of the round before, and get it
                break
            ready = Barrier(2)

            def cancel(first: dict[str, Any] = first, ready: Barrier = ready) -> int:
                ready.wait()
                here = f"/api/folds/{first['id']}/cancel"
                return counter.http.post(here, headers=owner(first)).status_code

            def ask(ready: Barrier = ready) -> dict[str, Any]:
                ready.wait()
                return counter.fold(shape="wrench-24")

            cancelled, second = threads.submit(cancel), threads.submit(ask)
            asked = second.result()
            assert cancelled.result() == (403 if asked["id"] == first["id"] else 202)
            assert counter.state(asked["id"])["status"] == "queued"
            if asked["id"] != first["id"]:
                assert changes(counter, asked["id"], asked["owner_token"])[0] == 202


def test_cancelled_folds_are_not_listed(counter: Service) -> None:
    fold = counter.fold(shape="hammer")
    cancelled = counter.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))
    assert cancelled.json()["status"] == "cancelled"
    for page in ("/", "/gallery", "/api/folds"):
        assert fold["id"] not in counter.http.get(page).text
