"""HEAD wherever there is GET, and what other programs look for at fixed addresses."""

from __future__ import annotations

from typing import Any

from tests.server.http.test_threats_answers import ROUTES, filled
from tests.server.service_process import Service
from tests.server.service_thread import ServiceThread

PATHS = sorted({route.path for route in ROUTES if "GET" in (route.methods or ())})


def test_every_get_route_answers_head(desk: ServiceThread) -> None:
    for number, path in enumerate(PATHS):
        address = filled(path, "x")
        visitor = {"X-Forwarded-For": f"10.9.{number}.1"}
        whole = desk.http.get(address, headers=visitor)
        head = desk.http.head(address, headers=visitor)
        assert head.status_code == whole.status_code, path
        assert head.headers.get("content-type") == whole.headers.get("content-type"), path
        assert head.headers.get("content-length") == whole.headers.get("content-length"), path
        assert not head.content, path
    assert "HEAD /folds/x" not in desk.log.read_text(), "logs name routes, not links"


def test_head_of_a_fold_ends_at_once(service: Service, finished: dict[str, Any]) -> None:
    api, page = f"/api/folds/{finished['id']}", f"/folds/{finished['id']}"
    for address in (f"{api}/events", f"{api}/plan.npz", page, f"{page}/batch"):
        head = service.http.head(address, timeout=20)
        assert head.is_success, address
        assert not head.content
    assert int(service.http.head(f"{api}/plan.npz").headers["content-length"]) > 1000


def test_icon_and_manifest_are_served(desk: ServiceThread) -> None:
    icon = desk.http.get("/favicon.ico")
    assert icon.content[:4] == b"\0\0\1\0"
    manifest = desk.http.get("/manifest.webmanifest").json()
    for each in manifest["icons"]:
        assert desk.http.head(each["src"]).headers["content-type"] == each["type"]


def test_oembed_describes_a_fold_of_this_service(
    service: Service, finished: dict[str, Any]
) -> None:
    origin = str(service.http.base_url).rstrip("/")
    link = f"{origin}/folds/{finished['id']}"
    assert f'href="{origin}/oembed?url=' in service.http.get(link).text
    asked = {"url": f"{link}#frame=3", "maxwidth": 300, "maxheight": 10}
    about = service.http.get("/oembed", params=asked).json()
    assert (about["version"], about["type"]) == ("1.0", "rich")
    assert (about["width"], about["height"]) == (300, 200)
    assert f'src="{origin}/embed/{finished["id"]}"' in about["html"]
    assert service.http.head(about["thumbnail_url"]).headers["content-type"] == "image/png"
    xml = service.http.get("/oembed", params={"url": link, "format": "xml"})
    assert xml.status_code == 501


def test_oembed_refuses_other_addresses(desk: ServiceThread) -> None:
    origin = str(desk.http.base_url).rstrip("/")
    for url in ("", "http://[", "https://example.org/folds/x", "/folds/x", f"{origin}/folds/none"):
        answer = desk.http.get("/oembed", params={"url": url})
        assert (answer.status_code, "iframe" in answer.text) == (404, False), url
