"""Attacks by strangers: others' folds, hostile names, forged addresses, senseless questions."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.robotparser import RobotFileParser
from xml.etree import ElementTree

import pytest

from server.pages.page import script_json
from server.settings import Settings
from server.store.folds import new_id
from server.store.owner import new_token
from tests.server.service import SNAKE, Service

ServiceWith = Callable[..., Service]
PAGE = {"Accept": "text/html"}
NAMES = (
    '"><script>alert(1)</script>.json',
    "</script><script>alert(1)</script>",
    "..\\..\\x.json",
    "../../../etc/passwd",
    "a\r\nSet-Cookie: a=b\r\n\r\n<script>.json",
    "gpj.\u202exe.json",
    "n" * 10_000,
    "a\x00b.json",
    "=cmd|' /C calc'!A0.json",
    "{{7*7}}${7*7}",
    "'; DROP TABLE folds; --",
    "\ud83d\ude00".encode("utf-16", "surrogatepass").decode("utf-16"),
)


def path_file(name: str, at: int) -> bytes:
    cells = [[at, i, 0] for i in range(5)]
    return json.dumps({"format": "foldback-path/1", "name": name, "cells": cells}).encode()


def test_hostile_filename_stays_a_name(desk: Service) -> None:
    for number, name in enumerate(NAMES):
        plain = name.encode().replace(b'"', b"%22").replace(b"\r", b"").replace(b"\n", b"")
        body = (
            b'--x\r\nContent-Disposition: form-data; name="file"; filename="' + plain[:3000] + b'"'
            b"\r\n\r\n" + path_file(name, number) + b"\r\n--x--\r\n"
        )
        kind = {"Content-Type": "multipart/form-data; boundary=x"}
        answer = desk.http.post("/api/folds", content=body, headers=kind)
        assert answer.status_code == 202, answer.text
        fold_id = answer.json()["id"]
        state = desk.state(fold_id)
        assert len(state["name"]) <= 200 and state["name"].isprintable()
        page = desk.http.get(f"/folds/{fold_id}", headers=PAGE)
        assert "<script>alert" not in page.text
        assert "49" not in re.findall(r"<title>(.*?)</title>", page.text, re.S)[0]
        assert "set-cookie" not in page.headers
        with desk.http.stream("GET", f"/api/folds/{fold_id}/events") as stream:
            lines = stream.iter_lines()
            assert next(lines) == "event: progress" and next(lines).startswith("data: {")
        stored = {path.name for path in desk.directory(fold_id).iterdir()}
        assert stored <= {"input", "request.json", "cells.json"}
    assert "a=b" not in desk.log.read_text() and "\x00" not in desk.log.read_text()


def test_downloads_of_a_hostile_name_are_harmless(service: Service) -> None:
    name = '=1+1"</script><script>alert(1)</script>&\r\nX: y'
    path = {**json.loads(path_file(name, 0)), "cells": SNAKE}
    answer = service.http.post("/api/folds", files={"file": ("a.json", json.dumps(path))})
    accepted = answer.json()
    service.wait_over(accepted["id"])
    where = f"/folds/{accepted['id']}"
    exports = service.http.get(f"/api{where}/exports").json()["exports"]
    files = [f"/api/folds/{accepted['id']}/exports/{e['name']}" for e in exports]
    files += [f"/api{where}/plan.json", f"/api{where}/model.xml", f"{where}/standalone.html"]
    files += [f"/api{where}/trajectory?format=csv", f"/api{where}/motors?module_mass=1&format=csv"]
    for file in files:
        answer = service.http.get(file)
        assert answer.status_code == 200, (file, answer.text[:300])
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "x" not in answer.headers
        if "text/csv" in answer.headers["content-type"]:
            fields = [field for line in answer.text.splitlines() for field in line.split(",")]
            assert not any(field.startswith(("=", "+", "@", "\t", "-c")) for field in fields)
        elif "xml" in answer.headers["content-type"] or file.endswith((".xml", "urdf", "mjcf")):
            if answer.content[:2] != b"PK":
                assert not list(ElementTree.fromstring(answer.text).iter("script"))
        elif "html" in answer.headers["content-type"]:
            assert "<script>alert" not in answer.text
            assert answer.headers["content-security-policy"].startswith("sandbox")
        if "attachment" in (told := answer.headers.get("content-disposition", "")):
            plain, encoded = r'filename="[A-Za-z0-9._-]+"', r"filename\*=utf-8''[A-Za-z0-9._%-]+"
            assert re.fullmatch(f"attachment; ({plain}|{encoded})", told), told


def test_script_json_does_not_end_its_element() -> None:
    assert "<" not in script_json({"name": "</script><!--<script>"})
    assert "&" not in script_json("&lt;")


def test_ids_and_tokens_cannot_be_guessed() -> None:
    ids, tokens = {new_id() for _ in range(1000)}, {new_token() for _ in range(1000)}
    assert len(ids) == len(tokens) == 1000
    assert all(len(i) == 20 and set(i) <= set("abcdefghijkmnpqrstuvwxyz23456789") for i in ids)
    assert all(len(token) >= 32 for token in tokens)


def test_private_links_are_not_indexed(desk: Service) -> None:
    secret = desk.http.post("/api/folds", files={"file": ("a.json", path_file("s", 60))}).json()
    public = desk.http.post("/api/folds", data={"shape": "mallet-64"}).json()
    told = desk.http.post(
        "/api/shapes/preview",
        files={"file": ("a.json", path_file("s", 61))},
        data={"full": "false"},
    ).json()
    here = f"/folds/{secret['id']}"
    parts = ("", "/facts", "/picture.png", "/standalone.html")
    for listed, paths in {
        "noindex, nofollow": (
            *(here + part for part in parts),
            *(f"/api{here}{part}" for part in ("", "/plan.json", "/movies/abc")),
            *(f"/embed/{secret['id']}", f"/compare?a={secret['id']}&b={public['id']}"),
            *(told["links"]["page"], "/shapes/new", "/view", "/embed/view", "/docs"),
        ),
        "all": (
            *(f"/folds/{public['id']}", "/", "/gallery", "/benchmarks", "/privacy", "/paper"),
            "/shapes/mallet-64.svg",
        ),
    }.items():
        for path in paths:
            headers = desk.http.get(path).headers
            assert headers["x-robots-tag"] == listed, path
            assert headers["referrer-policy"] == "same-origin", path  # no other site learns a link
    rules = RobotFileParser()
    rules.parse(desk.http.get("/robots.txt").text.splitlines())
    # Who may not come in does not read what is said there.
    for path in (here, told["links"]["page"], "/gallery", "/"):
        assert rules.can_fetch("anybody", path), path
    assert not rules.can_fetch("anybody", f"/api/folds/{public['id']}")


BAD_IDS = ("..", "%2e%2e", "..%2f..%2fsecret", "a%00b", "%0d%0aX:y", "~root", "%ff%fe", "a" * 5000)
ID_ROUTES = (
    *(f"/api/folds/{{}}{part}" for part in ("", "/frames", "/plan.json", "/exports/x", "/events")),
    *("/api/folds/{}/movies/{}", "/api/folds/{}/movies/{}/file", "/api/shapes/{}.json"),
    *(f"/folds/{{}}{part}" for part in ("", "/standalone.html", "/picture.png", "/batch")),
    *("/previews/{}", "/previews/{}/scene/{}", "/previews/{}/drawing.svg?key={}"),
    *("/static/{}", "/embed/{}", "/compare?a={}&b={}", "/gallery?q={}&type={}"),
)


@pytest.mark.parametrize("bad", BAD_IDS)
def test_ids_do_not_lead_out_of_the_data(desk: Service, bad: str) -> None:
    for path in ID_ROUTES:
        answer = desk.http.get(path.replace("{}", bad))
        assert answer.status_code < 500, (path, answer.text)
        assert "x" not in answer.headers
        assert answer.headers["x-content-type-options"] == "nosniff"
    for form in ({"fold": bad}, {"refold": bad, "shape": "mallet-64"}, {"preview": "a\x00"}):
        assert 400 <= desk.http.post("/api/folds", data=form).status_code < 500


SENSELESS = ("nan", "inf", "1e999", "-1", "1" + "0" * 30, "0x10", "", "1e-400", "٣", "9" * 5000)


@pytest.mark.parametrize("value", SENSELESS)
def test_senseless_queries_are_answered(
    service: Service, finished: dict[str, Any], value: str
) -> None:
    page = f"/folds/{finished['id']}"
    here = f"/api{page}"
    for query in (
        *(f"{here}/frames?{name}={value}" for name in ("from", "to", "stride")),
        *(f"{here}/trajectory?{name}={value}" for name in ("max_speed", "rate")),
        *(f"{here}/motors?module_mass=1&{name}={value}" for name in ("pitch", "gravity")),
        f"{here}/motors?module_mass={value}",
        *(f"{page}/batch?from={value}", f"{page}/batch?to={value}&wait={value}"),
        *(f"{page}/figures?part={value}", f"/gallery?modules={value}&least={value}&q={value}"),
    ):
        answer = service.http.get(query)
        assert answer.status_code < 500 or answer.json()["code"] == "busy", (query, answer.text)


def test_hostile_settings_are_refused(desk: Service) -> None:
    for settings in (
        "damping=" + "9" * 5000,
        "," * 100_000,
        "damping=1e999",
        "step_s=٠.٠١",
        "damping=1_0e-2",
        "damping=0x1",
        "__class__=1",
        "damping=<script>",
        "damping=0.1\x00",
        "damping=\ud800".encode("utf-8", "surrogatepass"),
    ):
        form: dict[str, Any] = {"shape": "mallet-64", "preset": "paper", "settings": settings}
        answer = desk.http.post("/api/folds", data=form)
        assert 400 <= answer.status_code < 500, answer.text
        assert len(answer.text) < 1000


def test_settings_of_endless_folds_are_refused_with_a_remedy(desk: Service) -> None:
    cells = [[x, y if x % 2 == 0 else 29 - y, 0] for x in range(20) for y in range(30)]
    file = {"file": ("long.json", json.dumps(cells))}
    for settings in (
        "step_s=0.0001",
        "snapshot_interval=1,steps_per_snapshot=1000",
        "damping=0.9",
    ):
        form = {"preset": "paper", "settings": settings}
        answer = desk.http.post("/api/folds", data=form, files=file)
        told = answer.json()
        assert (answer.status_code, told["code"]) == (422, "too-long"), told
        words = ("got settings", "expected", "Use fewer modules")
        assert all(word in told["detail"] for word in words)


def test_other_methods_are_refused(desk: Service) -> None:
    for method in ("PUT", "PATCH", "TRACE", "CONNECT", "PROPFIND", "OPTIONS"):
        for path in ("/api/folds", "/", "/api/folds/x"):
            answer = desk.http.request(method, path)
            # 422: a change of a fold that does not say what changes.
            assert answer.status_code in (400, 404, 405, 422), (method, path, answer.status_code)
            assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize(("proxies", "same"), [("192.0.2.0/24", True), ("127.0.0.0/8,::1", False)])
def test_only_trusted_proxies_tell_addresses(
    here_with: ServiceWith, proxies: str, same: bool
) -> None:
    service = here_with(trusted_proxies=proxies, largest_queue_of_visitor=1).start()
    service.fold(shape="mallet-64")
    forged = {"X-Forwarded-For": "198.51.100.7"}
    answer = service.http.post("/api/folds", data={"shape": "wrench-160"}, headers=forged)
    assert answer.status_code == (429 if same else 202)
    # What a visitor says himself stands before what the proxy says of him.
    forged = {"X-Forwarded-For": "203.0.113.9, 198.51.100.7"}
    answer = service.http.post("/api/folds", data={"shape": "box-4x4x4"}, headers=forged)
    assert answer.status_code in (422, 429)


def test_forged_host_is_escaped(here_with: ServiceWith) -> None:
    service = here_with(allowed_hosts="*").start()
    answer = service.http.get("/", headers={"Host": 'evil"><script>alert(1)</script>'})
    assert "<script>alert" not in answer.text
    assert answer.headers["cache-control"] == "no-store"


def test_security_page_names_existing_tests_and_settings() -> None:
    root = Path(__file__).parents[3]
    text = (root / "docs" / "security.md").read_text()
    named = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", text)
    assert len(named) >= 30
    for file, test in named:
        assert f"def {test}(" in (root / file).read_text(), f"{file} has no {test}"
    for setting in re.findall(r"`FOLDBACK_([A-Z_]+)`", text):
        assert setting.lower() in Settings.model_fields, setting
