"""The page: from a dropped file to a moving chain, and from a slider to poses on the wire."""

from __future__ import annotations

import json
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import viser
from playwright.sync_api import sync_playwright
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from server.gallery import Gallery
from tests.benchmarks.tables import Section
from tests.browser.conftest import FLAGS
from tests.browser.ensure_chromium import ensure
from tests.server.service import Service

SHAPE = "wrench-160"
VISITOR = "a-visitor-in-a-benchmark"
SEEKS = 200
PAUSE_S = 0.05
POSES_BYTES = 2000
DROPS = 3
DROP = """([text, name]) => {
  const files = new DataTransfer();
  files.items.add(new File([text], name, { type: "application/json" }));
  document.getElementById("drop").dispatchEvent(
    new DragEvent("drop", { dataTransfer: files, bubbles: true, cancelable: true }));
}"""
MOVING = """() => {
  const cover = document.getElementById("cover");
  const shown = document.getElementById("r-frame")?.textContent ?? "";
  return cover?.classList.contains("gone") && /^Frame/.test(shown) && !/^Frame 1 of/.test(shown);
}"""
"""The cover goes when the first frame is drawn; a later frame than the first one has moved."""


def page(reference_seconds: float) -> Section:
    """Drops the 160 wrench in Chromium, then scrubs the finished fold."""
    del reference_seconds
    section = Section(name="page")
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        service = Service(Path(folder) / "data").start()
        try:
            _warm(service)
            seconds = _drops(service)
            scrubs = _scrubs(service, _finished(service))
        finally:
            service.stop()
    middle = sorted(seconds)[len(seconds) // 2]
    section.rows += [{"drop": k, "first moving module, s": s} for k, s in enumerate(seconds)]
    section.add(
        f"dropped {SHAPE} to first moving module, in Chromium, software GL",
        f"{middle:.2f} s",
        "≤ 3 s",
        middle <= 3,
    )
    p50, p95 = np.percentile(scrubs, [50, 95])
    section.add(
        f"slider moved to new poses on the wire, 160 modules, {SEEKS} seeks",
        f"p50 {p50 * 1e3:.1f} ms, p95 {p95 * 1e3:.1f} ms",
        "p95 ≤ 60 ms",
        p95 <= 0.06,
    )
    return section


def _warm(service: Service) -> None:
    """A first small fold, so that the worker and its kernels are ready."""
    small = service.http.post("/api/folds", data={"shape": "wrench-24"}).json()
    service.wait_over(small["id"])


def _drops(service: Service) -> list[float]:
    shape = Gallery().shape(SHAPE)
    assert shape is not None
    found: list[float] = []
    chromium = ensure()
    with sync_playwright() as playwright:
        for k in range(DROPS):
            # A path of its own each time, so that it is folded anew.
            content = json.loads(shape.data)
            content["cells"] = [[x + k, y, z] for x, y, z in content["cells"]]
            browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
            page = browser.new_page(viewport={"width": 1280, "height": 720})
            page.goto(str(service.http.base_url))
            page.wait_for_timeout(3000)
            begun = time.perf_counter()
            page.evaluate(DROP, [json.dumps(content), f"wrench-{k}.json"])
            page.wait_for_url("**/folds/*", wait_until="commit")
            page.wait_for_function(MOVING, polling=20)
            found.append(time.perf_counter() - begun)
            fold_id = page.url.rsplit("/", 1)[1].partition("#")[0]
            browser.close()
            service.wait_over(fold_id)
    return found


def _finished(service: Service) -> str:
    fold = service.http.post("/api/folds", data={"shape": SHAPE}).json()
    service.wait_over(fold["id"])
    return str(fold["id"])


@contextmanager
def _viewer(service: Service, fold_id: str) -> Iterator[tuple[ClientConnection, ClientConnection]]:
    base = str(service.http.base_url).replace("http", "ws", 1)
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with (
        connect(
            f"{base}/folds/{fold_id}/view/{VISITOR}",
            subprotocols=[protocol],
            compression=None,
            max_size=None,
        ) as view,
        connect(f"{base}/folds/{fold_id}/control/{VISITOR}", max_size=None) as bar,
    ):
        listener = threading.Thread(target=lambda: list(bar), daemon=True)
        listener.start()
        yield view, bar


def _scrubs(service: Service, fold_id: str) -> list[float]:
    """Seconds from a seek sent by the slider to the message with the new poses at the viewer."""
    random = np.random.default_rng(0)
    found: list[float] = []
    with _viewer(service, fold_id) as (view, bar):
        bar.send(json.dumps({"do": "set", "follow": False, "turn": False}))
        bar.send(json.dumps({"do": "seek", "frame": 0}))
        _poses(view)
        for frame in random.integers(1, 400, SEEKS):
            begun = time.perf_counter()
            bar.send(json.dumps({"do": "seek", "frame": int(frame)}))
            _poses(view)
            found.append(time.perf_counter() - begun)
            time.sleep(PAUSE_S)
    return found


def _poses(view: ClientConnection) -> None:
    """Waits for a message that is large enough to be the poses of all modules."""
    while len(view.recv(timeout=10)) < POSES_BYTES:
        pass
