"""Sending a fold on: links, frames, one file, two folds, another shape, downloads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from planner.plan.plan import Plan
from tests.browser.conftest import NO_WEBGL, Visit, picture, seek, visits
from tests.server.service import SNAKE, Service
from tests.web.blog import Blog
from web.static_files import STATIC

EXAMPLE = Path(__file__).parents[2] / "examples" / "embedding.html"
DRAWN = "() => !window.foldback.player.sketch.waiting"
"""Whether the page's own drawing, which comes before the 3D view, has come."""


@pytest.mark.long
def test_link_shares_frame_and_module(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    expect(page.locator("#scrub")).to_be_enabled()
    seek(page, 30)
    page.evaluate("() => window.foldback.player.send({ do: 'select', module: 7 })")
    page.locator("#share").click()
    shown = page.locator("#share-link")
    expect(shown).to_have_value(re.compile(rf"/folds/{wrench}\?view=31,,,1#frame=31&module=8$"))
    link = shown.input_value()
    page.keyboard.press("Escape")
    page.evaluate("() => { location.hash = '#frame=12&from=8&to=20'; }")
    expect(page.locator("#r-frame")).to_have_text(re.compile("Frame 12 of"))
    expect(page.locator("#range-to")).to_have_attribute("aria-valuenow", "20")
    assert page.evaluate("() => window.foldback.player.selected") is None
    page.evaluate("() => { location.hash = '#frame=31&module=8'; }")
    expect(page.locator("#panel-module h2")).to_contain_text("Module 8 of ")
    expect(page.locator("#range")).to_be_hidden()
    page.locator("#share").click()
    page.locator("#share-here").uncheck()
    assert page.locator("#share-link").input_value().endswith(f"/folds/{wrench}")

    other = visit(link, view=False)
    expect(other.locator("#r-frame")).to_have_text(re.compile("Frame 31 of"))
    expect(other.locator("#panel-module h2")).to_contain_text("Module 8 of ")
    expect(other.locator("#cancel")).to_be_hidden()


def test_fold_is_embedded_in_another_site(visit: Visit, blog: Blog, wrench: str) -> None:
    page = visit(f"/folds/{wrench}#frame=12", view=False)
    page.locator("#share").click()
    expect(page.locator("#share-embed")).to_have_value(re.compile("iframe"))
    blog.html = f"<!doctype html><title>A blog</title>{page.locator('#share-embed').input_value()}"
    reader = visit(blog.origin, width=640, height=400, view=False)
    inside = reader.frame_locator("iframe")
    expect(inside.locator("#r-frame")).to_have_text(re.compile("Frame 12 of"))
    inside.locator("#forward").click()
    expect(inside.locator("#r-frame")).to_have_text(re.compile("Frame 13 of"))
    expect(inside.locator("a.whole")).to_have_attribute("href", f"/folds/{wrench}")
    # The page of the fold itself stays out of other sites.
    blog.html = blog.html.replace("/embed/", "/folds/")
    with reader.expect_console_message(lambda said: "frame-ancestors" in said.text):
        reader.reload()
    expect(reader.frame_locator("iframe").locator("#bar")).to_have_count(0)


@pytest.mark.parametrize("kind", ["service", "file"])
def test_element_shows_a_fold_and_does_what_it_is_told(
    visit: Visit, blog: Blog, service: Service, wrench: str, tmp_path: Path, kind: str
) -> None:
    example, origin = EXAMPLE.read_text(), service.http.base_url
    if kind == "service":
        script = f"{origin}/static/foldback-fold.js"
        blog.html = example.replace('src="foldback-fold.js"', f'src="{script}"')
        address = f"{blog.origin}/?src={origin}/folds/{wrench}"
    else:
        (tmp_path / EXAMPLE.name).write_text(example)
        (tmp_path / "foldback-fold.js").write_bytes((STATIC / "foldback-fold.js").read_bytes())
        alone = service.http.get(f"/folds/{wrench}/standalone.html").content
        (tmp_path / "fold.html").write_bytes(alone)
        address = (tmp_path / EXAMPLE.name).as_uri()
    page = visit(address, script=NO_WEBGL)
    small, driven = page.locator("#small iframe"), page.locator("#driven iframe")
    expect(small.content_frame.locator("html")).to_have_attribute("data-theme", "dark")
    expect(small.content_frame.locator("#bar")).to_be_hidden()
    expect(page.locator("#toured iframe").content_frame.locator(".tour-caption")).to_be_visible()
    expect(driven).to_have_attribute("title", re.compile("wrench"))
    expect(driven).to_have_attribute("sandbox", re.compile("^allow-scripts "))

    now, last = page.locator("#now"), int(page.locator("#frame").get_attribute("max") or 0)
    page.locator("#frame").fill("30")
    expect(now).to_have_text(f"Frame 30 of {last}")
    page.evaluate(
        "() => { driven.setAttribute('controls', ''); driven.setAttribute('tour', '2'); }"
    )
    expect(driven.content_frame.locator("#bar")).to_be_visible()
    expect(driven.content_frame.locator(".tour-count")).to_have_text(re.compile("^2 of"))
    page.evaluate("() => driven.setAttribute('tour', '0')")
    page.locator("#frame").fill(str(last - 1))
    page.locator("#play").click()
    expect(now).to_have_text("Folded")
    # A page that is not the frame's is not heard; what is no fold is said.
    page.evaluate("() => postMessage({ foldback: 'state', frame: 7, frames: 9 }, '*')")
    assert page.evaluate("() => driven.currentFrame") == last
    page.evaluate("() => driven.setAttribute('src', 'javascript:document.title = 1')")
    expect(page.locator("#driven [role=alert]")).to_have_text(re.compile("expected the address"))
    if kind == "service":
        return
    page.evaluate("() => driven.setAttribute('src', 'missing.html')")
    expect(page.locator("#driven [role=alert]")).to_have_text(re.compile("^No fold answers"))


def test_tour_is_played_edited_and_kept(visit: Visit, service: Service) -> None:
    told = service.fold(SNAKE, seed="77")
    service.wait_over(told["id"])
    page = visit(f"/folds/{told['id']}", view=False)
    page.evaluate(
        "([id, token]) => localStorage.setItem(`foldback:owner:${id}`, token)",
        [told["id"], told["owner_token"]],
    )
    caption, stops = page.locator(".tour-caption"), page.locator(".tour-list li")
    page.locator("#tour").click()
    expect(caption).to_contain_text("The chain is straight")
    page.keyboard.press("PageDown")
    expect(caption).not_to_contain_text("The chain is straight")
    expect(page).to_have_url(re.compile("stop=2"))

    page.get_by_role("button", name="Edit", exact=True).click()
    drafted = stops.count()
    page.get_by_role("button", name="Add a stop here").click()
    expect(stops).to_have_count(drafted + 1)
    page.get_by_role("button", name="Undo").click()
    expect(stops).to_have_count(drafted)
    page.get_by_label("Caption of stop 1").fill("<b>Here</b> it begins.")
    page.get_by_role("button", name="Move down stop 1").click()
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("Tour saved")).to_be_visible()

    other = visit(f"/embed/{told['id']}#stop=2", view=False)
    expect(other.locator(".tour-caption")).to_have_text("<b>Here</b> it begins.")

    # So are numbers that the owner colours by.
    page.get_by_role("button", name="Close", exact=True).click()
    page.locator("#colour-by").select_option("own-file")
    box, numbers = page.locator(".own-values"), page.locator(".own-values input")
    numbers.set_input_files({"name": "a.csv", "mimeType": "text/csv", "buffer": b"1\n2\n"})
    expect(box.get_by_role("alert")).to_have_text(re.compile("^Got 2 rows with 1 number each"))
    heat = "Heat (K)\n" + "".join(f"{k}\n" for k in range(len(SNAKE)))
    numbers.set_input_files({"name": "a.csv", "mimeType": "text/csv", "buffer": heat.encode()})
    expect(page.locator("#legend-low")).to_have_text("0 K")
    box.get_by_role("button", name="Keep with this fold").click()
    expect(box).to_contain_text("Everyone with a link to this fold can see them.")
    other.evaluate("() => { location.hash = '#colour=own'; }")
    expect(other.locator("#legend-low")).to_have_text("0 K")
    expect(other.locator("#colour-by option:checked")).to_have_text("Heat")


