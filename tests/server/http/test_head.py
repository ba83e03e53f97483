"""HEAD wherever there is GET, and files that other programs request at fixed addresses."""

from tests.server.http.test_threats_answers import ROUTES, fill_in
from tests.server.service_process import FinishedFold
from tests.server.service_thread import ServiceThread

PATHS = sorted({route.path for route in ROUTES if "GET" in (route.methods or ())})


OTHERS = {"/api/folds/{fold_id}/motors": 422, "/api/folds/{fold_id}/play": 426}
"""Statuses of routes that check another condition before the existence of the fold."""


def test_every_get_route_answers_head_and_knows_what_exists(idle: ServiceThread) -> None:
    for number, path in enumerate(PATHS):
        address = fill_in(path, "x")
        visitor = {"X-Forwarded-For": f"10.9.{number}.1"}
        response = idle.http.get(address, headers=visitor)
        head = idle.http.head(address, headers=visitor)
        assert head.status_code == response.status_code, path
        assert "{" not in path or response.status_code == OTHERS.get(path, 404), path
        assert head.headers.get("content-type") == response.headers.get("content-type"), path
        assert head.headers.get("content-length") == response.headers.get("content-length"), path
        assert not head.content, path
    assert "HEAD /folds/x" not in idle.log.read_text(), "logs name routes, not links"


def test_head_of_a_fold_ends_at_once(finished: FinishedFold) -> None:
    api, page = finished.api, finished.page
    for address in (f"{api}/events", f"{api}/plan.npz", page, f"{page}/batch"):
        head = finished.http.head(address, timeout=20)
        assert head.is_success, address
        assert not head.content
    assert int(finished.http.head(f"{api}/plan.npz").headers["content-length"]) > 1000


def test_icon_and_manifest_are_served(idle: ServiceThread) -> None:
    assert idle.http.get("/favicon.ico").content[:4] == b"\0\0\1\0"
    manifest = idle.http.get("/manifest.webmanifest").json()
    for icon in manifest["icons"]:
        assert idle.http.head(icon["src"]).headers["content-type"] == icon["type"]


def test_oembed_describes_a_fold_of_this_service(finished: FinishedFold) -> None:
    origin = f"http://{finished.service.netloc}"
    link = f"{origin}{finished.page}"
    assert f'href="{origin}/oembed?url=' in finished.http.get(link).text
    query = {"url": f"{link}#frame=3", "maxwidth": 300, "maxheight": 10}
    about = finished.http.get("/oembed", params=query).json()
    assert (about["version"], about["type"]) == ("1.0", "rich")
    assert (about["width"], about["height"]) == (300, 200)
    assert f'src="{origin}/embed/{finished.id}"' in about["html"]
    assert finished.http.head(about["thumbnail_url"]).headers["content-type"] == "image/png"
    assert finished.http.get("/oembed", params={"url": link, "format": "xml"}).status_code == 501


def test_oembed_refuses_other_addresses(idle: ServiceThread) -> None:
    for url in (
        "",
        "http://[",
        "https://example.org/folds/x",
        "/folds/x",
        f"http://{idle.netloc}/folds/none",
    ):
        answer = idle.http.get("/oembed", params={"url": url})
        assert (answer.status_code, "iframe" in answer.text) == (404, False), url
