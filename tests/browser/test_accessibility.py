"""axe-core reports nothing on the pages, in light and dark, on a phone and a laptop."""

from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from foldback.server.store.owner import new_token
from tests.browser.conftest import WIDTH, Visit, overflowing, preview_file, wait_for_preview
from tests.server.files.test_preview import CROSS, stl, voxels
from tests.server.routes import pages
from tests.server.service_process import SNAKE, Service

pytestmark = pytest.mark.long

SIZES = {"phone": (390, 844), "laptop": (1366, 768)}
SCHEMES: dict[Any, dict[str, list[str]]] = {"light": {}, "dark": {"runOnly": ["color-contrast"]}}
"""Options of axe for each colour scheme: in dark mode only the colours differ."""


def findings(page: Page) -> dict[str, list[str]]:
    """Return what axe finds in each state of a page: the rule and the elements that break it."""
    axe = Axe()
    violations_by_size: dict[str, list[str]] = {}
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        for scheme, rules in SCHEMES.items():
            page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            page.evaluate("new Promise(requestAnimationFrame)")  # scripts have changed the theme
            # The 3D view is a page of its own, made by viser.
            options: dict[str, Any] = {"resultTypes": ["violations"], "iframes": False, **rules}
            violations = axe.run(page, options=options).response["violations"]
            results = [
                f"{violation['id']}: {', '.join(node['target'][0] for node in violation['nodes'])}"
                for violation in violations
            ]
            if results:
                violations_by_size[f"{size}, {scheme}"] = results
    return violations_by_size


PAGES = (
    *(path for path in pages() if path != "/docs"),  # takes a while to open, and is tested below
    *("/gallery?q=nothing-is-called-this", "/folds/nosuchfold", "/previews/nosuchpreview"),
)


@pytest.mark.parametrize("path", PAGES)
def test_pages_without_a_fold_are_accessible(visit: Visit, path: str) -> None:
    page = visit(path)
    assert findings(page) == {}
    page.set_viewport_size({"width": 320, "height": 640})
    assert page.evaluate(WIDTH) == 320  # nothing needs scrolling sideways
    assert overflowing(page) == {}


def test_api_page_is_accessible(visit: Visit) -> None:
    page = visit("/docs")
    page.locator(".opblock").first.wait_for()
    computed_findings = findings(page)
    page.locator(".opblock-summary-control").first.click()
    page.locator(".opblock-body").first.wait_for()
    assert (computed_findings, findings(page)) == ({}, {})


def test_paper_with_a_film_is_accessible(visit: Visit) -> None:
    page = visit("/paper")
    page.locator(".run-where").first.click()
    page.locator(".run-view.moving").wait_for()
    assert findings(page) == {}


def test_my_folds_is_accessible(visit: Visit, service: Service) -> None:
    token = new_token()
    fold = service.fold(SNAKE, seed="960", token=token)
    service.preview("brick.stl", stl(), token=token)
    service.wait_over(fold["id"])
    page = visit("/health")
    page.evaluate("key => localStorage.setItem('foldback:token', key)", new_token())
    page.evaluate("key => localStorage.setItem('foldback:keys', JSON.stringify([key]))", token)
    page.goto("/my-folds")
    page.get_by_role("button", name="Show the key").click()
    page.locator("#previews li").wait_for()
    assert findings(page) == {}
    page.get_by_role("button", name="Rename").first.click()
    assert findings(page) == {}
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Forget the keys").click()
    assert findings(page) == {}


def test_editor_with_a_mistake_is_accessible(visit: Visit) -> None:
    page = visit("/shapes/new")
    page.get_by_label("Letter S").click()
    page.locator('[data-tool="move"]').click()
    computed_findings = findings(page)
    page.locator('[data-tool="path"]').click()
    page.locator('[data-x="2"][data-y="2"]').click()
    page.locator('[data-x="0"][data-y="0"]').click()
    expect(page.locator("#message")).not_to_be_empty()
    assert (computed_findings, findings(page)) == ({}, {})