@pytest.fixture(scope="module")
def offered(service: Service, wrench: str) -> Iterator[Page]:
    """A fold's page, with what it offers in the drawer: for several tests."""
    with visits(service) as visit:
        page = visit(f"/folds/{wrench}", view=False)
        page.locator("#details").click()
        page.locator("#tab-downloads").click()
        yield page


@pytest.mark.long
def test_standalone_file_plays_offline(offered: Page, visit: Visit, tmp_path: Path) -> None:
    offered.locator("#share").click()
    with offered.expect_download() as download:
        offered.get_by_role("link", name="A single HTML file").click()
    offered.keyboard.press("Escape")
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    assert path.suffix == ".html"

    alone = visit("about:blank", width=560, height=440, offline=True)
    thrown: list[str] = []
    asked: list[str] = []
    alone.on("pageerror", lambda error: thrown.append(str(error)))
    alone.on("request", lambda request: asked.append(request.url))
    alone.goto(path.as_uri())
    alone.locator("#sketch.gone").wait_for(state="attached")
    expect(alone.locator("#r-frame")).to_have_text(re.compile("Frame 1 of"))
    assert alone.evaluate(DRAWN)
    folded = picture(alone)
    alone.locator("#jump").select_option("straight")
    assert np.abs(picture(alone) - folded).max() > 50
    alone.locator("#details").click()
    alone.locator("#tab-plots").click()
    expect(alone.locator(".plot")).to_have_count(4)
    assert [url for url in asked if url.startswith("http")] == []
    assert thrown == []


