"""A fold in a viser server of its own, in a real browser."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from foldback.planner.motion.timeline import TimelineWriter
from foldback.viewer import show
from tests.browser.conftest import wait_until
from tests.planner.chains import chain_of
from tests.web.conftest import SNAKE, folding

# viser logs this when a page is closed while its camera moves.
QUEUED = "ignore:Queued a .* on a closed connection:UserWarning"
LAST = 59


@pytest.mark.long
@pytest.mark.filterwarnings(QUEUED)
def test_viser_server_scrubs_selects_and_plays(browser: Browser, tmp_path: Path) -> None:
    chain = chain_of(SNAKE, name="<b>snake</b>")
    with TimelineWriter.create(tmp_path / "timeline", chain) as writer:
        writer.append(folding(chain, LAST + 1))
    with show(tmp_path / "timeline", port=0) as shown_fold:
        page = browser.new_page(viewport={"width": 800, "height": 360})
        page.goto(shown_fold.url)
        expect(page.get_by_text(f"Frame 1 of {LAST + 1}")).to_be_visible()
        expect(page.get_by_text("<b>snake</b>")).to_be_visible()  # the name is shown verbatim
        wait_until(page, lambda: len(shown_fold._cameras._aspects) == 1)
        (eye,) = shown_fold.server.get_clients().values()
        far = np.linalg.norm(eye.camera.position)
        page.get_by_role("slider").press("End")
        wait_until(
            page, lambda: shown_fold.frame == LAST and np.linalg.norm(eye.camera.position) < far
        )
        wait_until(  # the closest module, once the browser has drawn it there
            page,
            lambda: (
                page.mouse.click(295, 230) or page.wait_for_timeout(500) or shown_fold._selected
            ),
        )
        expect(
            page.get_by_text(f"Module {shown_fold._selected + 1} of {len(SNAKE)}")
        ).to_be_visible()
        page.get_by_role("button", name="Play").click()  # restarts at the first frame
        wait_until(page, lambda: 0 < shown_fold.frame < LAST)
        page.close()
