"""A visitor's path: the landing page's animation, a fold while it is computed, its menu."""

import re

import numpy as np
import pytest
from playwright.sync_api import Route, expect

from tests.browser.conftest import Visit, choose, wait_for_fold, wait_until
from tests.server.service_process import STAIRS, path_file

MOVING = {"reduced_motion": "no-preference", "width": 320, "height": 240}
"""A small window, since each frame is drawn by software."""
NOTE_PICTURES = """(() => {
  const noted = window.noted = { frames: [], titles: [], toasts: [] };
  const note = (list, value) => { if (value && list.at(-1) !== value) list.push(value); };
  const look = () => {
    const { player } = window.foldback ?? {};
    if (player?.snapshot)
      noted.frames.push([player.playhead.frame, player.timeline.over, player.story.telling]);
    note(noted.titles, document.title);
    const toast = document.getElementById("toast");
    if (toast && !toast.hidden) note(noted.toasts, toast.textContent);
    requestAnimationFrame(look);
  };
  look();
})()"""
"""Records the frame, title and message of every picture of a page."""
FRAME = "() => foldback.player.playhead.frame"
AT_LAST_FRAME = """() => {
  const { timeline, playhead } = foldback.player;
  return timeline.over && !playhead.is.playing && playhead.frame === timeline.last;
}"""


OUTCOME = re.compile(r"/folds/[a-z0-9]+(/facts)?$")
"""Addresses from which a fold's page gets the outcome."""


def test_running_fold_plays_from_its_start_to_the_finished_shape(visit: Visit) -> None:
    page = visit("/", view=False, script=NOTE_PICTURES, **MOVING)
    # The animation on the landing page can be stopped.
    button = page.locator("#hero-pause")
    page.wait_for_function(f"() => ({FRAME})() > 0")
    button.click()
    expect(button).to_have_accessible_name("Play the animation")
    frame = page.evaluate(FRAME)
    page.wait_for_timeout(100)
    assert page.evaluate(FRAME) == frame
    button.press("Enter")
    page.wait_for_function(f"() => ({FRAME})() !== {frame}")

    routes: list[Route] = []

    def hold(route: Route) -> None:
        if route.request.is_navigation_request():
            route.continue_()
        else:
            routes.append(route)

    page.route(OUTCOME, hold)
    page.locator("#seed").evaluate("seed => { seed.value = 77; }")
    page.locator("[data-shape=wrench-80]").click()
    wait_for_fold(page)
    page.wait_for_function("() => window.foldback?.player.playhead.frame > 9")
    wait_until(page, lambda: bool(routes))
    page.unroute(OUTCOME)  # the held requests continue
    page.evaluate("foldback.player.send({ do: 'set', speed: 6 })")  # so that fewer frames are drawn
    page.wait_for_function(AT_LAST_FRAME)
    noted = page.evaluate("noted")
    frames = [frame for frame, *_ in noted["frames"]]
    assert frames[0] < 3, "it begins with the drawing"
    explosion = page.evaluate("foldback.timeline.outline.phases[0].to")
    early = [at for at in noted["frames"] if 0 < at[0] < explosion and not at[1]]
    assert early, "it plays before the verdict"
    assert all(telling for *_, telling in early), "at the pace of the story"
    steps = np.diff(frames)
    assert (steps < 0).sum() <= 1, "only the finale begins anew"
    assert steps.max() < explosion / 2, "the explosion is not skipped"
    assert noted["titles"][-1] == "✓ Wrench"
    assert "✓ Wrench: fold verified" in noted["toasts"]
    expect(page.locator("#verdict")).to_have_text(re.compile("^Safe"))


@pytest.mark.long
def test_menu_of_a_fold_links_and_renames(visit: Visit) -> None:
    page = visit("/", view=False)
    choose(page, "stairs.json", path_file(STAIRS))
    fold = wait_for_fold(page)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Safe"))
    menu, rename = page.get_by_role("button", name="Menu"), page.locator("#rename")
    menu.click()
    rename.click()
    expect(page.locator("#renaming")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#name")).to_have_text("stairs")
    expect(menu).to_be_focused()
    menu.click()
    rename.click()
    expect(page.get_by_role("textbox", name="New name")).to_have_value("stairs")
    page.keyboard.type("My stairs")  # the selected name is replaced
    page.keyboard.press("Enter")
    expect(page.locator("#name")).to_have_text("My stairs")
    expect(page).to_have_title("My stairs · foldback")
    expect(menu).to_be_focused()
    menu.click()
    page.get_by_role("link", name="My folds").click()
    expect(page.locator(f"#folds [data-id='{fold}'] .card-title")).to_have_text("My stairs")


@pytest.mark.long
def test_typed_chain_folds_and_names_a_wrong_character(visit: Visit) -> None:
    page = visit("/", view=False)
    page.locator("#type").click()
    expect(page.locator("#angles")).to_have_value("11113333111133331111333")
    page.locator("#angles").fill("0204")
    page.locator("#typed").click()
    expect(page.locator("#drop-message")).to_contain_text("digits: 0132")
    page.locator("#typed-kind").select_option(label="tetrahedra")
    page.locator("#angles").fill("0 - x +")
    page.locator("#typed").click()
    expect(page.locator("#drop-message")).to_contain_text("Character 5")
    page.locator("#angles").fill("- - - + - - - + - - -")
    page.keyboard.press("Enter")
    wait_for_fold(page)
    verdict = re.compile(r"^Safe: the 12\stetrahedra never collide\.")
    expect(page.locator("#verdict")).to_have_text(verdict)