@pytest.mark.long
def test_compare_plays_two_folds_together(visit: Visit, service: Service, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", width=960, height=440, view=False)
    page.locator("#compare").click()
    page.get_by_role("button", name="Direct servoing").click()
    page.wait_for_url("**/compare?a=*&b=*")
    direct = page.url.rsplit("b=", 1)[1]
    service.wait_over(direct)
    # What is said of it follows, though the page was opened before it was over.
    expect(page.locator("#side-1 .verdict")).to_have_text(re.compile("Verified"))
    page = visit(page.url, width=960, height=440)
    sides = [page.locator(f"#side-{k}") for k in range(2)]
    for side in sides:
        side.locator(".sketch.gone").wait_for(state="attached")
    expect(sides[1].locator("h2 a")).to_have_attribute("href", f"/folds/{direct}")
    assert service.state(direct)["preset"] == "direct"
    expect(page.locator("#colour-by")).to_be_in_viewport()
    told = page.locator("#keys-table").text_content()
    assert told
    assert "One frame back" in told
    assert "0.1 s" not in told  # the two have different times
    assert "Ten frames back, forward" in told
    frames = "() => [0, 1].map((k) => document.getElementById(`side-${k}`).textContent)"
    page.keyboard.press("End")
    expect(page.locator("#r-folded")).to_have_text("100 %")
    for side in sides:
        expect(side.locator(".side-now")).to_contain_text("Error")
    page.keyboard.press("Home")
    expect(page.locator("#r-phase")).to_have_text("Explosion")
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator("#scrub")).to_have_value("10")
    page.keyboard.press("Shift+ArrowLeft")
    expect(page.locator("#scrub")).to_have_value("0")
    before = page.evaluate(frames)
    page.keyboard.press("End")
    assert page.evaluate(frames) != before


