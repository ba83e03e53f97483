"""Long folds: a fold of ten thousand modules is opened and played in its page."""

from __future__ import annotations

import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Page, Response, sync_playwright

from bench.command import playing
from bench.page_speed import PLAY
from bench.sections import Section
from tests.browser.conftest import FLAGS
from tests.planner import peels
from tests.tools import CHROMIUM
from tests.web.long_folds import fold, write

SIDES = (20, 20, 25)
"""Sides of the box, in cells."""
WINDOW_HINGES = 140
"""Number of consecutive hinges of the chain of 10 000 modules that move at the same time in the
motion that the page plays. The mean of peeled boxes of a thousand modules."""
HINGES_PER_FRAME = 2.36
"""Number of hinges by which the moving section of the chain advances from one frame to the next."""
WINDOWS = ((1280, 720), (390, 844))
"""Widths and heights of the browser windows, in CSS pixels."""
PLAYED_S = 8.0
"""Time for which the page plays the fold while the drawn pictures per second are counted, in s."""
COMPUTED_FRAMES = 400
"""Number of frames whose poses, colours and camera the page computes without drawing them, to
measure this rate alone."""
REACHED = "() => window.foldback?.player.shown?.exact && window.foldback.timeline.complete"
"""Condition that is true once the frame is shown exactly and all frames are fetched."""
COMPUTE = """(count) => {
  const { player, timeline } = window.foldback;
  const first = Math.round(timeline.last * 0.1);
  timeline.snapshot(first);
  const begun = performance.now();
  for (let k = 0; k < count; k++) {
    player.shown = timeline.peek(first + 0.7 * k);
    player.aim();
    const colours = player.colours();
    player.stage.modules(player.shown, colours);
    player.sketch.numbers(player.shown, colours, player.rig.eye, null);
  }
  return (1000 * count) / (performance.now() - begun);
}"""
"""Frames per second of poses, camera, colours and messages, of frames in memory, without
drawing."""
HEAP = "() => { gc(); return performance.memory.usedJSHeapSize; }"
"""Expression for the bytes in use on the page's JavaScript heap after a garbage collection."""


def long_folds(reference_seconds: float) -> Section:
    """Open and play a fold of ten thousand modules in Chromium with software OpenGL."""
    del reference_seconds
    section = Section(name="long-folds")
    chain = peels.snake(SIDES)
    windows = fold(chain, width=WINDOW_HINGES, step=HINGES_PER_FRAME)
    chromium = CHROMIUM.get()
    flags = [*FLAGS, "--enable-precise-memory-info", "--js-flags=--expose-gc"]
    label = f"{len(chain)} modules, {len(windows)} frames"
    with (
        tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder,
        sync_playwright() as playwright,
    ):
        write(Path(folder) / "timeline", chain, windows)
        with playing(Path(folder)) as address:
            for size in WINDOWS:
                browser = playwright.chromium.launch(executable_path=chromium, args=flags)
                row = _played(browser, address, size)
                browser.close()
                section.rows.append({"window": "×".join(map(str, size)), **row})
    small = section.rows[-1]
    section.add(
        f"{label}: poses, camera, colours and messages, frames a second",
        f"{small['computed a second']:.0f}",
        "≥ 20",
        small["computed a second"] >= 20,
    )
    for row in section.rows:
        section.add(
            f"{label}: played in a window of {row['window']}, software GL, pictures a second",
            f"{row['pictures a second']:.1f}",
            "≥ 20",
            row["pictures a second"] >= 20,
        )
    section.add(
        f"{label}: fetched to open it", f"{small['opened, kB']:.0f} kB", "≤ 1 MB",
        small["opened, kB"] <= 1000,
    )  # fmt: skip
    section.add(f"{label}: memory of the page's scripts", f"{small['heap, MB']:.0f} MB")
    return section


def _played(browser: Browser, address: str, size: tuple[int, int]) -> dict[str, float]:
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, reduced_motion="reduce"
    )
    page = context.new_page()
    fetched = bytes_fetched(page)
    page.goto(address)
    page.wait_for_function(REACHED, timeout=90_000)
    opened = sum(fetched) / 1e3
    page.locator("#sketch.gone").wait_for(state="attached", timeout=120_000)
    page.wait_for_timeout(5000)
    page.evaluate("() => window.foldback.player.send({ do: 'seek', percent: 10 })")
    page.wait_for_function(REACHED, timeout=90_000)
    page.wait_for_timeout(2000)
    _, pictures = page.evaluate(PLAY, PLAYED_S)
    heap = page.evaluate(HEAP) / 1e6
    computed = page.evaluate(COMPUTE, COMPUTED_FRAMES)
    return {
        "pictures a second": pictures,
        "computed a second": computed,
        "opened, kB": opened,
        "heap, MB": heap,
    }


def bytes_fetched(page: Page) -> list[int]:
    """Return the sizes of the batches and scene bundles that a page fetches, a list that grows."""
    fetched: list[int] = []

    def count(response: Response) -> None:
        if "/batch?" in response.url or response.url.endswith("/bundle"):
            fetched.append(int(response.headers["content-length"]))

    page.on("response", count)
    return fetched
