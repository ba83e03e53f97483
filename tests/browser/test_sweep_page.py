"""The page of a sweep: a cell shows its folds, on a laptop and on a phone."""

from pathlib import Path

from playwright.sync_api import Browser, expect

from foldback.planner.sweeps.map import write_map
from foldback.planner.sweeps.spec import SweepSpec

METHODS = ("auto", "peel", "a-method-with-quite-a-long-name")


def test_cell_leads_to_its_folds(browser: Browser, tmp_path: Path) -> None:
    spec = SweepSpec.of({"shapes": ["a"], "methods": {name: {} for name in METHODS}}, tmp_path)
    rows = {
        f"{k:024x}": {
            **{"key": f"{k:024x}", "shape": f"<b>shape {k % 9}", "method": METHODS[k % 3]},
            **{"seed": k // 9, "verified": k % 2 == 0, "verdict": f"verdict {k}", "cpu_s": 0.25},
            "planner_digest": "new",
        }
        for k in range(180)
    }
    (tmp_path / "plans" / f"{0:024x}").mkdir(parents=True)
    write_map(tmp_path, spec, rows, 0, is_running=False)
    for width, scheme in ((1366, "light"), (390, "dark")):
        page = browser.new_page(
            viewport={"width": width, "height": 800},
            color_scheme="dark" if scheme == "dark" else "light",
        )
        thrown: list[str] = []
        page.on("pageerror", lambda error, thrown=thrown: thrown.append(str(error)))
        page.goto(f"file://{tmp_path}/index.html")
        expect(page.locator("tbody tr")).to_have_count(100)
        page.get_by_role("button", name="Show more").click()
        expect(page.locator("tbody tr")).to_have_count(180)
        page.get_by_label("Only folds that are not verified").check()
        expect(page.locator("#count")).to_have_text("90 folds")
        page.get_by_label("Only folds that are not verified").uncheck()
        page.get_by_role("link", name="auto, <b>shape 0, 0: 1 of 1 verified").click()
        expect(page.locator("h2")).to_have_text("auto, <b>shape 0, 0")
        expect(page.locator("tbody tr")).to_have_count(1)
        expect(page.locator("tbody code")).to_have_text(f"foldback play plans/{0:024x}")
        page.get_by_role("link", name="Show all folds").click()
        expect(page.locator("h2")).to_have_text("All folds")
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert thrown == []
        page.context.close()
