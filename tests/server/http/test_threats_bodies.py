"""JSON bodies of strangers and owners: they cost little, and a stranger's is not looked at."""

import json
from types import SimpleNamespace
from typing import Any, cast

import h11
import pytest
from fastapi.params import Form
from fastapi.routing import APIRoute

from foldback.server.api import trajectories
from foldback.server.app import ROUTERS
from foldback.server.http.connections import CountingConnection
from foldback.server.http.event_rate import BYTES_PER_EVENT, REQUEST_EVENTS
from tests.server.service_process import SNAKE, FinishedFold, Service, bearer, check_problem

STRANGER = bearer("Z" * 40)
BROKEN = b'{"format": ['
JSON = {"Content-Type": "application/json"}


def put(service: Service, address: str, body: bytes, token: str) -> Any:
    return service.http.put(address, content=body, headers={**bearer(token), **JSON})


def test_framework_decodes_no_json_body() -> None:
    """FastAPI would decode it in the event loop, collect all faults, and check the owner later."""
    for router in (*(module.router for module in ROUTERS), trajectories.schemas):
        for route in router.routes:
            if isinstance(route, APIRoute) and route.body_field is not None:
                assert isinstance(route.body_field.field_info, Form), route.path


def test_stranger_is_refused_before_the_body_is_decoded(finished: FinishedFold) -> None:
    changes = (("PUT", "/tour"), ("PUT", "/values"), ("PATCH", ""))
    for method, part in changes:
        for headers, status in (({}, 401), (STRANGER, 403)):
            answer = finished.http.request(
                method, finished.api + part, content=BROKEN, headers={**headers, **JSON}
            )
            assert answer.status_code == status, (method, part)
        unknown = f"/api/folds/none{part}"
        answer = finished.http.request(
            method, unknown, content=BROKEN, headers={**STRANGER, **JSON}
        )
        assert answer.status_code == 404, (method, part)
    answer = finished.http.post("/api/folds/none/movies", content=BROKEN, headers=JSON)
    assert answer.status_code == 404
    assert finished.http.post("/api/mine/key", content=BROKEN, headers=JSON).status_code == 401


@pytest.mark.parametrize(
    ("part", "body", "error_place"),
    [
        ("tour", b"", "format"),
        ("tour", b"[]", "body"),
        ("tour", b'{"a": "\xff"}', "body"),
        ("tour", b"[" * 60_000, "body"),
        ("tour", b'{"a": ' + b"[" * 30_000, "body"),
        ("tour", b'{"a": ' + b"9" * 60_000 + b"}", "body"),
        ("values", b'{"low": NaN}', "body"),
    ],
)
def test_body_that_is_no_object_is_refused_in_words(
    finished: FinishedFold, part: str, body: bytes, error_place: str
) -> None:
    answer = put(finished.service, f"{finished.api}/{part}", body, finished.token)
    assert answer.status_code == 422 and len(answer.content) < 1000
    assert answer.json()["where"] == error_place


def test_first_fault_is_the_answer(finished: FinishedFold) -> None:
    tour = {"format": "foldback-tour/1", "title": "a"}
    stop = {"caption": "a", "frame": 1}
    deep = {**tour, "stops": [{**stop, "caption": json.loads("[" * 400 + "]" * 400)}]}
    wrong: tuple[tuple[dict[str, Any], str], ...] = (
        ({**tour, "stops": [{}] * 20_000}, "got 20000 stops"),
        ({**tour, "stops": [dict.fromkeys(map(str, range(7000)), 1)]}, "got 0, expected"),
        ({**tour, "stops": [{**stop, "modules": [""] * 9000}]}, "expected a list of 1 to 8"),
        ({**tour, "stops": [{**stop, "frame": 10**4000}]}, "expected a whole number"),
        (deep, "expected text"),
    )
    for body, words in wrong:
        text = json.dumps(body).encode()
        answer = put(finished.service, f"{finished.api}/tour", text, finished.token)
        assert words in check_problem(answer, 422, "bad-tour")
        assert len(answer.content) < 1000
    scale = {"name": "", "unit": "", "low": 0, "high": 10**400, "rows": 1, "data": ""}
    values = json.dumps({"format": "foldback-values/1", **scale}).encode()
    answer = put(finished.service, f"{finished.api}/values", values, finished.token)
    assert "two finite numbers" in check_problem(answer, 422, "bad-values")


def test_wrong_field_of_a_body_is_named(idle: Service) -> None:
    fold = idle.fold(SNAKE, seed="92", token="o" * 24)["id"]
    own_bearer = bearer("o" * 24)
    for body, error_place in (
        ({"name": 7}, "body.name"),
        ({"name": "x" * 201}, "body.name"),
        ({"owner_token": "short"}, "body.owner_token"),
        ({"owner_token": "t" * 24 + "\n"}, "body.owner_token"),
        ({"nmae": "x"}, "body.nmae"),
    ):
        answer = idle.http.patch(f"/api/folds/{fold}", json=body, headers=own_bearer)
        check_problem(answer, 422, "bad-request")
        assert answer.json()["where"] == error_place
    plain = {**own_bearer, "Content-Type": "text/plain"}
    answer = idle.http.patch(f"/api/folds/{fold}", content=b"{}", headers=plain)
    assert "expected application/json" in check_problem(answer, 422, "bad-request")


def test_large_bodies_are_read_at_a_rate() -> None:
    """tests/server/http/test_threats_uploads.py shows that beyond the rate nothing is read."""
    charged: list[float] = []
    protocol = SimpleNamespace(
        pace=SimpleNamespace(held=False),
        charge=lambda events, request=False: charged.append(events),
    )
    connection = CountingConnection(cast("Any", protocol), 65536)
    body = b"x" * 64 * 1024
    head = b"PUT / HTTP/1.1\r\nHost: a\r\nContent-Length: %d\r\n\r\n" % len(body)
    connection.receive_data(head + body)
    while type(connection.next_event()) is not h11.EndOfMessage:
        pass
    assert sum(charged) >= REQUEST_EVENTS + len(body) / BYTES_PER_EVENT
