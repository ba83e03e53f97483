"""The way through the pages: the hero, a fold while it is computed, its menu, Compare, embeds."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.conftest import Visit, choose, opened_fold, path_file, seek
from tests.server.service import STAIRS, Service

MOVING = {"reduced_motion": "no-preference", "width": 320, "height": 240}
"""A small window, since each frame is drawn by software."""
NOTE = """(() => {
  const noted = window.noted = { frames: [], titles: [], toasts: [] };
  const note = (list, value) => { if (value && list.at(-1) !== value) list.push(value); };
  const look = () => {
    const { player } = window.foldback ?? {};
    if (player?.shown)
      noted.frames.push([player.playhead.frame, player.timeline.over, player.story.telling]);
    note(noted.titles, document.title);
    const toast = document.getElementById("toast");
    if (toast && !toast.hidden) note(noted.toasts, toast.textContent);
    requestAnimationFrame(look);
  };
  look();
})()"""
"""Notes what a page shows in each of its pictures."""
FRAME = "() => foldback.player.playhead.frame"
AT_LAST_FRAME = """() => {
  const { timeline, playhead } = foldback.player;
  return timeline.over && !playhead.is.playing && playhead.frame === timeline.last;
}"""


FACTS = "**/facts"


def held_facts(page: Page) -> list[Route]:
    """Hold back the facts that the page asks for, until ``release``."""
    routes: list[Route] = []
    page.route(FACTS, lambda route: routes.append(route))
    return routes


def release(page: Page, routes: list[Route]) -> None:
    """Answer requests that are held back, at least one, and all later ones at once."""
    while not routes:
        page.wait_for_timeout(20)
    page.unroute(FACTS)  # which lets go on what is held back


def test_hero_animation_is_paused_and_resumed(visit: Visit) -> None:
    page = visit("/", view=False, **MOVING)
    button = page.locator("#hero-pause")
    expect(button).to_have_accessible_name("Pause the animation")
    page.wait_for_function(f"() => ({FRAME})() > 0")
    button.click()
    expect(button).to_have_accessible_name("Play the animation")
    frame = page.evaluate(FRAME)
    page.wait_for_timeout(200)
    assert page.evaluate(FRAME) == frame
    button.press("Enter")
    expect(button).to_have_accessible_name("Pause the animation")
    page.wait_for_function(f"() => ({FRAME})() !== {frame}")


def test_running_fold_plays_from_its_start_to_the_finished_shape(
    visit: Visit, service: Service
) -> None:
    page = visit("/shapes/new", view=False, script=NOTE, **MOVING)
    verdict = held_facts(page)
    page.goto("/")
    page.locator("#seed").evaluate("seed => { seed.value = 77; }")
    page.locator("[data-shape=wrench-24]").click()
    opened_fold(page)
    page.wait_for_function("() => window.foldback?.player.playhead.frame > 9")
    release(page, verdict)
    page.evaluate("foldback.player.send({ do: 'set', speed: 6 })")  # less to draw
    page.wait_for_function(AT_LAST_FRAME)
    noted = page.evaluate("noted")
    frames = [frame for frame, *_ in noted["frames"]]
    assert frames[0] < 3, "it begins with the drawing"
    explosion = page.evaluate("foldback.timeline.outline.phases[0].to")
    early = [at for at in noted["frames"] if 0 < at[0] < explosion and not at[1]]
    assert early, "it plays before the verdict"
    assert all(telling for *_, telling in early), "at the pace of the story"
    steps = [after - before for before, after in zip(frames, frames[1:], strict=False)]
    assert sum(step < 0 for step in steps) <= 1, "only the finale begins anew"
    assert max(steps) < explosion / 2, "the explosion is not skipped"
    titles = noted["titles"]
    assert any(re.fullmatch(r"[A-Z][a-z ]+ \d+ % · Small wrench · foldback", t) for t in titles)
    assert titles[-1] == "✓ Small wrench"
    assert "✓ Small wrench folds: verified" in noted["toasts"]
    expect(page.locator("#toast")).to_have_attribute("role", "status")
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))


def test_scrubbing_a_running_fold_is_not_interrupted(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new", view=False, **MOVING)
    verdict = held_facts(page)
    page.goto(f"/folds/{service.fold(shape='wrench-24', seed='78')['id']}")
    page.wait_for_function("() => window.foldback?.player.playhead.frame > 0.5")
    page.locator("#scrub").press("Home")
    page.locator("#scrub").press("ArrowRight")
    page.wait_for_function("() => !foldback.timeline.growing")
    release(page, verdict)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    assert page.evaluate(FRAME) == 1
    assert not page.evaluate("foldback.player.is.playing")


@pytest.mark.long
def test_menu_of_a_fold_links_and_renames(visit: Visit) -> None:
    page = visit("/", view=False)
    choose(page, "stairs.json", path_file(STAIRS))
    fold = opened_fold(page)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    menu, rename = page.get_by_role("button", name="Menu"), page.locator("#rename")
    menu.click()
    links = page.locator("#ways-list a").evaluate_all("(all) => all.map((a) => a.pathname)")
    assert links == ["/", "/gallery", "/my-folds"]
    expect(rename).to_be_visible()
    page.keyboard.press("Escape")
    expect(rename).to_be_hidden()
    expect(menu).to_be_focused()
    menu.click()
    rename.click()
    page.keyboard.press("Escape")
    expect(page.locator("#name")).to_have_text("stairs")
    expect(menu).to_be_focused()
    menu.click()
    rename.click()
    expect(page.get_by_role("textbox", name="New name")).to_have_value("stairs")
    page.keyboard.type("My stairs")  # in place of the name, which is selected
    page.keyboard.press("Enter")
    expect(page.locator("#name")).to_have_text("My stairs")
    expect(page).to_have_title("My stairs · foldback")
    expect(menu).to_be_focused()
    menu.click()
    page.get_by_role("link", name="My folds").click()
    expect(page.locator(f"#folds [data-id='{fold}'] .card-title")).to_have_text("My stairs")


@pytest.mark.long
def test_compare_turns_both_sides_and_links_the_view(visit: Visit, wrench: str) -> None:
    page = visit(f"/compare?a={wrench}&b={wrench}", view=False)
    seek(page, 40)
    left, right = (page.locator(f"#side-{k} canvas") for k in range(2))
    before = right.screenshot()
    box = left.bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 150)
    page.mouse.down()
    page.mouse.move(box["x"] + 160, box["y"] + 190, steps=3)
    page.mouse.up()
    view = re.compile(r"#frame=41&camera=-?[\d.]+,[\d.]+,1$")
    page.wait_for_url(view)
    assert right.screenshot() != before
    address = page.url
    page.reload()
    expect(page.locator("#r-frame")).to_have_text(re.compile("^Frame 41 of"))
    page.keyboard.press("ArrowRight")  # the address is written anew
    page.wait_for_url(address.replace("frame=41", "frame=42"))


def test_embed_plays_by_itself_on_request(visit: Visit, wrench: str) -> None:
    page = visit(f"/embed/{wrench}?autoplay=1#frame=30", view=False, **MOVING)
    page.wait_for_function("() => window.foldback?.player.playhead.frame > 30")
    page.goto(f"/embed/{wrench}?autoplay=0&controls=0&theme=light")
    page.wait_for_function("() => window.foldback?.player.shown")
    page.wait_for_timeout(200)
    assert page.evaluate(FRAME) == 0
    expect(page.locator("#bar")).to_be_hidden()
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
