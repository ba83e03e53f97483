"""Weights: number of requests and bytes of each page in a browser without a cache."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from playwright.sync_api import Browser, Page, Request, ViewportSize

from bench.sections import Section
from bench.service.browsing import service_and_browser
from tests.server.service_process import Service

SHAPES: Final = ("wrench-24", "wrench-80")
"""Shapes of the gallery whose folds are opened."""
SIZE: Final[ViewportSize] = {"width": 1366, "height": 768}
"""Size of the browser window, CSS pixels."""
IDLE_MS: Final = 1500
"""Time without a new request after which a page counts as completely loaded, in ms; then its
requests and bytes are added up."""
UNCOVERED: Final = "() => document.getElementById('cover').classList.contains('gone')"
"""Condition that is true once the first frame is drawn."""
MAIN_CONTENT_SHOWN: Final = {
    "fold": UNCOVERED,
    "embed": UNCOVERED,
    "compare": "() => !document.getElementById('play').disabled",
    "landing": "() => document.getElementById('hero').classList.contains('moving')",
    "editor": "() => document.querySelector('#grid [role=gridcell]') !== null",
}
"""Condition by page: true once its main content is shown. Other pages are shown when they are
loaded."""
MAX_REQUESTS_AND_KB: Final = {
    "landing": (40, 553.4),
    "gallery": (50, 524.7),
    "fold": (49, 1356.0),
    "embed": (38, 1277.0),
    "compare": (42, 1344.0),
    "editor": (10, 41.61),
    "preview": (19, 980.2),
    "paper": (29, 488.2),
    "API": (8, 1809.0),
    "benchmarks": (5, 59.49),
    "standalone": (1, 1347.0),
}
"""Maximum requests and kB by page: the values at commit 346fd94. Other pages did not exist."""


def page_weights(reference_seconds: float) -> Section:
    """Open each page in a browser without a cache."""
    del reference_seconds
    section = Section(name="weights")
    with service_and_browser() as (service, browser, _):
        for name, path in _pages(service):
            section.rows.append(_weighed(browser, f"{service.http.base_url}{path}", name))
    for row in section.rows:
        requests, kilobytes = row["in all"], row["kB"]
        before = MAX_REQUESTS_AND_KB.get(row["page"])
        section.add(
            f"{row['page']}: requests, and what is sent",
            f"{requests}, {kilobytes:.0f} kB",
            "a page that was not there" if before is None else f"≤ {before[0]}, {before[1]:.0f} kB",
            None if before is None else requests <= before[0] and kilobytes <= before[1],
        )
    return section


def _pages(service: Service) -> Iterator[tuple[str, str]]:
    small, fold = (service.fold(shape=shape)["id"] for shape in SHAPES)
    for item in (small, fold):
        service.wait_over(item)
    box = {"format": "foldback-voxels/1", "cells": [[x, y, z] for x, y, z in np.ndindex(5, 4, 3)]}
    sent = {"file": ("box.json", json.dumps(box))}
    looked_at = service.http.post("/api/shapes/preview", data={"full": "false"}, files=sent).json()
    yield from {
        "landing": "/",
        "gallery": "/gallery",
        "fold": f"/folds/{fold}",
        "embed": f"/embed/{fold}",
        "compare": f"/compare?a={small}&b={fold}",
        "editor": "/shapes/new",
        "preview": looked_at["links"]["page"],
        "paper": "/paper",
        "API": "/docs",
        "my folds": "/my-folds",
        "benchmarks": "/benchmarks",
        "privacy": "/privacy",
        "standalone": f"/folds/{fold}/standalone.html",
    }.items()


def _weighed(browser: Browser, address: str, name: str) -> dict[str, Any]:
    """Return the requests and kB of a page, until its main content is shown and in total."""
    context = browser.new_context(viewport=SIZE, base_url=address)
    sent: list[str] = []
    done: list[Request] = []
    context.on("request", lambda request: sent.append(request.url))
    context.on("requestfinished", lambda request: done.append(request))
    if name == "standalone":  # a download is the whole page
        size = len(context.request.get(address).body()) / 1e3
        context.close()
        return {"page": name, "until seen": 1, "in all": 1, "kB": size, "kB unpacked": size}
    page = context.new_page()
    page.goto(address)
    first = None
    if name in MAIN_CONTENT_SHOWN:
        page.wait_for_function(MAIN_CONTENT_SHOWN[name], polling=20, timeout=90_000)
        first = len(sent)
    _rest(page, done)
    sizes = [request.sizes() for request in done]
    packed = sum(size["responseBodySize"] + size["responseHeadersSize"] for size in sizes)
    answers = [request.response() for request in done]
    unpacked = sum(len(answer.body()) for answer in answers if answer is not None and answer.ok)
    context.close()
    return {
        "page": name,
        "until seen": len(sent) if first is None else first,
        "in all": len(sent),
        "kB": packed / 1e3,
        "kB unpacked": unpacked / 1e3,
    }


def _rest(page: Page, done: list[Request]) -> None:
    """Wait until there has been no request for some time."""
    count = -1
    while count != len(done):
        count = len(done)
        page.wait_for_timeout(IDLE_MS)