@pytest.mark.long
def test_fold_is_refolded_into_another_shape(visit: Visit, service: Service, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.locator("#refold").click()
    page.locator("#refold-shapes").get_by_role("button", name="Mallet").click()
    page.wait_for_url(lambda url: "/folds/" in url and wrench not in url)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    names = page.locator("#phases span")
    expect(names).to_have_text(["Unfolding", "Playback"])
    refold = page.url.rsplit("/", 1)[1].partition("#")[0]
    service.wait_over(refold)  # its plan is written after the verdict
    plan = Plan.load(service.directory(refold) / "plan.npz")
    first = Plan.load(service.directory(wrench) / "plan.npz")
    assert np.allclose(plan.joint_angles_rad[0], first.chain.folded_rad, atol=1e-9)
    assert np.allclose(plan.joint_angles_rad[-1], plan.chain.folded_rad, atol=1e-9)
    page.keyboard.press("Home")
    expect(page.locator("#r-phase")).to_have_text("Unfolding")
    page.keyboard.press("End")
    expect(page.locator("#r-phase")).to_have_text("Playback")


@pytest.mark.long
def test_fold_is_smoothed_and_compared(visit: Visit, service: Service, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.locator("#smooth").click()
    page.wait_for_url(lambda url: "/folds/" in url and wrench not in url)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    expect(page.locator("#name")).to_have_text(re.compile(", smoothed$"))
    expect(page.locator("#smooth")).to_be_hidden()
    expect(page.locator("#phases span")).to_have_text(["Playback"])
    smoothed = page.url.rsplit("/", 1)[1].partition("#")[0]
    service.wait_over(smoothed)
    plan = Plan.load(service.directory(smoothed) / "plan.npz")
    page.locator("#details").click()
    rows = page.locator("#panel-properties table tbody tr")
    expect(rows.first).to_contain_text("Frames")
    told = rows.evaluate_all("(all) => all.map((r) => [...r.children].map((c) => c.textContent))")
    frames = [str(plan.smoothing[side]["frames"]) for side in ("before", "after")]
    assert told[0][:3] == ["Frames", *frames]
    ratio = plan.smoothing["after"]["frames"] / plan.smoothing["before"]["frames"]
    assert told[0][3] == f"× {ratio:.2f}"
    assert len(told) == len(plan.smoothing["after"])
    page.get_by_role("link", name="Compare side by side").click()
    page.wait_for_url(f"**/compare?a={wrench}&b={smoothed}")
    expect(page.locator("#side-1")).to_contain_text("smoothed")


@pytest.mark.long
def test_all_offered_downloads_work(offered: Page, service: Service) -> None:
    links = offered.locator("#panel-downloads .downloads a")
    expect(links.first).to_be_visible()
    names = links.evaluate_all("(all) => all.map((one) => [one.textContent, one.href])")
    assert len(names) >= 10
    for name, href in names:
        answer = service.http.get(href)
        assert answer.status_code == 200, name
        assert "attachment" in answer.headers["Content-Disposition"], name
        assert len(answer.content) > 60, name


@pytest.mark.long
def test_motors_are_judged_and_movie_is_made(offered: Page, tmp_path: Path) -> None:
    page = offered
    robot = page.locator("form.options").nth(1)
    robot.get_by_role("button").click()
    said = page.locator(".movie-state").nth(1)
    expect(said).to_contain_text("or more are strong enough")
    robot.locator("[name=motor_torque]").fill("0.001")
    robot.get_by_role("button").click()
    expect(said).to_contain_text("is too weak for")
    robot.locator("[name=motor_torque]").fill("100000")
    robot.get_by_role("button").click()
    expect(said).to_contain_text("is enough")
    movie = page.locator("form.options").nth(0)
    movie.locator("[name=format]").select_option("gif")
    movie.locator("[name=seconds]").select_option("6")
    expect(movie.locator("[name=size]")).to_have_value("640x360")
    for name, little in (("size", "160x90"), ("seconds", "1")):  # which is computed sooner
        movie.locator(f"[name={name}] option:checked").evaluate(
            "(option, little) => { option.value = little; }", little
        )
    movie.get_by_role("button").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="Download the GIF").click()
    path = tmp_path / "fold.gif"
    download.value.save_as(path)
    assert path.read_bytes()[:4] == b"GIF8"


def test_pages_name_their_social_picture(service: Service, wrench: str) -> None:
    for path, drawn in ((f"/folds/{wrench}", f"folds/{wrench}"), ("/", "featured")):
        page = service.http.get(path).text
        found = re.search(r'<meta property="og:image" content="([^"]+)"', page)
        assert found and found[1] == f"{service.http.base_url}/{drawn}/picture.png"


SMALL = {"width": 640, "height": 440}
LEVELS = 8
"""Difference of a pixel that is not seen."""
PLACES = (
    "#frame=25&camera=30,40,1.3",
    "#frame=60&camera=-100,-20,0.5&colour=chain&theme=light",
    "#frame=100&camera=10,15,0.8,0.05,-0.1&follow=0&module=4",
    "#frame=40&camera=,,1.5&path=1",
    "#frame=1",
)


def off(page: Page, other: Page) -> float:
    """Share of pixels by which two pages differ."""
    a, b = picture(page), picture(other)
    return float((np.abs(a - b).max(axis=-1) > LEVELS).mean())


def test_turned_view_is_in_its_link(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}#frame=60", view=False, **SMALL)
    expect(page.locator("#scrub")).to_be_enabled()
    box = page.locator("main.stage").bounding_box()
    page.wait_for_function("() => window.foldback.player.shown?.exact")
    page.mouse.move(box["x"] + 240, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 140, steps=3)
    page.mouse.up()
    page.keyboard.press("d")
    page.keyboard.press("-")
    page.wait_for_url(re.compile(r"#frame=60&camera=-?[\d.]+,[\d.]+,1\.15$"))
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "true")
    other = visit(page.url, view=False, **SMALL)
    expect(other.locator("#r-frame")).to_have_text(re.compile("Frame 60 of"))
    other.wait_for_function("() => window.foldback.player.shown?.exact")
    assert off(page, other) <= 0.01
    page.locator("#sides").select_option("reset")
    page.wait_for_url(re.compile(r"#frame=60$"))
    assert off(page, other) > 0.01


