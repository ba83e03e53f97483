"""Links and cameras: check that links reproduce views, and that the chain stays in the picture."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize

from bench.sections import Section
from bench.service.browsing import service_and_browser
from tests.browser.conftest import NO_VIEW, WAIT_FOR_REST
from tests.browser.test_small_frames import MIN_PICTURE_SHARE, PICTURE_SHARE
from tests.server.service_process import Service

SHAPES: Final = (
    *("tetra-ring", "mallet-24", "tetra-dodecahedron", "wrench-24", "box-4x4x4", "letter-f"),
    *("letter-l", "mallet-64", "four", "letter-t", "seven", "letter-e", "mallet-80", "wrench-80"),
    *("cross", "letter-h", "letter-s", "two", "letter-a", "tetra-bar"),
)
"""The 20 smallest shapes of the gallery without near duplicates."""
KINDS: Final = ("page", "embed", "file")
"""Kinds of pages that show a fold."""
SIZE: Final[ViewportSize] = {"width": 960, "height": 640}
"""Size of the browser window, CSS pixels."""
VIEWS_PER_FOLD: Final = 5
"""Number of camera positions of each fold, on each kind of page, for which the picture is compared
with the one that the link to it shows."""
MIN_DIFFERENCE_LEVELS: Final = 8
"""Difference of the red, green or blue value of a pixel (0 to 255) above which the pixel counts as
different in the comparison of two pictures. A smaller value counts rounding errors of drawing."""
MAX_DIFFERENT_SHARE: Final = 0.01
"""Target of the benchmark: at most this fraction of the pixels differs between a picture in the
page and the one that the link to it shows. Above it the target is reported as not met."""
FRAMES_PER_CHECK: Final = 10
"""Every n-th frame, n being this value, is checked for modules outside of the picture while the
camera follows the chain."""
FOLLOWED_SHAPES: Final = 10
"""Number of the gallery's shapes whose folds are checked for modules outside of the picture while
the camera follows the chain."""
SHARE_WINDOWS: Final = (
    ("fold", 1366, 768),
    ("fold", 390, 844),
    ("fold", 640, 360),
    ("embed", 300, 200),
)
"""Pages, with width and height of their window in CSS pixels, in which the chain's share of the
picture is measured."""
NO_WEBGL: Final = """HTMLCanvasElement.prototype.getContext = new Proxy(
  HTMLCanvasElement.prototype.getContext,
  { apply: (get, on, given) => given[0] === "webgl2" ? null : Reflect.apply(get, on, given) },
);"""
"""Disables WebGL, so that the page's own drawing stays. With software rendering, the 3D view lowers
its resolution after a motion, so that its edges differ from those of the same view opened at
rest."""
SETTLED: Final = """() => {
  const player = window.foldback?.player;
  return player?.shown?.exact && player.timeline.complete && !player.busy
    && document.getElementById("cover").classList.contains("gone");
}"""
"""Condition that is true once the exact frame is drawn and nothing moves."""
OUTSIDE: Final = """async ([step, camera]) => {
  const { player } = window.foldback;
  const { rig, timeline } = player;
  const half = rig.pitch / 2;
  const { field_of_view_rad: field } = timeline.bundle.header.camera;
  const { clientWidth: wide, clientHeight: high } = document.querySelector("main.stage");
  const soon = () => new Promise((done) => requestAnimationFrame(done));
  let [looked, cut] = [0, 0];
  for (let frame = 0; frame <= +document.getElementById("scrub").max; frame += step) {
    player.send({ do: "seek", frame });
    if (frame === 0) player.send({ do: "camera", camera });
    do await soon(); while (!player.shown.exact || player.shown.frame !== frame || player.busy);
    const { position: eye, target } = rig.eye;
    const minus = (a, b) => a.map((v, k) => v - b[k]);
    const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
    const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
    const unit = (a) => a.map((v) => v / Math.hypot(...a));
    const out = unit(minus(eye, target));
    const right = unit(cross([0, 0, 1], out));
    const up = cross(out, right);
    const scale = 1 / Math.tan(field / 2);
    looked++;
    const { positions } = player.shown;
    for (let k = 0; k < positions.length; k += 3) {
      const off = minus([0, 1, 2].map((axis) => positions[k + axis] * rig.pitch), eye);
      const depth = -dot(off, out);
      const [x, y] = [dot(off, right), dot(off, up)].map((v) => Math.abs(v) + half);
      if (depth <= 0 || scale * y / depth > 1 || scale * x / depth > wide / high) { cut++; break; }
    }
  }
  return [looked, cut];
}"""
"""Number of frames checked, and of those in which a module's centre and half width leave the
picture."""
CAMERAS: Final = (
    {"azimuth": None, "elevation": None, "distance": 1},
    {"azimuth": 0.7, "elevation": 1.1, "distance": 1},
    {"azimuth": -2.2, "elevation": -0.2, "distance": 0.4},
)
"""Cameras in radians and in multiples of the usual distance: unchanged, turned, zoomed in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """A view of a fold: its address and its picture, shape (height, width, 3)."""

    address: str
    picture: np.ndarray


