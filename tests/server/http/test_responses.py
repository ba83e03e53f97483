"""Responses for errors of the service, and names of downloaded files in all scripts."""

import json
from pathlib import Path

from fastapi.responses import FileResponse

from foldback.planner.errors import InputError
from foldback.server.errors import (
    Conflict,
    ServiceError,
    TooMany,
    Unidentified,
    Unusable,
    WebsocketNeeded,
)
from foldback.server.http.downloads import MAX_STEM_CHARACTERS, download_stem
from foldback.server.http.problems import HTTP_STATUSES, Problem, response_of
from foldback.server.store.previews import NoSuchPreviewError


def test_every_error_has_an_http_status() -> None:
    kinds = [
        kind
        for kind in ServiceError.__subclasses__()
        if kind.__module__ == "foldback.server.errors"
    ]
    assert set(kinds) == set(HTTP_STATUSES)
    assert Problem.of(NoSuchPreviewError("a")).status == 404


def test_response_carries_the_error_and_its_headers() -> None:
    template = "{count} are waiting; wait {retry_after_s} s."
    error = TooMany("queue-full", template, where="body.file", retry_after_s=7, count=3)
    answer = response_of(error)
    assert (answer.status_code, answer.headers["Retry-After"]) == (429, "7")
    assert answer.headers["content-type"] == "application/problem+json"
    body = {"type": "about:blank", "title": "Too Many Requests", "status": 429}
    body |= {"code": "queue-full", "values": {"count": 3, "retry_after_s": 7}}
    detail = "3 are waiting; wait 7 s."
    body |= {"where": "body.file", "detail": detail, "message": f"Body.file: {detail}"}
    assert json.loads(bytes(answer.body)) == body
    for kind, header in (
        (Unidentified, {"WWW-Authenticate": "Bearer"}),
        (WebsocketNeeded, {"Upgrade": "websocket"}),
    ):
        assert Problem.of(kind("code", "detail")).headers == header


def test_values_of_an_error_may_contain_braces() -> None:
    error = Conflict("not-ready", "{name} is still {status}.", name="{0}", status="running")
    assert (error.detail, error.values["name"]) == ("{0} is still running.", "{0}")
    refused = Unusable.of(InputError("bad", "got {text}.", text="{x}"))
    assert (refused.detail, refused.values) == ("got {x}.", {"text": "{x}"})
    assert ServiceError("bad", "got {x}").detail == "got {x}"  # without values, no template


def test_download_stem_keeps_letters_of_all_scripts_and_nothing_else() -> None:
    for name, stem in (
        ("wrench-160", "wrench-160"),
        ("Schlu\u0308ssel", "Schlüssel"),
        ("キリン 2", "キリン-2"),
        ('../a"b\r\nc', "a-b--c"),
        ("\u202egpj.exe", "gpj-exe"),
        ("…", "fold"),
        ("", "fold"),
    ):
        assert download_stem(name) == stem


def test_download_stem_is_short_and_encoded_in_headers(tmp_path: Path) -> None:
    stem = download_stem("龍" * 500)
    assert len(stem) == MAX_STEM_CHARACTERS
    assert len(f"{stem}-trajectory.json".encode()) <= 255
    path = tmp_path / "page"
    path.write_bytes(b"")
    header = FileResponse(path, filename=f"{download_stem('ключ')}.html").headers
    assert header["content-disposition"] == (
        "attachment; filename*=utf-8''%D0%BA%D0%BB%D1%8E%D1%87.html"
    )
