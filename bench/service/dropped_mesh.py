"""A dropped mesh: from an STL file to a preview, a fold in motion and its verdict, in Chromium."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from playwright.sync_api import Browser, ViewportSize

from bench.sections import Section
from bench.service.browsing import service_and_browser

DROPPED_MESHES: Final = 4
"""Number of slightly different meshes that are uploaded and folded, none of which is known to the
service; the median time counts."""
SIZE: Final[ViewportSize] = {"width": 1366, "height": 768}
"""Size of the browser window, CSS pixels."""
WARM: Final = "wrench-24"
"""Shape that is folded first, so that the worker is warm."""
PAUSE_BEFORE_DROP_MS: Final = 1500
"""Pause between opening the landing page and uploading the mesh, in ms, as a visitor takes time to
find a file."""
FOLDABLE: Final = "() => document.getElementById('fold')?.disabled === false"
"""Condition that is true once the preview offers to fold."""
MOVING: Final = """() => {
  const cover = document.getElementById("cover");
  return cover?.classList.contains("gone") && (window.foldback?.player.shown?.frame ?? 0) > 0;
}"""
"""Condition that is true once a frame after the first one is drawn."""
VERIFIED: Final = (
    "() => /^Safe/.test(document.getElementById('verdict')?.textContent?.trim() ?? '')"
)
"""Condition that is true once the page shows the verdict "Safe"."""
MAX_AFTER_FOLD_S: Final = {"first motion": 1.0, "verified": 5.0}
"""Maximum seconds after *Fold*, on two cores that do nothing else."""


def dropped_mesh(reference_seconds: float) -> Section:
    """Drop each mesh and press *Fold*; times in seconds and in reference runs."""
    section = Section(name="dropped")
    with service_and_browser() as (service, browser, folder):
        service.wait_over(service.fold(shape=WARM)["id"])
        for drop in range(DROPPED_MESHES):
            mesh = folder / f"torus-{drop}.stl"
            trimesh.creation.torus(10 + 0.05 * drop, 4).export(mesh)
            section.rows.append(_drop(browser, str(service.http.base_url), mesh))
    for name, bar in MAX_AFTER_FOLD_S.items():
        seconds = float(np.median([row[name] for row in section.rows]))
        section.add(
            f"torus of 160 modules, from Fold to {name}, median of {DROPPED_MESHES}",
            f"{seconds:.2f} s = {seconds / reference_seconds:.1f} reference runs",
            f"≤ {bar:g} s",
            seconds <= bar,
        )
    return section


def _drop(browser: Browser, address: str, mesh: Path) -> dict[str, Any]:
    """Return the seconds after the drop, and after *Fold*, of what a visitor sees."""
    context = browser.new_context(viewport=SIZE, base_url=address)
    context.set_default_timeout(90_000)
    page = context.new_page()
    page.goto("/")
    page.wait_for_timeout(PAUSE_BEFORE_DROP_MS)
    start_s = time.monotonic()
    page.locator("input[type=file]").first.set_input_files(mesh)
    page.wait_for_url("**/previews/**")
    preview = time.monotonic() - start_s
    page.wait_for_function(FOLDABLE)
    foldable = time.monotonic() - start_s
    page.locator("#fold").click()
    start_s = time.monotonic()
    page.wait_for_url("**/folds/**")
    page.wait_for_function(MOVING, polling=20)
    motion = time.monotonic() - start_s
    page.wait_for_function(VERIFIED, polling=50)
    verified = time.monotonic() - start_s
    context.close()
    return {
        "preview": preview,
        "foldable": foldable,
        "first motion": motion,
        "verified": verified,
    }
