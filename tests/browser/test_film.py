"""Film of a fold that the browser makes: its file, its fallback, and its end by the visitor."""

import base64
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import Visit

PLAYED = """async (address) => {
  const video = document.createElement("video");
  video.src = address;
  await new Promise((done) => { video.onloadeddata = video.onerror = done; });
  if (video.error) return video.error.message;
  video.currentTime = 1e9;
  await new Promise((done) => { video.onseeked = done; });
  return [video.videoWidth, video.videoHeight, video.duration];
}"""
"""Function that opens a video, seeks its end, and returns its size and length in seconds."""
RECORDED = """async () => {
  const [{ Pictures }, { record }, { recordingType }] = await Promise.all(
    ["pictures", "record", "formats"].map((name) => import(`/static/js/film/${name}.js`)),
  );
  const options = { width: 320, height: 180, seconds: 1, whole: true, title: "T", stops: [] };
  const { player } = window.foldback;
  player.lookAt([2, 3]);
  const pictures = new Pictures(player, options);
  await pictures.prepare();
  const { signal } = new AbortController();
  const film = await record(recordingType(), { pictures, signal, progress() {} });
  const { view } = pictures.rig;
  const whole = pictures.rig.whole(player.timeline.snapshot(player.timeline.last), view);
  return [film.type, view.distance / whole.distance, await new Promise((done) => {
    const reader = new FileReader();
    reader.onload = () => done(reader.result);
    reader.readAsDataURL(film);
  })];
}"""
"""Function that makes a small film without WebCodecs while the page looks at two modules.

It returns the film's type, the distance of the camera in the end as a multiple of that from which
it sees the whole chain, and the film's data URL."""


def played(page: Page, address: str) -> list[float]:
    """Return width, height and length of a video, which pages of the service may not play."""
    page.goto("about:blank")
    return page.evaluate(PLAYED, address)


def test_film_is_made_and_plays(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.wait_for_function("() => window.foldback?.timeline.complete")
    page.locator("#film").click()
    dialog = page.get_by_role("dialog", name="Make a film")
    dialog.get_by_label("Square").check()
    dialog.get_by_label("Length").select_option("5")
    dialog.get_by_role("button", name="Make film").click()
    expect(dialog.get_by_role("button", name="Cancel")).to_be_focused()
    expect(dialog.get_by_role("status")).to_contain_text("Your film is ready: 5 s, MP4")
    with page.expect_download() as download:
        dialog.get_by_role("button", name="Download").click()
    assert download.value.suggested_filename.endswith(".mp4")
    film = Path(download.value.path()).read_bytes()
    address = f"data:video/mp4;base64,{base64.b64encode(film).decode()}"
    assert played(page, address) == [1080, 1080, pytest.approx(5.0, abs=0.05)]
    assert len(film) < 8e6  # bytes


def test_film_can_be_cancelled(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.wait_for_function("() => window.foldback?.timeline.complete")
    page.locator("#film").click()
    dialog = page.get_by_role("dialog", name="Make a film")
    dialog.get_by_label("Captions from the tour").check()
    expect(dialog.get_by_label("Length")).to_have_value("30")
    dialog.get_by_role("button", name="Make film").click()
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog.get_by_role("status")).to_have_text("Cancelled.")
    expect(dialog.get_by_role("button", name="Make film")).to_be_focused()


def test_film_is_recorded_where_the_browser_has_no_encoder(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.wait_for_function("() => window.foldback?.timeline.complete")
    kind, distance, address = page.evaluate(RECORDED)
    assert kind in {"video/mp4", "video/webm"}
    assert distance == pytest.approx(1.0, abs=0.1)
    width, height, seconds = played(page, address)
    assert (width, height) == (320, 180)
    assert seconds > 0.9
