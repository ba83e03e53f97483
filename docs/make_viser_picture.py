"""Make the picture of viser: fold the 160 wrench, show the plan and take a screenshot in Chromium.

Run from the repository's root, after ``make test`` has installed Chromium::

    .venv/bin/python -m docs.make_viser_picture
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

from PIL import Image
from playwright.sync_api import sync_playwright

from foldback import Chain, fold, read
from foldback import Path as CellPath
from foldback.viewer import show
from tests.browser.conftest import FLAGS
from tests.tools import CHROMIUM

ROOT: Final = Path(__file__).parents[1]
OUT: Final = ROOT / "docs" / "pictures" / "viser.webp"
SIZE: Final = (1100, 620)
"""Width and height of the picture, px."""
SHOWN_AT: Final = 0.86
"""Position of the frame that the documentation's picture of the viser window shows, as a fraction
of the motion, 0 being the straight chain."""


def main() -> None:
    """Write the picture."""
    shape = read((ROOT / "examples" / "shapes" / "wrench-160.json").read_bytes())
    assert isinstance(shape, CellPath | Chain)
    plan = fold(shape)
    with show(plan, port=0) as viewer, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM.get(), args=FLAGS)
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        page.goto(viewer.url)
        page.get_by_text("Frame 0").wait_for()
        page.locator("canvas").first.wait_for()
        for notice in page.locator(".mantine-Notification-closeButton").all():
            notice.click()  # a notice about software rendering
        viewer.frame = round(SHOWN_AT * len(plan.motion))
        page.wait_for_timeout(3000)
        picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        browser.close()
    picture.save(OUT, quality=82, method=6)
    print(f"{OUT.relative_to(ROOT)}: {OUT.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
