"""The steps of a fold: next and back, by button and by key."""

from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, expect

from foldback.planner.plan.steps import find_steps
from foldback.server.cli.site import site
from tests.browser.conftest import MEDIA
from tests.planner.chains import coil
from tests.planner.folds import write_resting_fold
from tests.planner.plans import resting

COLOURS = """() => {
  const colours = foldback.player.colours();
  return Array.from({ length: 12 }, (_, i) => colours.slice(3 * i, 3 * i + 3).join());
}"""


POSITIONS = "() => Array.from(foldback.player.snapshot.positions)"


def test_steps_go_on_and_back_with_the_moving_part_in_colour(
    browser: Browser, tmp_path: Path
) -> None:
    chain = coil(12)
    bent = np.flatnonzero(chain.folded_rad)[:3]
    rests = np.zeros((4, len(chain.folded_rad)))
    for k, hinge in enumerate(bent, 1):
        rests[k:, hinge] = chain.folded_rad[hinge]
    plan = resting(chain, rests)
    write_resting_fold(tmp_path / "folds" / "coil", plan)
    site(tmp_path / "site", [tmp_path / "folds"], finished=False)
    page = browser.new_page(viewport={"width": 390, "height": 844}, **MEDIA)
    page.goto((tmp_path / "site" / "folds" / "coil.html").as_uri())
    page.locator("#steps").click()
    count, steps = page.locator("#steps-count"), find_steps(plan)
    assert steps is not None
    poses = [held_still.positions.ravel() for held_still in steps.poses()]
    expect(count).to_have_text("Step 1 of 3")
    expect(page.locator("#steps-before")).to_be_disabled()
    for number, step in enumerate(steps.steps, 1):
        expect(count).to_have_text(f"Step {number} of 3")
        np.testing.assert_allclose(page.evaluate(POSITIONS), poses[number - 1], atol=1e-4)
        colours = page.evaluate(COLOURS)
        joint = step.turns[0].module
        ((first, last),) = step.moving
        moving = {colours[i] for i in range(first, last + 1) if i != joint}
        held_colours = {colours[i] for i in range(step.held[0], step.held[1] + 1) if i != joint}
        assert len(held_colours) == 1
        assert moving.isdisjoint(held_colours)
        assert len({colours[joint], *moving, *held_colours}) == 1 + len(moving) + 1
        page.locator("#steps-next").click()
    expect(count).to_have_text("All 3 steps")
    first, last = steps.steps[-1].held
    still = slice(3 * first, 3 * last + 3)
    np.testing.assert_allclose(page.evaluate(POSITIONS)[still], poses[2][still], atol=1e-4)
    expect(page.locator("#steps-next")).to_be_disabled()
    page.keyboard.press("PageUp")
    expect(count).to_have_text("Step 3 of 3")
    assert page.evaluate("() => foldback.player.playhead.frame") == steps.frames[2]
    page.locator("#steps-close").click()
    expect(page.locator("#steps-panel")).to_be_hidden()
    assert len(set(page.evaluate(COLOURS))) == 12  # the position in the chain again
    page.close()
