"""Rates that every route is in, and answers to bad input without internal words."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from fastapi.routing import APIRoute
from sqlalchemy import event

from server.api import robot
from server.app import ROUTERS
from server.store.previews import SWEEPING_THREAD
from tests.server.here import ServiceHere
from tests.server.service import SNAKE, Service, bearer

TOKEN = bearer("T" * 32)
INTERNAL = re.compile(
    r"Traceback|sqlalchemy|sqlite|psycopg|pydantic|starlette|fastapi|uvicorn|numpy"
    r"|\bserver\.\w+\.|\bplanner\.\w+\.|site-packages|\.py\b|0x[0-9a-f]{6,}"
    r"|<class|/home/|/tmp/|/work/|/data/",
    re.IGNORECASE,
)
CLASSES = re.compile(r"\b[A-Z]\w+(Error|Exception)\b|\bNoneType\b")
"""Words of the implementation: libraries, modules, classes, addresses and paths of files."""
BAD_VALUES = ("", "-1", "1e999", "NaN", "\u202e", "%00", "'\"<x>;--", "9" * 400, "../../etc", "[]")
BAD_BODIES = (b"", b"null", b"[", b'{"name":', b'{"name": 7, "owner_token": {}}', b"\xff\xfe\x00")


ROUTES = [
    route
    for router in [*(module.router for module in ROUTERS), robot.schemas]
    for route in router.routes
    if isinstance(route, APIRoute)
]


def filled(path: str, value: str) -> str:
    return re.sub(r"\{[^}]*\}", value, path)


def test_every_route_but_health_is_in_the_rate_of_requests(
    here_with: Callable[..., ServiceHere],
) -> None:
    service = here_with(requests_per_second_of_visitor=0.001, requests_at_once_of_visitor=1).start()
    for number, route in enumerate(ROUTES):
        # Refusals are in the rate of protocol events: no visitor is refused more than a few times.
        visitor = {"X-Forwarded-For": f"10.{number // 20}.0.1"}
        if number % 20 == 0:
            service.http.get("/robots.txt", headers=visitor)
        for method in route.methods or ():
            answer = service.http.request(method, filled(route.path, "x"), headers=visitor)
            assert answer.status_code == (200 if route.path == "/health" else 429), route.path


def test_every_route_that_reads_many_rows_is_in_the_rate_of_lists(
    here_with: Callable[..., ServiceHere],
) -> None:
    service = here_with(lists_per_second_of_visitor=0.001).start()
    asked: list[str] = []

    @event.listens_for(sa.Engine, "before_cursor_execute")
    def note(_c: object, _cursor: object, statement: str, *_: object) -> None:
        sweeping = threading.current_thread().name == SWEEPING_THREAD
        if not sweeping and re.search(r"FROM (folds|previews|movies)\b", statement):
            asked.append(statement)

    refused: set[str] = set()
    try:
        for route in ROUTES:
            if "{" in route.path or "GET" not in (route.methods or ()):
                continue  # routes with an id look up single rows
            asked.clear()
            answer = service.http.get(route.path, headers=TOKEN)
            if answer.status_code == 429:
                assert answer.json()["code"] == "too-many-lists"
                assert int(answer.headers["retry-after"]) > 0
                refused.add(route.path)
            assert not asked, f"{route.path} reads rows and is in no rate of lists"
    finally:
        event.remove(sa.Engine, "before_cursor_execute", note)
    assert {"/", "/gallery", "/api/folds", "/api/mine/folds", "/api/mine/movies"} <= refused


def test_answers_to_bad_input_hold_no_internal_words(desk: Service) -> None:
    api: dict[str, Any] = desk.http.get("/api/openapi.json").json()
    fold = desk.fold(SNAKE, seed="91")["id"]
    for number, (path, methods) in enumerate(api["paths"].items()):
        bad_values, bad_bodies = BAD_VALUES[number % 3 :: 3], BAD_BODIES[number % 2 :: 2]
        for method, operation in methods.items():
            names = [p["name"] for p in operation.get("parameters", ()) if p["in"] == "query"]
            tries = [(filled(path, "no-such"), {}), (filled(path, "%00%ff"), {})]
            here = path.replace("{fold_id}", fold)
            tries += [(filled(here, "x"), {name: value for name in names}) for value in bad_values]
            if path.endswith("/events"):
                tries = tries[:2]
            for place, query in tries:
                _check(desk, method, place, params=query)
            if "requestBody" in operation:
                kinds = operation["requestBody"]["content"]
                fields = {
                    "seed": "x",
                    "settings": "a=b,",
                    "preset": "no",
                    "preview": "p",
                    "fold": "f",
                }
                for body in bad_bodies:
                    for kind in (*kinds, "text/plain"):
                        _check(
                            desk,
                            method,
                            filled(here, "x"),
                            content=body,
                            headers={"content-type": kind},
                        )
                for name, value in fields.items():
                    _check(desk, method, filled(here, "x"), data={"shape": "x", name: value})


def _check(service: Service, method: str, place: str, **asked: Any) -> None:
    headers = {**TOKEN, **asked.pop("headers", {})}
    answer = service.http.request(method.upper(), place, headers=headers, **asked)
    assert answer.status_code != 500, (method, place, asked)
    if answer.status_code >= 400:
        found = INTERNAL.search(answer.text) or CLASSES.search(answer.text)
        assert found is None, (method, place, asked, found, answer.text[:400])
