"""Fold page in Firefox, with and without WebGL: scrub, play, select, plot, share."""

import re
from collections.abc import Iterator

import pytest

from tests.browser.firefox import Firefox, opened_firefox
from tests.server.service_process import Service

COMPLETE = "window.foldback?.timeline.complete"
WEBGL = "Boolean(document.createElement('canvas').getContext('webgl2'))"
SHOWN_FRAME = "document.querySelector('#r-frame').textContent"
ARROW_RIGHT, ENTER = "\ue014", "\ue007"
"""Keys in the code of WebDriver."""


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Firefox]:
    with opened_firefox(tmp_path_factory.mktemp("firefox")) as program:
        yield program


@pytest.mark.parametrize(
    "webgl",
    [pytest.param(True, marks=pytest.mark.long), False],
    ids=["webgl", "no-webgl"],
)
def test_fold_page_in_firefox(firefox: Firefox, service: Service, wrench: str, webgl: bool) -> None:
    with firefox.tab(webgl=webgl):
        _use(firefox, f"{str(service.http.base_url).rstrip('/')}/folds/{wrench}", webgl)
    assert firefox.errors == []


def _use(firefox: Firefox, address: str, webgl: bool) -> None:
    firefox.open(address)
    assert firefox.run(WEBGL) == webgl
    firefox.until(COMPLETE)
    firefox.click("#scrub")
    frame = firefox.run("Number(document.querySelector('#scrub').value)")
    assert frame > 1
    firefox.type(ARROW_RIGHT)
    firefox.until(f"{SHOWN_FRAME}.startsWith('Frame {frame + 2} of ')")
    firefox.click("#play")
    firefox.until(f"!{SHOWN_FRAME}.startsWith('Frame {frame + 2} of ')")
    firefox.click("#play")
    firefox.click("#details")
    firefox.click("#tab-module")
    firefox.click("#module-number")
    firefox.type("7" + ENTER)
    firefox.until("document.querySelector('#panel-module h2').textContent.startsWith('Module 7 ')")
    firefox.click("#tab-plots")
    firefox.until("document.querySelectorAll('.plot').length >= 4")
    firefox.click("#details")
    firefox.click("#share")
    link = firefox.until("document.querySelector('#share-link')?.value")
    shared = re.search(rf"{address}[?#].*frame=(\d+)", link)
    assert shared is not None, link
    firefox.open("about:blank")
    firefox.open(link)
    firefox.until(COMPLETE)
    firefox.until(f"{SHOWN_FRAME}.startsWith('Frame {shared[1]} of ')")
