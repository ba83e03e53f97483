"""The kiosk at eightfold speed: memory and script errors after hours of an exhibition.

``python -m bench.service.kiosk --minutes 20`` runs it for another duration.
"""

from __future__ import annotations

import argparse
import contextlib
import time
from typing import Final

import psutil
from playwright.sync_api import CDPSession, Error, Page

from bench.sections import Section
from bench.service.browsing import service_and_browser

CLOCK_SPEED: Final = 8
"""Factor by which clocks and timers run faster in the pages of the exhibition mode (kiosk)."""
RUN_MINUTES: Final = 60.0
"""Wall time for which the exhibition mode (kiosk) runs, in min: at eight times the speed it
simulates eight hours."""
HEAP_SAMPLES: Final = 6
"""Number of readings of the JavaScript memory, 0.5 s apart, of which the smallest counts, as a page
that draws allocates and frees memory all the time."""
MAX_HEAP_GROWTH: Final = 0.10
"""Target of the benchmark: the JavaScript memory of the exhibition mode (kiosk) grows by at most
this fraction from the end of its first round of folds to the end of the run. Above it the target is
reported as not met."""
TOUCH: Final = "() => dispatchEvent(new PointerEvent('pointerdown'))"
"""Simulates a visitor's touch, which keeps the kiosk on its fold."""
OPEN: Final = "() => foldback.player.stage.open"
"""Condition that is true once the 3D view of a fold is open."""


def faster(speed: float) -> str:
    """Return a script for all frames that makes their clocks and timers run faster."""
    return f"""(() => {{
  const speed = {speed};
  const [timeout, interval, paint] = [setTimeout, setInterval, requestAnimationFrame];
  const now = performance.now.bind(performance);
  const start = now();
  const fast = (ms) => start + speed * (ms - start);
  performance.now = () => fast(now());
  window.setTimeout = (call, ms, ...given) => timeout(call, (ms ?? 0) / speed, ...given);
  window.setInterval = (call, ms, ...given) => interval(call, (ms ?? 0) / speed, ...given);
  window.requestAnimationFrame = (draw) => paint((ms) => draw(fast(ms)));
}})()"""


def kiosk(reference_seconds: float) -> Section:
    """Play the finished folds in turn for a simulated time of eight hours."""
    del reference_seconds
    return _played(RUN_MINUTES)


def _played(minutes: float) -> Section:
    section = Section(name="kiosk")
    errors: list[str] = []
    with service_and_browser(prewarm=False, shipped_folds=True) as (service, browser, _):
        context = browser.new_context(viewport={"width": 1366, "height": 768})
        context.add_init_script(faster(CLOCK_SPEED))
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        session = context.new_cdp_session(page)
        page.goto(f"{service.http.base_url}/kiosk?kiosk=60")
        first = _name_of_next(page, "foldback")
        deadline = time.monotonic() + 60 * minutes
        shown_count, name = 1, first
        while True:
            if name == first:  # each round begins with the same fold
                with contextlib.suppress(Error):  # on a busy machine the fold may end too soon
                    section.rows.append({"folds shown": shown_count, **_memory(page, session)})
                if time.monotonic() > deadline:
                    break
            name = _name_of_next(page, name)
            shown_count += 1
        context.close()
    after_first, end = section.rows[1], section.rows[-1]
    first_mb, end_mb = (row["heap, MB"] + row["heap of view, MB"] for row in (after_first, end))
    growth = end_mb / first_mb - 1
    section.add(
        f"heaps after {shown_count} folds in {CLOCK_SPEED * minutes / 60:.1f} h, against the "
        "first round",
        f"{growth:+.1%}",
        f"≤ {MAX_HEAP_GROWTH:+.0%}",
        growth <= MAX_HEAP_GROWTH,
    )
    section.add("script errors", str(errors or 0), "0", not errors)
    return section


def _name_of_next(page: Page, name: str) -> str:
    """Wait until another fold is shown and return its name."""
    page.wait_for_function(
        "(name) => document.getElementById('exhibit').textContent !== name",
        arg=name,
        timeout=600_000,
        polling=200,
    )
    return page.locator("#exhibit").inner_text()


def _memory(page: Page, session: CDPSession) -> dict[str, float]:
    """Return the heaps after garbage collections, and the memory of all processes of the browser.

    Touches keep the kiosk on its fold; otherwise the next one would load meanwhile. The 3D view has
    a process of its own with a separate heap.
    """
    (fold,) = page.main_frame.child_frames
    fold.evaluate(TOUCH)
    fold.wait_for_function(OPEN, timeout=60_000)
    view = page.context.new_cdp_session(fold.child_frames[0])
    samples: list[dict[str, float]] = []
    for _ in range(HEAP_SAMPLES):
        fold.evaluate(TOUCH)
        page.wait_for_timeout(500)
        samples.append({**_counted(session, ""), **_counted(view, " of view")})
    view.detach()
    resident = 0
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if "chrom" in process.name():
                resident += process.memory_full_info().uss
    smallest = {name: min(sample[name] for sample in samples) for name in samples[0]}
    return {**smallest, "browser, MB": resident / 1e6}


def _counted(session: CDPSession, of: str) -> dict[str, float]:
    """Return the heap size and the number of objects in the process of a page."""
    session.send("Performance.enable")
    with contextlib.suppress(Error):
        session.send("HeapProfiler.collectGarbage")
    values = session.send("Performance.getMetrics")["metrics"]
    metrics = {metric["name"]: metric["value"] for metric in values}
    return {
        f"heap{of}, MB": metrics["JSHeapUsedSize"] / 1e6,
        f"documents{of}": metrics["Documents"],
        f"nodes{of}": metrics["Nodes"],
        f"listeners{of}": metrics["JSEventListeners"],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=RUN_MINUTES)
    found = _played(parser.parse_args().minutes)
    for row in found.rows:
        print({name: round(value, 1) for name, value in row.items()}, flush=True)
    for figure in found.figures:
        print(figure, flush=True)
