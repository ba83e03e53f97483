"""Make the animated picture of the README: fold the 160 wrench and capture its page in Chromium.

Run from the repository's root, after ``make test`` has installed Chromium::

    .venv/bin/python docs/make_picture.py
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from foldback.planner.motion.timeline import Timeline  # noqa: E402
from tests.browser.conftest import FLAGS  # noqa: E402
from tests.tools import CHROMIUM  # noqa: E402

OUT = ROOT / "docs" / "pictures" / "wrench.gif"
SIZE = (640, 360)
"""Width and height of the picture, px."""
PICTURES_PER_PHASE = (26, 54)
"""Number of frames of the explosion and of the playback."""
FRAME_MS = 90
"""Duration of each frame of the animated GIF in the documentation, in ms."""
PAUSE_MS = 900
"""Duration of the frames with the straight and the folded chain in the animated GIF of the
documentation, in ms."""
PALETTE_COLOURS = 48
"""Number of colours of the animated GIF in the documentation."""
SEEK = """(frame) => {
  const scrub = document.getElementById("scrub");
  scrub.value = frame;
  scrub.dispatchEvent(new Event("input", { bubbles: true }));
}"""
"""Moves the slider to a frame."""
BARE = (
    "header, footer, #legend, #drawer { display: none !important }"
    "main.stage { position: fixed !important; inset: 0 !important }"
)
"""Hides all of the page but the picture."""


@contextmanager
def player(directory: Path) -> Iterator[str]:
    """Fold the wrench, serve the fold, and yield the address of its page."""
    command = [sys.executable, "-m", "foldback.server.cli.command_line"]
    subprocess.run([*command, "fold", "wrench-160", "--out", str(directory)], check=True, cwd=ROOT)
    serving = subprocess.Popen(
        [*command, "play", str(directory), "--no-browser"], stdout=subprocess.PIPE, text=True
    )
    assert serving.stdout is not None
    try:
        yield next(word for word in serving.stdout.readline().split() if "http" in word)
    finally:
        serving.terminate()
        serving.wait()


def main() -> None:
    """Write the picture."""
    with tempfile.TemporaryDirectory() as folder, player(Path(folder)) as address:
        frames = Timeline.open(Path(folder) / "timeline").frames()
        chromium = CHROMIUM.get()
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
            page = browser.new_page(
                viewport={"width": SIZE[0], "height": SIZE[1]}, color_scheme="light"
            )
            page.goto(f"{address}#frame=1")  # an address with a view starts no tour
            page.locator("#sketch.gone").wait_for(state="attached")
            page.add_style_tag(content=BARE)
            pictures = [_picture(page, frame) for frame in _chosen(frames.phase)]
            browser.close()
    durations = [FRAME_MS] * len(pictures)
    durations[PICTURES_PER_PHASE[0] - 1] = durations[-1] = PAUSE_MS
    palette = pictures[-1].quantize(PALETTE_COLOURS, dither=Image.Dither.NONE)
    small = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    small[0].save(
        OUT, save_all=True, append_images=small[1:], duration=durations, loop=0, optimize=True
    )
    print(f"{OUT.relative_to(ROOT)}: {OUT.stat().st_size / 1e6:.1f} MB")


def _chosen(phase: np.ndarray) -> list[int]:
    """Return the frames to show: some of the explosion, then more of the playback."""
    first = int(np.argmax(phase == 1))
    explosion = np.linspace(0, first - 1, PICTURES_PER_PHASE[0]).round().astype(int)
    playback = np.linspace(first, len(phase) - 1, PICTURES_PER_PHASE[1]).round().astype(int)
    return [*explosion.tolist(), *playback.tolist()]


def _picture(page: Page, frame: int) -> Image.Image:
    page.evaluate(SEEK, frame)
    page.wait_for_timeout(700)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


if __name__ == "__main__":
    main()