def link_views(reference_seconds: float) -> Section:
    """Turn each fold with the mouse, open the page's address elsewhere, and compare pictures."""
    del reference_seconds
    section = Section(name="views")
    with service_and_browser() as (service, browser, folder):
        folds: dict[str, str] = {}
        for shape in SHAPES:
            folds[shape] = service.fold(shape=shape)["id"]
            service.wait_over(folds[shape])
        for shape, fold in folds.items():
            for kind in KINDS:
                address = _address(service, fold, kind, folder)
                section.rows.append(_compared(browser, address, shape, kind))
        outside = [
            _outside(browser, _address(service, folds[shape], "page", folder))
            for shape in SHAPES[:FOLLOWED_SHAPES]
        ]
        shares = [_share(browser, service, folds["wrench-24"], *size) for size in SHARE_WINDOWS]
    for kind in KINDS:
        worst = max(row["worst share"] for row in section.rows if row["kind"] == kind)
        section.add(
            f"{kind}: pixels that differ by more than {MIN_DIFFERENCE_LEVELS} levels, worst of "
            f"{len(SHAPES)} folds × {VIEWS_PER_FOLD} views",
            f"{100 * worst:.2f} %",
            f"≤ {100 * MAX_DIFFERENT_SHARE:g} %",
            worst <= MAX_DIFFERENT_SHARE,
        )
    looked, cut = np.sum(outside, axis=0)
    section.add(
        "frames that cut the chain off while it is followed", f"{cut} of {looked}", "0", cut == 0
    )
    for (kind, width, height), share in zip(SHARE_WINDOWS, shares, strict=True):
        section.add(
            f"{kind} at {width}×{height}: share of the picture",
            f"{100 * share:.0f} %",
            f"≥ {100 * MIN_PICTURE_SHARE:g} %",
            share >= MIN_PICTURE_SHARE,
        )
    return section


def _address(service: Service, fold: str, kind: str, folder: Path) -> str:
    if kind == "file":
        file = folder / f"{fold}.html"
        if not file.exists():
            file.write_bytes(service.http.get(f"/folds/{fold}/standalone.html").content)
        return file.as_uri()
    return f"{service.http.base_url}/{'folds' if kind == 'page' else 'embed'}/{fold}"


def _opened(browser: Browser, address: str, size: ViewportSize = SIZE) -> Page:
    context = browser.new_context(viewport=size, color_scheme="dark", reduced_motion="reduce")
    context.set_default_timeout(90_000)
    context.add_init_script(NO_VIEW)
    if address.startswith("file:"):  # the file contains its 3D view
        context.add_init_script(NO_WEBGL)
    page = context.new_page()
    page.goto(address)
    page.wait_for_function(SETTLED)
    return page


def _picture(page: Page) -> np.ndarray:
    page.wait_for_function(SETTLED)
    page.evaluate(WAIT_FOR_REST)
    png = page.locator("main.stage").screenshot()
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def _compared(browser: Browser, address: str, shape: str, kind: str) -> dict[str, Any]:
    """Return the difference between views turned with the mouse and those of their links."""
    page = _opened(browser, address)
    rng = np.random.default_rng(len(shape))
    frames = page.evaluate("() => +document.getElementById('scrub').max + 1")
    views = [_turned(page, int(frame), rng) for frame in np.linspace(0, frames - 1, VIEWS_PER_FOLD)]
    page.context.close()
    worst = 0.0
    for view in views:
        other_opened = _opened(browser, view.address)
        differs = np.abs(_picture(other_opened) - view.picture).max(axis=-1) > MIN_DIFFERENCE_LEVELS
        worst = max(worst, float(differs.mean()))
        other_opened.context.close()
    return {"shape": shape, "kind": kind, "worst share": worst}


def _turned(page: Page, frame: int, rng: np.random.Generator) -> Shown:
    """Go to a frame, drag the picture with the mouse and zoom, and read the address."""
    page.evaluate("(frame) => foldback.player.send({ do: 'seek', frame })", frame)
    page.wait_for_function(SETTLED)
    box = page.locator("main.stage").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    across, down = rng.integers(-120, 120, 2)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + across, y + down, steps=3)
    page.mouse.up()
    page.keyboard.press("-" if rng.random() < 0.5 else "+")
    page.wait_for_url(re.compile(rf"#frame={frame + 1}&.*camera="))
    page.mouse.move(1, 1)
    page.wait_for_timeout(600)  # until the address describes the view at rest
    picture = _picture(page)
    return Shown(address=page.url, picture=picture)


def _outside(browser: Browser, address: str) -> tuple[int, int]:
    page = _opened(browser, address)
    result = [page.evaluate(OUTSIDE, [FRAMES_PER_CHECK, camera]) for camera in CAMERAS]
    page.context.close()
    looked, cut = np.sum(result, axis=0)
    return int(looked), int(cut)


def _share(
    browser: Browser, service: Service, fold: str, kind: str, width: int, height: int
) -> float:
    path = f"{service.http.base_url}/{'folds' if kind == 'fold' else 'embed'}/{fold}"
    page = _opened(browser, path, {"width": width, "height": height})
    share = page.evaluate(PICTURE_SHARE)
    page.context.close()
    return float(share)
