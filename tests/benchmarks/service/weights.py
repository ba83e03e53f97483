"""Weights: how many requests a page takes, and how many bytes, as a browser fetches it first."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from playwright.sync_api import Browser, Request, sync_playwright

from tests.benchmarks.tables import Section
from tests.browser.conftest import FLAGS
from tests.server.service import Service
from tests.tools import CHROMIUM

SHAPES: Final = ("wrench-24", "wrench-80")
SIZE: Final = {"width": 1366, "height": 768}
REST_MS: Final = 1500
"""How long nothing may be fetched until a page is taken to be all there."""
SEEN: Final = {
    "fold": "() => document.getElementById('cover').classList.contains('gone')",
    "embed": "() => document.getElementById('cover').classList.contains('gone')",
    "compare": "() => document.querySelectorAll('.side .sketch').length === 2 && "
    "!document.getElementById('play').disabled",
    "landing": "() => document.getElementById('hero').classList.contains('moving')",
    "editor": "() => document.querySelectorAll('#grid [role=gridcell]').length > 0",
}
"""When a page shows what it is for; others do when they are loaded."""


def weights(reference_seconds: float) -> Section:
    """Opens each page in a browser that has seen none before."""
    del reference_seconds
    section = Section(name="weights")
    chromium = CHROMIUM.get()
    with (
        tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder,
        sync_playwright() as playwright,
    ):
        service = Service(Path(folder) / "data", prewarm=True).start()
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        try:
            section.rows += [
                _weighed(browser, str(service.http.base_url), name, path)
                for name, path in _pages(service)
            ]
        finally:
            browser.close()
            service.stop()
    return section


def _pages(service: Service) -> Iterator[tuple[str, str]]:
    a, b = (service.http.post("/api/folds", data={"shape": shape}).json()["id"] for shape in SHAPES)
    for fold in (a, b):
        service.wait_over(fold)
    cells = service.http.get(f"/shapes/{SHAPES[0]}.svg")
    assert cells.is_success
    yield from {
        "landing": "/",
        "gallery": "/gallery",
        "fold": f"/folds/{b}",
        "embed": f"/embed/{b}",
        "compare": f"/compare?a={a}&b={b}",
        "editor": "/shapes/new",
        "paper": "/paper",
        "API": "/docs",
        "my folds": "/my-folds",
        "benchmarks": "/benchmarks",
        "privacy": "/privacy",
        "standalone": f"/folds/{b}/standalone.html",
    }.items()


def _weighed(browser: Browser, origin: str, name: str, path: str) -> dict[str, Any]:
    """What a page takes until it shows what it is for, and until it rests."""
    if name == "standalone":
        return {"page": name, **_file(browser, origin + path)}
    context = browser.new_context(viewport=SIZE)
    done: list[Request] = []
    context.on("requestfinished", lambda request: done.append(request))
    sent: list[str] = []
    context.on("request", lambda request: sent.append(request.url))
    page = context.new_page()
    answer = page.goto(origin + path)
    if answer is None or not answer.ok:
        context.close()
        return {"page": name, "requests": 0, "at rest": 0, "kB": 0.0, "kB unpacked": 0.0}
    if name in SEEN:
        page.wait_for_function(SEEN[name], polling=20, timeout=90_000)
    first = len(sent)
    count = -1
    while count != len(done):
        count = len(done)
        page.wait_for_timeout(REST_MS)
    sizes = [request.sizes() for request in done]
    got = sum(size["responseBodySize"] + size["responseHeadersSize"] for size in sizes)
    unpacked = 0
    for request in done:
        found = request.response()
        if found is not None and found.ok:
            unpacked += len(found.body())
    if DUMP:
        for request, size in zip(done, sizes):
            print(name, request.url.removeprefix(origin)[:60], size["responseBodySize"])
    context.close()
    return {
        "page": name,
        "requests": first,
        "at rest": len(sent),
        "kB": got / 1e3,
        "kB unpacked": unpacked / 1e3,
    }


DUMP = True


def _file(browser: Browser, address: str) -> dict[str, Any]:
    """The same of a page that is one file."""
    answer = browser.new_context().request.get(address)
    size = len(answer.body()) / 1e3
    return {"page": "standalone", "requests": 1, "at rest": 1, "kB": size, "kB unpacked": size}
