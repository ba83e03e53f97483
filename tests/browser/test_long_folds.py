"""A fold of ten thousand modules in a browser: opened, played, looked at closely."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from bench.command import playing
from planner.chain.kinematics import forward_kinematics
from planner.motion.motion import Motion
from tests.browser.conftest import Visit, bytes_fetched
from tests.planner import peels
from tests.web import long_folds

pytestmark = pytest.mark.long
CHAIN = peels.snake((20, 20, 25))
OPENED = 2**20
"""Bytes that a fold may take to open, of its scene bundle and frames."""
SHOWN = "() => window.foldback?.player.shown?.exact && window.foldback.timeline.complete"
HERE = """() => {
  let found = 0;
  for (const { count } of window.foldback.timeline.store.chunks.values()) found += count;
  return found;
}"""
CLICK = """([module, way]) => {
  const { player } = window.foldback;
  const at = player.shown.positions.subarray(3 * module, 3 * module + 3);
  player.pick(Array.from(at, (v, k) => v + 3 * way[k]), way.map((v) => -v));
}"""


@pytest.fixture(scope="module")
def windows() -> Motion:
    return long_folds.fold(CHAIN, width=140, step=2.36)


@pytest.fixture(scope="module")
def address(windows: Motion, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    directory = tmp_path_factory.mktemp("long")
    long_folds.write(directory / "timeline.zarr", CHAIN, windows)
    with playing(directory) as found:
        yield found


def test_long_fold_opens_with_few_bytes_and_plays(
    visit: Visit, address: str, windows: Motion
) -> None:
    page = visit("/")
    fetched = bytes_fetched(page)
    page.goto(address)
    page.wait_for_function(SHOWN)
    assert 0 < sum(fetched) < OPENED
    assert page.evaluate(HERE) < len(windows) / 4
    # It goes on fetching as it is played, and holds what it needs.
    page.evaluate("""() => {
      const { player } = window.foldback;
      window.missing = 0;
      player.addEventListener("drawn", () => { window.missing += !player.shown.exact; });
      player.send({ do: "play" });
    }""")
    page.wait_for_function("() => window.foldback.player.playhead.frame > 4000")
    page.evaluate("() => window.foldback.player.send({ do: 'pause' })")
    page.wait_for_function(SHOWN)
    drawn = page.evaluate(HERE)
    assert 4000 < drawn < len(windows)
    # Somewhere else it is there at once, as it is a little beside, and soon as it is.
    page.evaluate("() => window.foldback.player.send({ do: 'seek', frame: 7000 })")
    assert page.evaluate("() => Math.abs(window.foldback.player.shown.low - 7000)") < 150
    page.wait_for_function(f"() => ({SHOWN})() && window.foldback.player.shown.low === 7000")


def test_any_module_of_a_long_fold_is_clicked(visit: Visit, address: str, windows: Motion) -> None:
    page = visit("/")
    page.goto(address)
    page.wait_for_function(SHOWN)
    frame = len(windows) // 5
    page.evaluate(f"() => window.foldback.player.send({{ do: 'seek', frame: {frame} }})")
    page.wait_for_function(f"() => ({SHOWN})() && window.foldback.player.shown.low === {frame}")
    angles = windows.angles(CHAIN, frame, frame + 1)[0]
    positions = forward_kinematics(
        CHAIN.module, angles, root_position=CHAIN.folded_position, root_wxyz=CHAIN.folded_wxyz
    ).positions
    core, rod = (int(hinges[frame]) // 2 for hinges in (windows.first, windows.last))
    assert 0 < core < rod < len(CHAIN) - 1000
    corner = int(np.argmin(CHAIN.folded_poses.positions @ [1.0, 1.1, 1.2]))
    assert corner < core
    for module in (corner, (core + rod) // 2, rod + 2, rod + 1000, len(CHAIN) - 1):
        way = _free_way(positions, module)
        page.evaluate("() => window.foldback.player.send({ do: 'select', module: null })")
        page.evaluate(CLICK, [module, way.tolist()])
        expect(page.locator("#panel-module h2")).to_contain_text(f"Module {module + 1} of ")
        carried = 2 * (module - CHAIN.module.rigid_links)
        for k, angle in enumerate(angles[carried : carried + 2] if carried >= 0 else ()):
            assert _shown(page, k) == pytest.approx(np.rad2deg(angle), abs=0.06)


def _free_way(positions: np.ndarray[Any, Any], module: int) -> np.ndarray[Any, Any]:
    """A direction from which nothing else is in front of a module."""
    others = np.delete(positions, module, axis=0) - positions[module]
    for way in np.random.default_rng(module).normal(size=(400, 3)):
        unit = way / np.linalg.norm(way)
        along = others @ unit
        aside = np.linalg.norm(others - along[:, None] * unit, axis=1)
        if not ((along > 0) & (along < 5.0) & (aside < 0.9)).any():
            return unit
    raise AssertionError(f"module {module} is hidden")


def _shown(page: Page, hinge: int) -> float:
    text = page.locator('#panel-module [data-of="now"]').nth(hinge).inner_text()
    return float(text.replace("−", "-").rstrip("° "))
