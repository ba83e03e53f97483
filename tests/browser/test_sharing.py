"""Sharing a fold: links, frames, one file, comparison, refolding, downloads."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

from foldback.planner.parameters.settings_text import SETTINGS
from foldback.web.static_files import STATIC
from tests.browser.conftest import NO_WEBGL, Visit, drag, keep_as_mine, open_tab, picture
from tests.server.service_process import STAIRS, Service
from tests.web.blog import Blog

EXAMPLE = Path(__file__).parents[2] / "examples" / "embedding.html"


def test_element_shows_a_fold_and_obeys_its_messages(
    visit: Visit, blog: Blog, service: Service, wrench: str
) -> None:
    origin = service.http.base_url
    script = f"{origin}/static/foldback-fold.js"
    blog.html = EXAMPLE.read_text().replace('src="foldback-fold.js"', f'src="{script}"')
    page = visit(f"{blog.origin}/?src={origin}/folds/{wrench}", script=NO_WEBGL)
    small, driven = page.locator("#small iframe"), page.locator("#driven iframe")
    expect(small.content_frame.locator("html")).to_have_attribute("data-theme", "dark")
    expect(small.content_frame.locator("#bar")).to_be_hidden()
    expect(small.content_frame.locator("#flat")).to_contain_text("WebGL is missing")
    expect(page.locator("#toured iframe").content_frame.locator("#tour-caption")).to_be_visible()
    expect(driven).to_have_attribute("title", re.compile("wrench"))
    expect(driven).to_have_attribute("sandbox", re.compile("^allow-scripts "))

    now, last = page.locator("#now"), int(page.locator("#frame").get_attribute("max") or 0)
    page.locator("#frame").fill("30")
    expect(now).to_have_text(f"Frame 30 of {last}")
    page.evaluate(
        "() => { driven.setAttribute('controls', ''); driven.setAttribute('tour', '2'); }"
    )
    expect(driven.content_frame.locator("#bar")).to_be_visible()
    expect(driven.content_frame.locator("#tour-count")).to_have_text(re.compile("^2 of"))
    page.evaluate("() => driven.setAttribute('tour', '0')")
    page.locator("#frame").fill(str(last - 1))
    page.locator("#play").click()
    expect(now).to_have_text("Folded")
    # Messages of other pages are ignored; an unknown fold is reported.
    page.evaluate("() => postMessage({ foldback: 'state', frame: 7, frames: 9 }, '*')")
    assert page.evaluate("() => driven.currentFrame") == last
    page.evaluate("() => driven.setAttribute('src', 'javascript:document.title = 1')")
    expect(page.locator("#driven [role=alert]")).to_have_text(re.compile("expected the address"))


def test_element_shows_a_file_beside_it(
    visit: Visit, service: Service, wrench: str, tmp_path: Path
) -> None:
    (tmp_path / "foldback-fold.js").write_bytes((STATIC / "foldback-fold.js").read_bytes())
    alone = service.http.get(f"/folds/{wrench}/standalone.html").content
    (tmp_path / "fold.html").write_bytes(alone)
    (tmp_path / "page.html").write_text(
        "<!doctype html><script src=foldback-fold.js></script>"
        "<foldback-fold id=driven src=fold.html></foldback-fold>"
    )
    page = visit((tmp_path / "page.html").as_uri(), script=NO_WEBGL)
    # The frame has no origin, so that its content cannot access the page.
    expect(page.locator("#driven iframe")).not_to_have_attribute("sandbox", re.compile("origin"))
    page.wait_for_function("() => driven.frames > 30")
    page.evaluate("() => driven.seek(30)")
    page.wait_for_function("() => driven.currentFrame === 30")
    page.evaluate("() => driven.setAttribute('src', 'missing.html')")
    expect(page.locator("#driven [role=alert]")).to_have_text(re.compile("^No fold answers"))


def test_tour_is_played_edited_and_stored(visit: Visit, service: Service) -> None:
    folded = service.fold(STAIRS, seed="77")
    service.wait_over(folded["id"])
    page = visit(f"/folds/{folded['id']}", view=False)
    keep_as_mine(page, folded)
    stops = page.locator(".tour-list li")
    page.locator("#loop").click()
    page.locator("#colour-by").select_option("speed")
    page.locator("#tour").click()
    expect(page.locator("#colour-by")).to_have_value("chain")
    expect(page.locator("#tour-caption")).to_contain_text("looks for a motion that unfolds it")
    page.keyboard.press("PageDown")
    expect(page).to_have_url(re.compile("stop=2"))

    page.get_by_role("button", name="Edit", exact=True).click()
    drafted = stops.count()
    page.get_by_role("button", name="Add a stop here").click()
    expect(stops).to_have_count(drafted + 1)
    page.get_by_role("button", name="Undo").click()
    expect(stops).to_have_count(drafted)
    page.get_by_label("Caption of stop 1").fill("<b>Here</b> it begins.")
    page.get_by_role("button", name="Move down: stop 1").click()
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("Tour saved")).to_be_visible()

    other_visits = visit(f"/embed/{folded['id']}#stop=2", view=False)
    expect(other_visits.locator("#tour-caption")).to_have_text("<b>Here</b> it begins.")

    # The tour gives back the colours and the loop that it changed.
    page.get_by_role("button", name="Close", exact=True).click()
    expect(page.locator("#colour-by")).to_have_value("speed")
    expect(page.locator("#loop")).to_have_attribute("aria-pressed", "true")

    # Only the owner can set numbers for the colours, too.
    page.locator("#colour-by").select_option("own-file")
    box, numbers = page.locator(".own-values"), page.locator(".own-values input")
    heat = "Heat (K)\n" + "".join(f"{k}\n" for k in range(len(STAIRS)))
    expect(box).to_be_visible()  # shown once its scripts are loaded
    numbers.set_input_files({"name": "a.csv", "mimeType": "text/csv", "buffer": heat.encode()})
    expect(page.locator("#legend-low")).to_have_text("0 K")
    box.get_by_role("button", name="Save with this fold").click()
    expect(box).to_contain_text("Everyone with a link to this fold can see these numbers.")
    other_visits.evaluate("() => { location.hash = '#colour=own'; }")
    expect(other_visits.locator("#legend-low")).to_have_text("0 K")
    expect(other_visits.locator("#colour-by option:checked")).to_have_text("Heat")

    # A way back to the options of the fold; only the owner can delete it.
    page.reload()
    page.locator("#ways").click()
    options = f"/folds/{folded['id']}/options"
    for name, address in (("Change options", options), ("More modules", f"{options}#modules")):
        link = page.locator("#ways-list").get_by_role("link", name=name)
        expect(link).to_have_attribute("href", address)
    page.get_by_role("button", name="Delete this fold").click()
    page.locator("#confirm-yes").click()
    page.wait_for_url("**/my-folds")
    assert service.http.get(f"/api/folds/{folded['id']}").status_code == 404


@pytest.mark.long
def test_compare_plays_and_turns_two_folds_together(
    visit: Visit, service: Service, wrench: str
) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.locator("#compare").click()
    expect(page.locator("#compare-settings input")).to_have_count(len(SETTINGS))
    page.get_by_role("button", name="Joints turned directly").click()
    page.wait_for_url("**/compare?a=*&b=*")
    direct = page.url.rsplit("b=", 1)[1]
    service.wait_over(direct)
    assert service.state(direct)["preset"] == "direct"
    sides = [page.locator(f"#side-{k}") for k in range(2)]
    # The texts are updated, although the page was opened before the fold ended.
    expect(sides[1].locator(".verdict")).to_have_text(re.compile("^Safe"))
    page.reload()
    expect(page.locator("#scrub")).to_be_enabled()
    expect(sides[1].locator("h2 a")).to_have_attribute("href", f"/folds/{direct}")
    page.keyboard.press("End")
    expect(page.locator("#r-folded")).to_have_text("100 %")
    for side in sides:
        expect(side.locator(".side-now")).to_contain_text("Joint error")
    page.keyboard.press("Home")
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator("#scrub")).to_have_value("10")

    left_canvas, right = (side.locator("canvas") for side in sides)
    before, box = right.screenshot(), left_canvas.bounding_box()
    drag(page, (box["x"] + 100, box["y"] + 150), (box["x"] + 160, box["y"] + 190))
    page.wait_for_url(re.compile(r"#frame=11&camera=-?[\d.]+,[\d.]+,1$"))
    assert right.screenshot() != before
    address = page.url
    page.reload()
    expect(page.locator("#r-frame")).to_have_text(re.compile("^Frame 11 of"))
    page.keyboard.press("ArrowRight")  # the address changes
    page.wait_for_url(address.replace("frame=11", "frame=12"))


@pytest.mark.long
@pytest.mark.parametrize("way", ["refold", "smooth"])
def test_fold_is_refolded_or_smoothed(visit: Visit, wrench: str, way: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.locator(f"#{way}").click()
    if way == "smooth":
        page.locator("#confirm-yes").click()
    if way == "refold":
        page.locator("#refold-shapes").get_by_role("button", name="Mallet").click()
    page.wait_for_url(lambda url: "/folds/" in url and wrench not in url)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Safe"))
    phases = {"refold": ["Unfolding", "Folding"], "smooth": ["Folding"]}
    expect(page.locator("#phases span")).to_have_text(phases[way])
    if way == "refold":
        return
    page.locator("#details").click()
    expect(page.locator("#panel-properties table tbody tr").first).to_contain_text("Frames")
    page.get_by_role("link", name="Compare side by side").click()
    page.wait_for_url(f"**/compare?a={wrench}&b=*")
    expect(page.locator("#side-1")).to_contain_text("smoothed")


@pytest.mark.long
def test_movie_is_made_and_downloaded(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    open_tab(page, "downloads")
    page.get_by_text("All files", exact=True).click()
    movie = page.locator("form.options").nth(0)
    movie.locator("[name=format]").select_option("gif")
    movie.locator("[name=seconds]").select_option("6")
    for name, little in (("size", "160x90"), ("seconds", "1")):  # a small movie is computed sooner
        movie.locator(f"[name={name}] option:checked").evaluate(
            "(option, little) => { option.value = little; }", little
        )
    movie.get_by_role("button").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="Download the GIF").click()
    assert download.value.path().read_bytes()[:4] == b"GIF8"


LEVELS = 8
"""Maximum invisible difference between pixel values, 0 to 255."""


def different_fraction(first: np.ndarray, second: np.ndarray) -> float:
    """Return the fraction of pixels in which two pictures differ visibly."""
    return float((np.abs(first - second).max(axis=-1) > LEVELS).mean())


def test_turned_view_is_in_its_link(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}#frame=60", width=640, height=440, view=False)
    expect(page.locator("#scrub")).to_be_enabled()
    box = page.locator("main.stage").bounding_box()
    page.wait_for_function("() => window.foldback.player.snapshot?.exact")
    drag(page, (box["x"] + 240, box["y"] + 100), (box["x"] + 300, box["y"] + 140))
    page.keyboard.press("d")
    page.keyboard.press("-")
    page.wait_for_url(re.compile(r"#frame=60&camera=-?[\d.]+,[\d.]+,1\.15$"))
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "true")
    turned = picture(page)
    page.reload()
    expect(page.locator("#r-frame")).to_have_text(re.compile("Frame 60 of"))
    page.wait_for_function("() => window.foldback.player.snapshot?.exact")
    assert different_fraction(picture(page), turned) <= 0.01
    page.locator("#sides").select_option("reset")
    page.wait_for_url(re.compile(r"#frame=60$"))
    assert different_fraction(picture(page), turned) > 0.01


def test_view_is_saved_as_a_picture_and_embedded(visit: Visit, blog: Blog, wrench: str) -> None:
    page = visit(f"/folds/{wrench}#frame=60&camera=30,20,1", view=False)
    expect(page.locator("#scrub")).to_be_enabled()
    page.locator("#share").click()
    link = page.locator("#share-link")
    expect(link).to_have_value(re.compile(r"\?view=60,30,20,1#frame=60&camera=30,20,1$"))
    page.locator("#share-here").uncheck()
    expect(link).to_have_value(re.compile(f"/folds/{wrench}$"))
    expect(page.get_by_role("link", name="A single HTML file")).to_have_attribute(
        "href", f"/folds/{wrench}/standalone.html"
    )
    bounding_box = page.locator("main.stage").bounding_box()
    assert bounding_box
    for scale, transparent in ((3, False), (1, True)):
        page.locator("#picture-scale").select_option(str(scale))
        page.locator("#picture-clear").set_checked(transparent)
        with page.expect_download() as download:
            page.locator("#picture-save").click()
        with Image.open(download.value.path()) as saved:
            size = [scale * bounding_box[side] for side in ("width", "height")]
            assert saved.size == pytest.approx(size, abs=scale)
            alpha = np.asarray(saved.convert("RGBA"))[..., 3]
        assert (alpha.min() == 0) == transparent
        assert alpha.max() == 255

    # The frame for other sites, of the finished fold.
    blog.html = f"<!doctype html><title>A blog</title>{page.locator('#share-embed').input_value()}"
    inside = visit(blog.origin, width=640, height=400, view=False).frame_locator("iframe")
    expect(inside.locator("#scrub")).to_be_enabled()
    expect(inside.locator("#legend")).to_be_hidden()  # controls of a frame are one row
    inside.locator("#more").click()
    inside.locator("#forward").click()
    expect(inside.locator("#r-frame")).to_have_text(re.compile("Frame 2 of"))
    expect(inside.locator("a.whole")).to_have_attribute("href", f"/folds/{wrench}")
