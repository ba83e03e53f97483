"""A static site: its size, and the time until a fold moves, from a folder and over HTTP."""

from __future__ import annotations

import functools
import http.server
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from playwright.sync_api import Browser, sync_playwright

from bench.command import fold
from bench.page_speed import MOVING
from bench.sections import Section
from foldback.planner.readers.gallery import Gallery
from foldback.server.cli.site import site
from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR
from tests.browser.conftest import FLAGS
from tests.tools import CHROMIUM

SITE_FOLDS: Final = 20
"""Number of folds of which the benchmark writes a static website: those that come with the package,
and others from the gallery, short to long. The size of the website grows with it."""
MAX_SITE_BYTES: Final = 40e6
"""Target of the benchmark: a static website of 20 folds has at most this size, in bytes. Above it
the target is reported as not met."""
MAX_FIRST_MOTION_S: Final = 1.5
"""Target of the benchmark: a fold of the static website moves at most this time after its page was
requested, in s. Above it the target is reported as not met."""
OPENINGS_PER_PAGE: Final = 3
"""Number of times that each page of the static website is opened to measure the time until its fold
moves; the median counts."""
PAGES: Final = ("pawn", "tetra-wrench", "wrench-160")
"""Folds that come with the package, whose first motion is measured."""


def sites(reference_seconds: float) -> Section:
    """Write a site of folds from all of the gallery, and open some of its pages."""
    del reference_seconds
    section = Section(name="sites")
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
        out = Path(place) / "host" / "x" / "y"
        for shape in _shapes(SITE_FOLDS - len(list(SHIPPED_FOLDS_DIR.glob("*.fold")))):
            fold(shape, out=Path(place) / "folds" / shape)
        start_s = time.perf_counter()
        site(out, [Path(place) / "folds"])
        written_s = time.perf_counter() - start_s
        files = {path: path.stat().st_size for path in out.rglob("*") if path.is_file()}
        with sync_playwright() as playwright, _host(out.parents[1]) as host:
            browser = playwright.chromium.launch(executable_path=CHROMIUM.get(), args=FLAGS)
            for medium, address in (("folder", out.as_uri()), ("HTTP", f"{host}/x/y")):
                section.rows += [_opened(browser, address, medium, name) for name in PAGES]
            browser.close()
    count = sum(path.match("folds/*.html") for path in files)
    size = sum(files.values())
    section.add(
        f"size of a site of {count} folds, written in {written_s:.1f} s",
        f"{size / 1e6:.1f} MB in {len(files)} files",
        f"≤ {MAX_SITE_BYTES / 1e6:.0f} MB",
        count == SITE_FOLDS and size <= MAX_SITE_BYTES,
    )
    folds = [bytes_ for path, bytes_ in files.items() if path.match("folds/*.html")]
    section.add("page of a fold, median and largest", _megabytes(np.median(folds), max(folds)))
    for medium in ("folder", "HTTP"):
        slowest = max(row["in motion, s"] for row in section.rows if row["from"] == medium)
        section.add(
            f"first motion of a fold opened from a {medium}, slowest of {len(PAGES)} folds",
            f"{slowest:.2f} s",
            f"≤ {MAX_FIRST_MOTION_S:g} s",
            slowest <= MAX_FIRST_MOTION_S,
        )
    return section


def _shapes(count: int) -> list[str]:
    """Return shapes of the gallery, from the shortest chain to the longest."""
    names = [shape.name for shape in Gallery().shapes()]
    return [names[k] for k in np.linspace(0, len(names) - 1, count).astype(int)]


def _megabytes(*sizes: float) -> str:
    return ", ".join(f"{size / 1e6:.2f} MB" for size in sizes)


@contextmanager
def _host(directory: Path) -> Generator[str]:
    """Serve a directory of files over HTTP; yield the address."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            del format, args

    files = functools.partial(Quiet, directory=str(directory))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), files) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def _opened(browser: Browser, address: str, medium: str, name: str) -> dict[str, Any]:
    """Return the median seconds until a fold moves, in windows without a cache."""
    seconds: list[float] = []
    for _ in range(OPENINGS_PER_PAGE):
        page = browser.new_page(viewport={"width": 1366, "height": 768})
        start_s = time.perf_counter()
        page.goto(f"{address}/folds/{name}.html", wait_until="commit")
        page.wait_for_function(MOVING, polling=20)
        seconds.append(time.perf_counter() - start_s)
        page.close()
    return {"from": medium, "fold": name, "in motion, s": float(np.median(seconds))}
