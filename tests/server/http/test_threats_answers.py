"""Rates that include every route, and answers to bad input without internal words."""

import re
from itertools import product
from typing import Any

from fastapi.routing import APIRoute

from foldback.server.api import trajectories
from foldback.server.app import ROUTERS
from tests.server.rows import statements
from tests.server.service_process import SNAKE, Service, bearer
from tests.server.service_thread import ServiceWith

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
BAD_FIELDS = {
    "file": "x",
    "seed": "x",
    "settings": "a=b,",
    "preset": "no",
    "preview": "p",
    "fold": "f",
}
BAD_BODIES = (b"", b"null", b"[", b'{"name":', b'{"name": 7, "owner_token": {}}', b"\xff\xfe\x00")


ROUTES = [
    route
    for router in [*(module.router for module in ROUTERS), trajectories.schemas]
    for route in router.routes
    if isinstance(route, APIRoute)
]


def fill_in(path: str, value: str) -> str:
    return re.sub(r"\{[^}]*\}", value, path)


def test_every_route_but_health_is_in_the_rate_of_requests(
    service_with: ServiceWith,
) -> None:
    service = service_with(
        requests_per_second_of_visitor=0.001, requests_at_once_of_visitor=1
    ).start()
    for number, route in enumerate(ROUTES):
        # Refusals count as protocol events, of which each visitor has a limited rate.
        visitor = {"X-Forwarded-For": f"10.{number // 20}.0.1"}
        if number % 20 == 0:
            service.http.get("/robots.txt", headers=visitor)
        for method in route.methods or ():
            answer = service.http.request(method, fill_in(route.path, "x"), headers=visitor)
            assert answer.status_code == (200 if route.path == "/health" else 429), route.path


def test_every_route_that_reads_many_rows_is_in_the_rate_of_lists(
    service_with: ServiceWith,
) -> None:
    service = service_with(lists_per_second_of_visitor=0.001).start()
    refused: set[str] = set()
    for route in ROUTES:
        if "{" in route.path or "GET" not in (route.methods or ()):
            continue  # routes with an id read single rows
        with statements() as queries:
            answer = service.http.get(route.path, headers=TOKEN)
        if answer.status_code == 429:
            assert answer.json()["code"] == "too-many-lists"
            assert int(answer.headers["retry-after"]) > 0
            refused.add(route.path)
        read = [sql for sql, _ in queries if re.search(r"FROM (folds|previews|movies)\b", sql)]
        assert not read, f"{route.path} reads rows and is in no rate of lists"
    assert {"/", "/gallery", "/api/folds", "/api/mine/folds", "/api/mine/movies"} <= refused


def test_answers_to_bad_input_hold_no_internal_words(idle: Service) -> None:
    api: dict[str, Any] = idle.http.get("/api/openapi.json").json()
    fold = idle.fold(SNAKE, seed="91")["id"]
    for number, (path, methods) in enumerate(api["paths"].items()):
        bad_values, bad_bodies = BAD_VALUES[number % 5 :: 5], BAD_BODIES[number % 3 :: 3]
        filled_path = fill_in(path.replace("{fold_id}", fold), "x")
        for method, operation in methods.items():
            names = [p["name"] for p in operation.get("parameters", ()) if p["in"] == "query"]
            for value in ("no-such", "%00%ff"):
                _check(idle, method, fill_in(path, value))
            if not path.endswith("/events"):
                for value in bad_values:
                    _check(idle, method, filled_path, params=dict.fromkeys(names, value))
            if "requestBody" in operation:
                kinds = (*operation["requestBody"]["content"], "text/plain")
                for body, kind in product(bad_bodies, kinds):
                    _check(idle, method, filled_path, content=body, headers={"content-type": kind})
                for name, value in BAD_FIELDS.items() if "form-data" in str(kinds) else ():
                    _check(idle, method, filled_path, data={"shape": "x", name: value})


def _check(service: Service, method: str, place: str, **content: Any) -> None:
    headers = {**TOKEN, **content.pop("headers", {})}
    answer = service.http.request(method.upper(), place, headers=headers, **content)
    assert answer.status_code != 500, (method, place, content)
    if answer.status_code >= 400:
        match = INTERNAL.search(answer.text) or CLASSES.search(answer.text)
        assert match is None, (method, place, content, match, answer.text[:400])
