"""The Download tab: one file for each purpose, and all files behind a fold."""

import re
from pathlib import Path

import httpx
from playwright.sync_api import expect

from tests.browser.conftest import Visit, open_tab


def test_each_purpose_gives_its_file(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    open_tab(page, "downloads")
    purposes = page.locator(".purposes")
    expect(page.locator("#all-files a").first).to_be_hidden()
    types = {}
    for link in purposes.locator("a").all():
        answer = httpx.get(str(link.evaluate("link => link.href")), timeout=60)
        assert answer.is_success, answer.text
        name = link.inner_text().strip()
        types[name] = re.findall(r'filename="?[^"]*\.(\w+)', answer.headers["content-disposition"])
    assert types == {
        "HTML page": ["html"],
        "MJCF model": ["xml"],
        "CSV table": ["csv"],
        "STL solid": ["stl"],
        "NPZ plan": ["npz"],
    }
    with page.expect_download() as download:
        purposes.get_by_role("button", name="BibTeX").click()
    assert download.value.suggested_filename == "foldback.bib"
    text = Path(download.value.path()).read_text(encoding="utf-8")
    assert f"\\url{{{page.url.partition('#')[0]}}}" in text
    purposes.get_by_role("button", name="Check it here").click()
    expect(page.locator("#check-said")).to_contain_text("This browser checked")
