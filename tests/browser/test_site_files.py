"""`foldback site`: relative links, and pages that work from a folder."""

import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest
from playwright.sync_api import Browser, expect

from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.sweeps.case import Row
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.sweep import SweepState
from foldback.server.cli.site import site, write_players
from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR
from tests.browser.conftest import MEDIA, open_tab

SERVICE = "https://fold.example.org"
PROJECT = "https://foldback.example.org"
MOVING = "([selector, before]) => document.querySelector(selector).value !== before"

ABORTED = "net::ERR_ABORTED"


@pytest.fixture(scope="module")
def site_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Site of three folds, two of them equal, in a directory below a path."""
    place = tmp_path_factory.mktemp("host")
    for name in ("a wrench & a mallet", "cube", "cube again"):
        (place / "folds" / name).mkdir(parents=True)
        packed = "wrench-80-to-mallet-80" if "wrench" in name else "tetra-cube-2"
        unpack((SHIPPED_FOLDS_DIR / f"{packed}.fold").read_bytes(), place / "folds" / name)
    out = place / "x" / "y"
    _write_sweep(place / "my sweep", place / "folds" / "cube")
    site(
        out,
        [place / "folds"],
        [place / "my sweep"],
        finished=False,
        service=SERVICE,
        project=PROJECT,
    )
    return out


def _write_sweep(directory: Path, fold: Path) -> None:
    """Write the directory of a sweep with one fold, whose plan is kept."""
    key = "0" * 24
    row: Row = {"key": key, "shape": "cube", "seed": 0, "verdict": "verified (simulated)"}
    plan = shutil.copytree(fold, directory / "plans" / key)
    spec = SweepSpec.of({"shapes": "wrench-24"}, directory)
    method = {"method": "auto", "planner_digest": "a", "verified": True, "simulated": True}
    with SweepState.opened(spec, directory) as state:
        state.add(row | method)
        write_players(directory / "players", [plan])


class Links(HTMLParser):
    """Links of a page, and the anchors in it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.addresses: set[str] = set()
        self.places = {""}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("href", "src", "action") and value and not value.startswith("data:"):
                self.addresses.add(value)
            if name == "data-timeline":
                self.addresses.add(f"{value}.js")
            if name == "id" and value:
                self.places.add(value)


def test_every_link_of_a_site_leads_to_something_in_it(site_dir: Path) -> None:
    pages = {path: Links(path) for path in site_dir.rglob("*.html")}
    names = {path.relative_to(site_dir).as_posix() for path in pages}
    fold = "folds/a-wrench-a-mallet.html"
    player = f"sweeps/my-sweep/players/folds/{'0' * 24}.html"
    assert {"sweeps/my-sweep/index.html", player} <= names
    assert (
        f'"players/folds/{"0" * 24}.html"' in (site_dir / "sweeps/my-sweep/index.html").read_text()
    )
    assert {"index.html", "paper.html", "benchmarks.html", fold, "folds/cube.html"} <= names
    reached: set[Path] = set()
    for path, links in pages.items():
        for link in links.addresses - {SERVICE, PROJECT}:
            name, place = urldefrag(unquote(link))
            target = (path.parent / name).resolve() if name else path
            assert target.is_file() and target.is_relative_to(site_dir), (path, link)
            assert not place or place in pages[target].places or "icons" in place, (path, link)
            reached.add(target)
    first = (site_dir / "index.html").read_text(encoding="utf-8")
    titles = re.findall(r'class="card-title">([^<]*)<', first)
    assert len(set(titles)) == 3 and "Wrench → Mallet" in titles
    # A stranger reads what a fold is, and finds the project.
    assert "a long straight chain of robot modules turns into a solid shape" in first
    assert f'<a href="{PROJECT}">foldback</a>' in first
    # Only the pages' data name viser's client, only third-party pages use the element, and the
    # gallery's script derives the addresses of moving drawings from those of drawings.
    moving = {path for path in site_dir.glob("folds/*/motion.svg")}
    assert {path.parent.with_suffix(".html") for path in moving} == set(
        site_dir.glob("folds/*.html")
    )
    unused = {path for path in site_dir.rglob("*") if path.is_file()} - reached - moving
    # The next site in this directory replaces the files of the list.
    kept_names = ("view.html", "foldback-fold.js", ".foldback-files.json")
    players = site_dir / "sweeps" / "my-sweep" / "players"
    of_sweep = {players / name for name in kept_names[:2]}
    assert unused == {site_dir / name for name in kept_names} | of_sweep
    assert SERVICE in pages[site_dir / "index.html"].addresses
    assert SERVICE in pages[site_dir / "folds" / "cube.html"].addresses


def test_site_plays_from_a_folder_without_a_server(site_dir: Path, browser: Browser) -> None:
    context = browser.new_context(offline=True, viewport={"width": 800, "height": 480}, **MEDIA)
    page = context.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda log: wrong.append(log.text) if log.type == "error" else None)
    # Leaving a page ends the requests for its pictures.
    page.on("requestfailed", lambda r: wrong.append(r.url) if r.failure != ABORTED else None)
    page.goto(f"{site_dir.as_uri()}/index.html")
    drawn = page.locator(".card img").first
    assert drawn.evaluate("image => image.decode().then(() => image.naturalWidth)") > 0
    page.emulate_media(reduced_motion="no-preference")
    card = page.locator("a[href='folds/cube.html']").first
    card.hover()
    expect(card.locator("img:visible[src$='folds/cube/motion.svg']")).to_have_count(1)
    page.emulate_media(reduced_motion="reduce")
    card.click()
    page.locator("#sketch.gone").wait_for(state="attached")  # the 3D view is shown
    page.locator("#play").click()
    page.wait_for_function(MOVING, arg=["#scrub", page.locator("#scrub").input_value()])
    open_tab(page, "plots")
    expect(page.locator(".plot").first).to_be_visible()
    page.get_by_role("link", name="Gallery").click()
    page.get_by_role("link", name="Paper").first.click()
    page.locator(".headline .run-start").click()
    page.wait_for_function(MOVING, arg=[".headline .run-scrub", "0"])
    page.goto(f"{site_dir.as_uri()}/kiosk.html?folds=cube")
    expect(page.frame_locator("iframe").locator("#tour-caption")).to_be_visible()
    assert wrong == []
    page.context.close()
