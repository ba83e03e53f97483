"""Retention and visibility of folds: the pages agree with the settings."""

import re
from types import SimpleNamespace

import pytest
from fastapi import FastAPI
from pydantic import ValidationError

from foldback.server.pages import privacy
from foldback.server.pages.privacy import visibility
from foldback.server.settings import MIB_BYTES, Settings
from foldback.words.fold import ShownFold
from foldback.words.lifetime import time_words
from tests.case import case
from tests.server.asgi import send_request
from tests.server.rows import a_fold


def words(**settings: object) -> str:
    """Text of the page on one line."""
    app = FastAPI()
    app.state.context = SimpleNamespace(settings=Settings.model_validate(settings))
    app.include_router(privacy.router)
    answer = send_request(app, "/privacy")
    assert (answer.status_code, answer.headers["x-robots-tag"]) == (200, "all")
    return re.sub(r"\s+", " ", answer.text)


def test_privacy_page_shows_the_settings() -> None:
    plain = words()
    assert (
        "A fold is stored until you delete it." in plain
        and "storage runs low, the folds" not in plain
    )
    assert "Who runs this service" not in plain
    bounded = words(
        keep_days=30, storage_bytes=64 * MIB_BYTES, preview_keep_s=7200, movies_of_fold=3,
        imprint_url="https://example.org/imprint?a=1&b=2",
    )  # fmt: skip
    assert "A fold is stored for 30 days after its last view." in bounded
    assert "never within 1 hour of the last view" in bounded
    assert "deleted after 2 hours without use" in bounded and "up to 3 movies" in bounded
    assert 'href="https://example.org/imprint?a=1&amp;b=2"' in bounded


def test_fold_page_shows_its_visibility_and_retention() -> None:
    """tests/server/contract compares the texts of folds that do not expire."""
    settings = Settings(keep_days=1)
    unpinned, pinned = (ShownFold.of(a_fold("a", pinned=pinned)) for pinned in (False, True))
    privacy_words = "Only people with the link can see it."
    assert visibility(settings) == visibility(settings, unpinned)
    assert visibility(settings, unpinned) == (
        f"A fold is stored for 1 day after its last view. {privacy_words}"
    )
    assert visibility(settings, pinned) == f"This fold is stored permanently. {privacy_words}"
    for bound in ("storage_bytes", "storage_of_visitor_bytes"):
        text = visibility(Settings.model_validate({bound: MIB_BYTES}))
        assert text.startswith("A fold is stored while there is space;")


def test_times_are_shown_in_their_largest_unit() -> None:
    times = {30 * 86400.0: "30 days", 43200.0: "12 hours", 3600.0: "1 hour", 90.0: "90 seconds"}
    for seconds, words in (times | {5400.0: "90 minutes", 1.5 * 86400.0: "36 hours"}).items():
        assert time_words(seconds) == words


def test_imprint_must_be_a_web_address() -> None:
    for url in ("javascript:alert(1)", "example.org", 'https://a"b', "//x"):
        with case(url), pytest.raises(ValidationError, match=r"expected an address like https"):
            Settings(imprint_url=url)
