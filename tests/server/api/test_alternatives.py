"""Plans that a preference has not chosen are shown like folds, and nothing else is."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

from planner.file_names import ATTEMPTS, PLANS_DIR, PLAYABLE
from tests.server.service import Service
from words.choice import choice_of


@pytest.fixture
def stored(service: Service, finished: dict[str, Any]) -> Iterator[str]:
    """A fold with one more plan, that of its first attempt."""
    directory = service.directory(finished["id"])
    plan = directory / PLANS_DIR / "0"
    plan.mkdir(parents=True)
    for name in PLAYABLE:
        copy = shutil.copytree if (directory / name).is_dir() else shutil.copyfile
        copy(directory / name, plan / name)
    yield finished["id"]
    shutil.rmtree(directory / PLANS_DIR)


def test_stored_alternative_has_a_page_and_a_comparison(service: Service, stored: str) -> None:
    shown = f"{stored}-0"
    facts = service.http.get(f"/folds/{shown}/facts").json()
    assert facts["name"].endswith(", plan 1")
    assert facts["verdict"]["tone"] == "good"
    assert (facts["alternative_to"], facts["files"], facts["movies"]) == (stored, [], False)
    assert f'href="/folds/{stored}"' in service.http.get(f"/folds/{shown}").text
    assert len(service.http.get(f"/folds/{shown}/batch?from=0&to=4").content) > 100
    for path, status in {
        f"/folds/{shown}/bundle": 200,
        f"/compare?a={stored}&b={shown}": 200,
        f"/folds/{shown}/standalone.html": 404,
        f"/api/folds/{shown}": 404,
        **{f"/folds/{stored}-{number}": 404 for number in ("1", "00000", "x", "-1", "", "0-0")},
    }.items():
        assert service.http.get(path).status_code == status, path


def test_choice_names_stored_plans(service: Service, stored: str) -> None:
    directory = service.directory(stored)
    tried = json.loads((directory / ATTEMPTS).read_bytes())
    choices = [choice_of(directory, "time", playable=playable) for playable in (True, False)]
    plans = [choice["plans"][0]["stored"] for choice in choices if choice is not None]
    assert (len(tried), plans) == (1, [0, None])