def test_axe_finds_broken_elements(visit: Visit) -> None:
    page = visit("/folds/nosuchfold")
    page.locator(".message > p").first.evaluate("p => { p.style.color = '#777'; }")
    page.locator(".mark").evaluate("mark => { mark.ariaLabel = ''; mark.textContent = ''; }")
    computed_findings = findings(page)
    assert set(computed_findings) == {f"{size}, {scheme}" for size in SIZES for scheme in SCHEMES}
    assert [text.partition(":")[0] for text in computed_findings["phone, light"]] == [
        "color-contrast",
        "link-name",
    ]


def test_landing_is_accessible(visit: Visit) -> None:
    page = visit("/")
    page.locator("#type").click()
    page.locator(".options > summary").click()
    page.locator("#preset").select_option("paper")
    page.locator("#paper-settings > summary").click()
    page.locator("#angles").fill("no signs")
    page.locator("#typed").click()
    expect(page.locator("#drop-message")).to_have_attribute("data-tone", "bad")
    assert findings(page) == {}


def test_preview_is_accessible(visit: Visit) -> None:
    page = visit("/", view=False)
    preview_file(page, "cross.json", voxels(CROSS, name="Cross"))
    page.locator("#repairs .button").first.wait_for()
    computed_findings = [findings(page)]
    page.goto("/")
    preview_file(page, "brick.stl", stl())
    page.locator("#cover.drawn, #cover.gone").wait_for(state="attached")
    page.locator(".more > summary").click()
    page.locator("#robot-settings > summary").click()
    computed_findings.append(findings(page))
    page.locator("#preset").select_option("paper")
    page.locator("#paper-settings > summary").click()
    computed_findings.append(findings(page))
    page.locator("[name=world][value=table]").check(force=True)
    wait_for_preview(page)
    expect(page.locator("#table-settings")).to_be_visible()
    assert [*computed_findings, findings(page)] == 4 * [{}]


def test_folds_are_accessible(visit: Visit, service: Service, tmp_path: Path) -> None:
    good = service.fold(shape="wrench-24")["id"]
    bad = service.fold(shape="wrench-80", module_size=1.0)["id"]
    for tone, fold, tabs in (
        ("bad", bad, ("properties", "attempts")),
        ("good", good, ("properties", "downloads", "plots")),
    ):
        service.wait_over(fold)
        page = visit(f"/folds/{fold}#frame=31&module=7&from=21&to=61", view=False)
        expect(page.locator("#verdict")).to_have_attribute("data-tone", tone)
        page.locator("#cover.gone").wait_for(state="attached")
        for tab in tabs:
            page.locator(f"#tab-{tab}").click()
            expect(page.locator(f"#panel-{tab}")).to_be_visible()
            assert findings(page) == {}, (tone, tab)
    page.locator("#tab-properties").click()
    page.get_by_role("button", name="Check this plan").click()
    expect(page.locator("#check [role=status]")).to_contain_text("This browser checked")
    assert findings(page) == {}
    dialogs = {
        "film": "film-dialog",
        "share": "sharing",
        "compare": "compare-dialog",
        "keys": "keys-dialog",
    }
    for button, dialog in dialogs.items():
        page.locator(f"#{button}").click()
        expect(page.locator(f"#{dialog}")).to_be_visible()
        assert findings(page) == {}, dialog
        page.keyboard.press("Escape")
    assert findings(visit("/gallery?status=verified")) == {}
    file = tmp_path / "fold.html"
    file.write_bytes(service.http.get(f"/folds/{good}/standalone.html").content)
    for path in (f"/compare?a={good}&b={bad}", f"/embed/{good}", file.as_uri()):
        page = visit(path, view=False)
        expect(page.locator("#play")).to_be_enabled()
        assert findings(page) == {}, path
