"""Tours and numbers over HTTP: drafts, stored ones, and refusals."""

import base64
from typing import Any

import pytest

from planner.plan.module_values import VALUES_FORMAT
from planner.plan.tour import Tour
from tests.server.service_process import Service, bearer
from words.certificate import clearance, torque


@pytest.fixture(scope="module")
def token(finished: dict[str, Any]) -> str:
    """Token of the owner of the finished fold."""
    return finished["accepted"]["owner_token"]


def put(service: Service, address: str, body: object, token: str) -> tuple[int, Any]:
    answer = service.http.put(address, json=body, headers=bearer(token))
    return answer.status_code, answer.json()


def test_draft_is_replaced_by_the_tour_of_the_owner_until_it_is_deleted(
    service: Service, finished: dict[str, Any], token: str
) -> None:
    address, page = f"/api/folds/{finished['id']}/tour", f"/folds/{finished['id']}/tour.json"
    draft = service.http.get(address).json()
    assert Tour.from_dict(draft).as_dict() == draft
    captions = " ".join(stop["caption"] for stop in draft["stops"])
    certificate = service.http.get(f"/api/folds/{finished['id']}/certificate.json").json()
    assert str(clearance(certificate)) in captions
    assert "{}: {}.".format(*torque(certificate)) in captions
    assert service.http.get(page).json() == draft

    mine = {**draft, "title": "Mine", "stops": [{**draft["stops"][0], "caption": "a\u202e  b"}]}
    status, stored = put(service, address, mine, token)
    assert (status, stored["stops"][0]["caption"]) == (200, "a b")
    for shown in (address, page):
        assert service.http.get(shown).json()["title"] == "Mine"
    assert service.http.get(f"{address}?draft=true").json() == draft
    assert service.http.delete(address, headers=bearer(token)).status_code == 204
    assert service.http.get(address).json() == draft


def test_invalid_tour_is_refused_and_not_stored(
    service: Service, finished: dict[str, Any], token: str
) -> None:
    """tests/words/test_tour.py has the list of invalid tours."""
    address = f"/api/folds/{finished['id']}/tour"
    draft = service.http.get(address).json()
    stop, frames = draft["stops"][0], draft["stops"][-1]["frame"]
    for change, place in (
        ({"frame": frames + 1}, "frame"),
        ({"modules": [service.state(finished["id"])["modules"] + 1]}, "modules"),
        ({"camera": "javascript:1"}, "camera"),
        ({"html": "<b>"}, "html"),
    ):
        status, problem = put(service, address, {**draft, "stops": [{**stop, **change}]}, token)
        assert (status, place in str(problem)) == (422, True), change
    huge = {**draft, "title": "x" * 300_000}
    assert put(service, address, huge, token)[0] == 413
    assert put(service, address, [], token)[0] == 422
    assert service.http.get(address).json() == draft


def test_fold_without_frames_has_no_tour(idle: Service) -> None:
    waiting = idle.fold([[0, 0, 0], [1, 0, 0], [1, 1, 0]], seed="21")["id"]
    answer = idle.http.get(f"/api/folds/{waiting}/tour")
    assert (answer.status_code, answer.json()["code"]) == (409, "not-ready")
    assert idle.http.get(f"/folds/{waiting}/tour.json").status_code == 204
    assert idle.http.get("/api/folds/nothere/tour").status_code == 404


def test_numbers_of_the_owner_are_stored_and_wrong_ones_are_refused(
    service: Service, finished: dict[str, Any], token: str
) -> None:
    address, page = f"/api/folds/{finished['id']}/values", f"/folds/{finished['id']}/values.json"
    modules = service.state(finished["id"])["modules"]

    def values(**changed: object) -> dict[str, Any]:
        data = base64.b64encode(bytes(2 * modules)).decode()
        scale = {"name": "a\u202e  b", "unit": "K", "low": -1, "high": 2.5}
        return {"format": VALUES_FORMAT, **scale, "rows": 2, "data": data, **changed}

    assert service.http.get(address).status_code == 404
    for wrong, place in (
        ({"format": "foldback-values/2"}, "format"),
        ({"name": "x" * 81}, "name"),
        ({"low": 3}, "but found 3.0 to 2.5"),
        ({"rows": 10**6}, "rows"),
        ({"rows": 3}, f"but found {2 * modules} bytes"),
        ({"data": "<b>"}, "data"),
        ({"html": "<b>"}, "html"),
    ):
        status, problem = put(service, address, values(**wrong), token)
        assert (status, place in str(problem)) == (422, True), wrong
    assert put(service, address, values(data="A" * 300_000), token)[0] == 413
    assert service.http.get(page).status_code == 204
    assert put(service, address, values(), token)[0] == 200
    stored = {**values(), "name": "a b"}
    assert service.http.get(address).json() == service.http.get(page).json() == stored
    assert stored["data"] in service.http.get(f"/folds/{finished['id']}/standalone.html").text
    assert service.http.delete(address, headers=bearer(token)).status_code == 204
    assert service.http.get(page).status_code == 204
