"""Attacks by strangers: folds of others, hostile names, forged addresses, invalid queries."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.robotparser import RobotFileParser
from xml.etree import ElementTree

import pytest

from foldback.server.pages.page import script_json
from foldback.server.settings import Settings
from foldback.server.store.folds import new_id
from foldback.server.store.owner import new_token
from tests.server.routes import filled, fold_addresses, pages, paths
from tests.server.service_process import FinishedFold, Service, check_problem, path_file
from tests.server.service_thread import ServiceWith

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


def named_file(name: str, at: int) -> bytes:
    return path_file([[at, i, 0] for i in range(5)], name=name)


def test_hostile_filename_stays_a_name(idle: Service) -> None:
    for number, name in enumerate(NAMES):
        plain = name.encode().replace(b'"', b"%22").replace(b"\r", b"").replace(b"\n", b"")
        body = (
            b'--x\r\nContent-Disposition: form-data; name="file"; filename="' + plain[:3000] + b'"'
            b"\r\n\r\n" + named_file(name, number) + b"\r\n--x--\r\n"
        )
        kind = {"Content-Type": "multipart/form-data; boundary=x"}
        answer = idle.http.post("/api/folds", content=body, headers=kind)
        assert answer.status_code == 202, answer.text
        fold_id = answer.json()["id"]
        state = idle.state(fold_id)
        assert len(state["name"]) <= 200 and state["name"].isprintable()
        page = idle.http.get(f"/folds/{fold_id}", headers=PAGE)
        assert "<script>alert" not in page.text
        assert "49" not in re.findall(r"<title>(.*?)</title>", page.text, re.S)[0]
        assert "set-cookie" not in page.headers
        if "\n" in name:
            with idle.http.stream("GET", f"/api/folds/{fold_id}/events") as stream:
                lines = stream.iter_lines()
                assert next(lines) == "event: progress" and next(lines).startswith("data: {")
        stored = {path.name for path in idle.directory(fold_id).iterdir()}
        assert stored <= {"input", "request.json", "cells.json"}
    assert "a=b" not in idle.log.read_text() and "\x00" not in idle.log.read_text()


def test_downloads_of_a_hostile_name_are_harmless(service: Service) -> None:
    name = '=1+1"</script><script>alert(1)</script>&\r\nX: y'
    square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    answer = service.upload("a.json", path_file(square, name=name), strategy="simultaneous")
    page = f"/folds/{answer.json()['id']}"
    service.wait_over(answer.json()["id"])
    files = [e["href"] for e in service.http.get(f"/api{page}/exports").json()["exports"]]
    files += [f"/api{page}/plan.json", f"/api{page}/model.xml", f"{page}/standalone.html"]
    files += [f"/api{page}/trajectory?format=csv", f"/api{page}/motors?module_mass=1&format=csv"]
    for file in files:
        answer = service.http.get(file)
        assert answer.status_code == 200, (file, answer.text[:300])
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "x" not in answer.headers
        kind = answer.headers["content-type"]
        if "text/csv" in kind:
            fields = answer.text.replace("\n", ",").split(",")
            assert not any(field.startswith(("=", "+", "@", "\t", "-c")) for field in fields)
        elif "xml" in kind and answer.content[:2] != b"PK":
            assert not list(ElementTree.fromstring(answer.text).iter("script"))
        elif "html" in kind:
            assert "<script>alert" not in answer.text
            assert answer.headers["content-security-policy"].startswith("sandbox")
            assert not [link for link in links(answer.text) if link.startswith("/")]
        if "attachment" in (header := answer.headers.get("content-disposition", "")):
            plain, encoded = r'filename="[A-Za-z0-9._-]+"', r"filename\*=utf-8''[A-Za-z0-9._%-]+"
            assert re.fullmatch(f"attachment; ({plain}|{encoded})", header), header


def links(html: str) -> list[str]:
    """Return the addresses that a page names in its elements."""
    addresses: list[str] = []

    class Links(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            names = ("href", "src", "action", "data-entry")
            addresses.extend(str(value) for name, value in attrs if name in names)

    Links().feed(html)
    return addresses


def test_script_json_does_not_end_its_element() -> None:
    assert "<" not in script_json({"name": "</script><!--<script>"})
    assert "&" not in script_json("&lt;")


def test_ids_and_tokens_cannot_be_guessed() -> None:
    ids, tokens = {new_id() for _ in range(1000)}, {new_token() for _ in range(1000)}
    assert len(ids) == len(tokens) == 1000
    assert all(len(i) == 20 and set(i) <= set("abcdefghijkmnpqrstuvwxyz23456789") for i in ids)
    assert all(len(token) >= 32 for token in tokens)


def test_private_links_are_not_indexed(idle: Service) -> None:
    secret = idle.upload("a.json", named_file("s", 60)).json()
    public = idle.fold(shape="mallet-64")["id"]
    body = idle.preview("a.json", named_file("s", 61), full="false")
    preview, page = body["links"]["page"], f"/folds/{secret['id']}"
    hidden = [*fold_addresses(secret["id"]), f"/compare?a={secret['id']}&b={public}", preview]
    public_pages = [f"/folds/{public}", "/", "/gallery", "/benchmarks", "/privacy", "/paper"]
    hidden += ["/view", "/embed/view", *(page for page in pages() if page not in public_pages)]
    listed = dict.fromkeys(hidden, "noindex, nofollow") | dict.fromkeys(public_pages, "all")
    for path, robots in listed.items():
        headers = idle.http.get(path).headers
        assert headers["x-robots-tag"] == robots, path
        assert headers["referrer-policy"] == "same-origin", path  # keeps links secret
    rules = RobotFileParser()
    rules.parse(idle.http.get("/robots.txt").text.splitlines())
    # Crawlers that are kept out do not read the header of a page.
    assert all(rules.can_fetch("anybody", path) for path in (page, preview, "/gallery", "/"))
    assert not rules.can_fetch("anybody", f"/api/folds/{public}")


BAD_IDS = ("..", "%2e%2e", "..%2f..%2fsecret", "a%00b", "%0d%0aX:y", "~root", "%ff%fe", "a" * 5000)
QUERIES = ("/previews/a/drawing.svg?key={a}", "/compare?a={a}&b={b}", "/gallery?q={a}&type={b}")


def test_ids_do_not_lead_out_of_the_data(idle: Service) -> None:
    routes = [path for path in paths() if "{" in path]
    assert len(routes) > 40
    for number, path in enumerate((*routes, *QUERIES)):
        for bad in BAD_IDS[number % 4 :: 4]:
            answer = idle.http.get(filled(path, bad))
            assert answer.status_code < 500, (path, answer.text)
            assert "x" not in answer.headers
            assert answer.headers["x-content-type-options"] == "nosniff"
    forms = [{"fold": bad} for bad in BAD_IDS] + [{"refold": bad} for bad in BAD_IDS]
    for form in (*forms, {"preview": "a\x00"}):
        assert 400 <= idle.refusal(**form)[0] < 500


NONSENSE = ("nan", "inf", "1e999", "-1", "1" + "0" * 30, "0x10", "", "1e-400", "٣", "9" * 5000)


def test_senseless_queries_are_answered(finished: FinishedFold) -> None:
    page = finished.page
    queries = [f"/api{page}/frames?{name}=" for name in ("from", "to", "stride")]
    queries += [f"/api{page}/trajectory?{name}=" for name in ("max_speed", "rate")]
    queries += [f"/api{page}/motors?module_mass=1&{name}=" for name in ("pitch", "gravity")]
    queries += [f"{page}/{part}=" for part in ("batch?from", "batch?to", "figures?part")]
    queries += [f"/gallery?{name}=" for name in ("modules", "least", "q")]
    for number, query in enumerate((f"/api{page}/motors?module_mass=", *queries)):
        for value in NONSENSE[number % 3 :: 3]:
            answer = finished.http.get(query + value)
            context = (query, value, answer.text)
            assert answer.status_code < 500 or answer.json()["code"] == "busy", context


def test_hostile_settings_are_refused(idle: Service) -> None:
    commas = "," * 100_000
    for settings in (
        *("damping=" + value for value in ("9" * 5000, "1e999", "1_0e-2", "0x1", "0.1\x00")),
        *(commas, "step_s=٠.٠١", "__class__=1", "damping=<script>"),
        "damping=\ud800".encode("utf-8", "surrogatepass"),
    ):
        form: dict[str, Any] = {"shape": "mallet-64", "preset": "paper", "settings": settings}
        answer = idle.http.post("/api/folds", data=form)
        assert 400 <= answer.status_code < 500, answer.text
        assert len(answer.text) < 2000


def test_settings_of_endless_folds_are_refused_with_a_remedy(idle: Service) -> None:
    """tests/planner/pipeline/test_expected_cost.py has the list of such settings."""
    cells = [[x, y if x % 2 == 0 else 29 - y, 0] for x in range(20) for y in range(30)]
    form = {"preset": "paper", "settings": "step_s=0.0001"}
    detail = check_problem(idle.upload("long.json", json.dumps(cells), **form), 422, "too-long")
    assert all(word in detail for word in ("got ", "expected", "Use fewer modules"))


def test_other_methods_are_refused(idle: Service) -> None:
    for method in ("PUT", "PATCH", "TRACE", "CONNECT", "PROPFIND", "OPTIONS"):
        for path in ("/api/folds", "/", "/api/folds/x"):
            answer = idle.http.request(method, path)
            # 422: a request to change a fold that names no change
            assert answer.status_code in (400, 404, 405, 422), (method, path, answer.status_code)
            assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize(
    ("proxies", "is_same_address"), [("192.0.2.0/24", True), ("127.0.0.0/8,::1", False)]
)
def test_only_trusted_proxies_report_addresses(
    service_with: ServiceWith, proxies: str, is_same_address: bool
) -> None:
    service = service_with(trusted_proxies=proxies, largest_queue_of_visitor=1).start()
    service.fold(shape="mallet-64")
    # The addresses that a visitor sends precede the one that the proxy adds.
    for forged, shape, statuses in (
        ("198.51.100.7", "wrench-160", (429,) if is_same_address else (202,)),
        ("203.0.113.9, 198.51.100.7", "box-4x4x4", (422, 429)),
    ):
        headers = {"X-Forwarded-For": forged}
        answer = service.http.post("/api/folds", data={"shape": shape}, headers=headers)
        assert answer.status_code in statuses


def test_forged_host_is_escaped(service_with: ServiceWith) -> None:
    service = service_with(allowed_hosts="*").start()
    answer = service.http.get("/", headers={"Host": 'evil"><script>alert(1)</script>'})
    assert "<script>alert" not in answer.text
    assert answer.headers["cache-control"] == "no-store, no-transform"


def test_security_page_names_existing_tests_and_settings() -> None:
    root = Path(__file__).parents[3]
    text = (root / "docs" / "security.md").read_text()
    named = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", text)
    assert len(named) >= 30
    for file, test in named:
        assert f"def {test}(" in (root / file).read_text(), f"{file} has no {test}"
    for setting in re.findall(r"`FOLDBACK_([A-Z_]+)`", text):
        assert setting.lower() in Settings.model_fields, setting
