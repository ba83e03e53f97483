"""The page of a fold, as a visitor uses it in a real browser with a real service."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Route, expect

from foldback.planner.certificate.figures_store import Figures
from foldback.planner.motion.timeline import Timeline
from tests.browser.conftest import Visit, at_frame, choose, picture, seek
from tests.server.service_process import STAIRS, Service, path_file


def redness(image: np.ndarray) -> float:
    """Return how much redder than grey the picture is, summed over its pixels."""
    red = image[..., 0] - image[..., 1:].mean(axis=-1)
    return float(np.clip(red - 4.0, 0.0, None).sum())


def pixel_on_module(image: np.ndarray) -> tuple[int, int]:
    """Return a pixel (x, y) well inside a module, near the middle of the chain."""
    bright = image.mean(axis=-1) > 70
    inside = bright.copy()
    for axis in (0, 1):
        for by in (-3, 3):
            inside &= np.roll(bright, by, axis)
    ys, xs = np.nonzero(inside)
    assert len(xs), "no module is to be seen"
    nearest = np.argmin((xs - xs.mean()) ** 2 + (ys - ys.mean()) ** 2)
    return int(xs[nearest]), int(ys[nearest])


@pytest.mark.long
def test_page_polls_when_its_event_stream_is_refused(visit: Visit) -> None:
    page = visit("/", view=False)
    exploding = {"status": "running", "stage": "explode", "fraction": 0.4, "steps": 1200}
    exploding |= {"steps_per_second": 100, "simulated_s": 12.2}
    states = [exploding]

    def answer(route: Route) -> None:
        if states:
            route.fulfill(json={"progress": states[0]})
        else:
            route.continue_()

    page.route("**/api/folds/*/events", lambda route: route.fulfill(status=429))
    page.route(re.compile(r"/api/folds/[a-z0-9]+$"), answer)
    choose(page, "stairs.json", path_file(STAIRS))
    verdict = page.locator("#verdict")
    expect(verdict).to_have_text(re.compile(r" 40 % · 1.?200 steps · 12 s simulated$"))
    states.clear()
    expect(verdict).to_have_text(re.compile("^Safe"))
    expect(page.locator("#progress")).to_be_hidden()


@pytest.mark.parametrize("view", [False, pytest.param(True, marks=pytest.mark.long)])
def test_fold_is_inspected(visit: Visit, service: Service, wrench: str, view: bool) -> None:
    page = visit(f"/folds/{wrench}", height=480, view=view)
    verdict = r"^Safe: the 24\scubes never collide\. Smallest gap: at least \d+\.\d\s% "
    expect(page.locator("#verdict")).to_have_text(re.compile(verdict))
    if view:  # otherwise the page's own drawing stays; its colours are the same
        page.locator("#sketch.gone").wait_for(state="attached")
    expect(page.locator("#stuck")).to_be_hidden()
    assert "#" not in page.url  # the link has no state before the first action
    directory = service.directory(wrench)
    timeline = Timeline.open(directory / "timeline")
    frames, chain = timeline.frames(), timeline.chain

    # Scrub: the picture is red where an error is recorded, if colours show errors.
    colours = page.locator("#colour-by")
    expect(colours).to_have_value("chain")
    colours.select_option("error")
    largest = np.nan_to_num(Figures.load(directory / "figures").max_error_rad)
    explosion = int(np.flatnonzero(frames.phase == 0)[len(frames) // 8])
    high = int(np.argmax(largest))
    seek(page, high)
    assert redness(picture(page)) > 0.0
    pace = re.compile(r" Now \d+(\.\d)? times the robot’s speed\.$")
    expect(page.locator("#speed")).to_have_attribute("title", pace)
    error = page.locator("#r-error")
    expect(error).to_have_text(re.compile(r"^Joint error [\d.]+ µrad$"))
    shown_error = float(error.inner_text().split()[2])
    assert shown_error == pytest.approx(1e6 * largest[high], rel=0.06)  # shown with two digits
    # Step, by button and by key, with the focus in the page or in the view.
    page.locator("#back").click()
    at_frame(page, high - 1)
    for key, frame in (("ArrowRight", high), ("Home", 0), ("End", len(frames) - 1)):
        page.keyboard.press(key)
        at_frame(page, frame)

    # Without a recorded error, the colours show the positions in the chain.
    seek(page, explosion)
    expect(page.locator("#legend-none")).to_have_text("Joint error exists only while folding")
    expect(page.locator("#legend-low")).to_have_text("Module 1")
    # Click a module: the panel shows what was recorded of it.
    x, y = pixel_on_module(picture(page))
    page.locator("main.stage").click(position={"x": x, "y": y})
    heading = page.locator("#panel-module h2")
    expect(heading).to_contain_text("Module")
    index = int(re.findall(r"\d+", heading.inner_text())[0]) - 1
    cell = np.rint(chain.folded_poses.positions[index]).astype(int)
    shown_error = page.locator("#panel-module [data-of=cell]").inner_text().replace("−", "-")
    assert [int(c) for c in shown_error.split(", ")] == cell.tolist()
    seen_picture = picture(page)
    assert (seen_picture[..., 2] - seen_picture[..., 0]).max() > 60  # the clicked module is blue
    page.keyboard.press("ArrowRight")  # the view has the focus now
    at_frame(page, explosion + 1)
    page.wait_for_url(f"**/folds/*#frame={explosion + 2}&module={index + 1}&colour=error")
    page.reload()
    at_frame(page, explosion + 1)
    expect(heading).to_contain_text(f"Module {index + 1} ")

    # Properties and downloads.
    page.locator("#tab-properties").click()
    expect(page.locator("#panel-properties")).to_contain_text("Smallest clearance")
    page.locator("#tab-downloads").click()
    page.get_by_text("All files", exact=True).click()
    with page.expect_download() as download:
        page.locator("#all-files a").first.click()
    plan = json.loads(Path(download.value.path()).read_text())
    assert plan["format"] == "foldback-plan/3"


@pytest.mark.long
def test_escape_closes_the_details_and_restores_focus(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}")
    page.locator("#details").click()
    page.locator("#sketch.gone").wait_for(state="attached")
    view = page.locator("#view").bounding_box()
    page.mouse.click(view["x"] + 20, view["y"] + 60)  # the view has the focus now
    page.keyboard.press("Escape")
    expect(page.locator("#drawer")).to_be_hidden()
    expect(page.locator("#details")).to_be_focused()
    expect(page.locator("#details")).to_have_attribute("aria-expanded", "false")
