"""HTTP responses for errors of the service."""

from __future__ import annotations

import json

import pytest

from server.errors import ServiceError, TooMany, Unidentified, WebsocketNeeded
from server.http.problems import HTTP_STATUSES, Problem, response_of
from server.store.previews import NoSuchPreviewError


def test_every_error_has_a_status() -> None:
    kinds = [kind for kind in ServiceError.__subclasses__() if kind.__module__ == "server.errors"]
    assert set(kinds) == set(HTTP_STATUSES)
    assert Problem.of(NoSuchPreviewError("a")).status == 404


def test_an_answer_says_what_the_error_says() -> None:
    error = TooMany("queue-full", "Three are waiting.", where="body.file", retry_after_s=7)
    answer = response_of(error)
    assert (answer.status_code, answer.headers["Retry-After"]) == (429, "7")
    assert answer.headers["content-type"] == "application/problem+json"
    assert json.loads(bytes(answer.body)) == {
        "type": "about:blank",
        "title": "Too Many Requests",
        "status": 429,
        "code": "queue-full",
        "detail": "Three are waiting.",
        "message": "Three are waiting.",
        "where": "body.file",
    }


@pytest.mark.parametrize(
    ("kind", "header"),
    [(Unidentified, ("WWW-Authenticate", "Bearer")), (WebsocketNeeded, ("Upgrade", "websocket"))],
)
def test_http_asks_for_more_with_some(kind: type[ServiceError], header: tuple[str, str]) -> None:
    assert Problem.of(kind("code", "detail")).headers == dict([header])
