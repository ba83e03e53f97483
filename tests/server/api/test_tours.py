"""Tours and numbers over HTTP: drafts, stored ones, and refusals."""

import base64
from typing import Any

from foldback.planner.plan.module_values import VALUES_FORMAT
from foldback.planner.plan.tour import Tour
from foldback.words.certificate import clearance, torque
from tests.server.service_process import FinishedFold, Service, bearer, check_problem


def put(finished: FinishedFold, address: str, body: object) -> tuple[int, Any]:
    answer = finished.http.put(address, json=body, headers=bearer(finished.token))
    return answer.status_code, answer.json()


def test_draft_is_replaced_by_the_tour_of_the_owner_until_it_is_deleted(
    finished: FinishedFold,
) -> None:
    address, page = f"{finished.api}/tour", f"{finished.page}/tour.json"
    draft = finished.http.get(address).json()
    assert Tour.from_dict(draft).as_dict() == draft
    captions = " ".join(stop["caption"] for stop in draft["stops"])
    certificate = finished.http.get(f"{finished.api}/certificate.json").json()
    assert str(clearance(certificate)) in captions
    assert "{}: {}.".format(*torque(certificate)) in captions
    assert finished.http.get(page).json() == draft

    own_tour = {**draft, "title": "Mine", "stops": [{**draft["stops"][0], "caption": "a\u202e  b"}]}
    status, stored_tour = put(finished, address, own_tour)
    assert (status, stored_tour["stops"][0]["caption"]) == (200, "a b")
    for shown_address in (address, page):
        assert finished.http.get(shown_address).json()["title"] == "Mine"
    assert finished.http.get(f"{address}?draft=true").json() == draft
    assert finished.http.delete(address, headers=bearer(finished.token)).status_code == 204
    assert finished.http.get(address).json() == draft


def test_invalid_tour_is_refused_and_not_stored(finished: FinishedFold) -> None:
    """tests/words/test_tour.py has the list of invalid tours."""
    address = f"{finished.api}/tour"
    draft = finished.http.get(address).json()
    stop, frames = draft["stops"][0], draft["stops"][-1]["frame"]
    for change, place in (
        ({"frame": frames + 1}, "frame"),
        ({"modules": [finished.state["modules"] + 1]}, "modules"),
        ({"camera": "javascript:1"}, "camera"),
        ({"html": "<b>"}, "html"),
    ):
        status, problem = put(finished, address, {**draft, "stops": [{**stop, **change}]})
        assert (status, place in str(problem)) == (422, True), change
    assert put(finished, address, {**draft, "title": "x" * 300_000})[0] == 413
    assert put(finished, address, [])[0] == 422
    assert finished.http.get(address).json() == draft


def test_fold_without_frames_has_no_tour(idle: Service) -> None:
    waiting = idle.fold([[0, 0, 0], [1, 0, 0], [1, 1, 0]], seed="21", token="t" * 24)["id"]
    address, tour = f"/api/folds/{waiting}/tour", {"format": "", "title": "", "stops": []}
    check_problem(idle.http.get(address), 409, "not-ready")
    refused = idle.http.put(address, json=tour, headers=bearer("t" * 24))
    assert check_problem(refused, 409, "not-ready").endswith("when the fold has ended.")
    assert idle.http.get(f"/folds/{waiting}/tour.json").status_code == 204


def test_numbers_of_the_owner_are_stored_and_wrong_ones_are_refused(finished: FinishedFold) -> None:
    address, page = f"{finished.api}/values", f"{finished.page}/values.json"
    modules = finished.state["modules"]

    def values(**changed: object) -> dict[str, Any]:
        data = base64.b64encode(bytes(2 * modules)).decode()
        scale = {"name": "a\u202e  b", "unit": "K", "low": -1, "high": 2.5}
        return {"format": VALUES_FORMAT, **scale, "rows": 2, "data": data, **changed}

    assert finished.http.get(address).status_code == 404
    for wrong, place in (
        ({"format": "foldback-values/2"}, "format"),
        ({"name": "x" * 81}, "name"),
        ({"low": 3}, "got 3 to 2.5"),
        ({"rows": 10**6}, "rows"),
        ({"rows": 3}, f"got {2 * modules} bytes"),
        ({"data": "<b>"}, "data"),
        ({"html": "<b>"}, "html"),
    ):
        status, problem = put(finished, address, values(**wrong))
        assert (status, place in str(problem)) == (422, True), wrong
    assert put(finished, address, values(data="A" * 300_000))[0] == 413
    assert finished.http.get(page).status_code == 204
    assert put(finished, address, values())[0] == 200
    stored = {**values(), "name": "a b"}
    assert finished.http.get(address).json() == finished.http.get(page).json() == stored
    assert stored["data"] in finished.http.get(f"{finished.page}/standalone.html").text
    assert finished.http.delete(address, headers=bearer(finished.token)).status_code == 204
    assert finished.http.get(page).status_code == 204