def test_picture_of_the_view_is_saved(visit: Visit, wrench: str, tmp_path: Path) -> None:
    page = visit(f"/folds/{wrench}#frame=60&camera=30,20,1", view=False)
    expect(page.locator("#scrub")).to_be_enabled()
    page.locator("#share").click()
    expect(page.locator("#share-link")).to_have_value(
        re.compile(r"\?view=60,30,20,1#frame=60&camera=30,20,1$")
    )
    shown = page.locator("main.stage").bounding_box()
    assert shown
    for scale, transparent in ((3, False), (1, True)):
        page.locator("#picture-scale").select_option(str(scale))
        page.locator("#picture-clear").set_checked(transparent)
        with page.expect_download() as download:
            page.locator("#picture-save").click()
        path = tmp_path / f"{scale}.png"
        download.value.save_as(path)
        with Image.open(path) as saved:
            size = [scale * shown[side] for side in ("width", "height")]
            assert saved.size == pytest.approx(size, abs=scale)
            alpha = np.asarray(saved.convert("RGBA"))[..., 3]
        assert (alpha.min() == 0) == transparent
        assert alpha.max() == 255


@pytest.mark.long
@pytest.mark.parametrize("kind", ["page", "embed", "standalone"])
def test_link_shows_another_browser_the_same_picture(
    visit: Visit, service: Service, wrench: str, tmp_path: Path, kind: str
) -> None:
    address = f"/{'embed' if kind == 'embed' else 'folds'}/{wrench}"
    if kind == "standalone":
        path = tmp_path / "fold.html"
        path.write_bytes(service.http.get(f"/folds/{wrench}/standalone.html").content)
        address = path.as_uri()
    for hash_ in PLACES:
        first = visit(address + hash_, width=640, height=480)
        first.locator("#sketch.gone").wait_for(state="attached")
        # What the page itself says of what it shows leads to the same.
        here = first.evaluate(
            "() => { dispatchEvent(new Event('input')); foldback.player.show(true);"
            " foldback.player.tell('camera'); }"
        )
        assert here is None
        picture(first)
        first.wait_for_timeout(400)
        other = visit(first.url, width=640, height=480)
        other.locator("#sketch.gone").wait_for(state="attached")
        assert off(first, other) <= 0.01, (kind, hash_, first.url)
        assert "frame=" in first.url
        for page in (first, other):
            page.close()
