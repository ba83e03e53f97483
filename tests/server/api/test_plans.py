"""Folds that choose among verified plans, and the plans that were not chosen."""

import shutil
from collections.abc import Iterator

import pytest

from foldback.planner.pipeline.expected_cost import expected_cost
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.storage.file_names import PLANS_DIR, PLAYABLE
from foldback.words.plan_choice import choice_of
from tests.server.service_process import FinishedFold, Service

PLAIN, CHOOSING = FoldRequest(), FoldRequest(prefer="time")


def test_preference_raises_the_expected_time_within_bounds() -> None:
    short, long = (
        [expected_cost(modules, request).expected_s for request in (PLAIN, CHOOSING)]
        for modules in (288, 9600)
    )
    assert short[1] > 3 * short[0]
    assert long[1] <= long[0] + 300.0


@pytest.fixture
def stored(finished: FinishedFold) -> Iterator[str]:
    """Id of a fold with one more plan, that of its first attempt."""
    directory = finished.directory
    plan = directory / PLANS_DIR / "0"
    plan.mkdir(parents=True)
    for name in PLAYABLE:
        copy = shutil.copytree if (directory / name).is_dir() else shutil.copyfile
        copy(directory / name, plan / name)
    yield finished.id
    shutil.rmtree(directory / PLANS_DIR)


def test_stored_alternative_has_a_page_and_a_comparison(service: Service, stored: str) -> None:
    damaged_id = f"{stored}-0"
    facts = service.http.get(f"/folds/{damaged_id}/facts").json()
    assert facts["name"].endswith(", plan 1")
    assert facts["verdict"]["tone"] == "good"
    assert (facts["alternative_to"], facts["files"], facts["movies"]) == (stored, [], [])
    assert f'href="/folds/{stored}"' in service.http.get(f"/folds/{damaged_id}").text
    assert len(service.http.get(f"/folds/{damaged_id}/batch?from=0&to=4").content) > 100
    for path, status in {
        f"/folds/{damaged_id}/bundle": 200,
        f"/compare?a={stored}&b={damaged_id}": 200,
        f"/folds/{damaged_id}/standalone.html": 404,
        f"/api/folds/{damaged_id}": 404,
        **{f"/folds/{stored}-{number}": 404 for number in ("1", "00000", "x", "-1", "", "0-0")},
    }.items():
        assert service.http.get(path).status_code == status, path


def test_choice_names_stored_plans(service: Service, stored: str) -> None:
    directory = service.directory(stored)
    for playable, number in ((True, 0), (False, None)):
        choice = choice_of(directory, "time", playable=playable)
        assert choice is not None and [plan["stored"] for plan in choice["plans"]] == [number]
