"""Folds that choose among verified plans: asked for over HTTP, told in their JSON and pages."""

from __future__ import annotations

from typing import Any

import pytest

from planner.pipeline.expected_cost import expected_cost
from planner.pipeline.request import FoldRequest
from planner.plan.plan import Plan
from tests.server.service import STAIRS, Service

pytestmark = [pytest.mark.slow, pytest.mark.long]  # whole searches for the best of several plans


@pytest.fixture(scope="module")
def quickest(service: Service) -> dict[str, Any]:
    return service.wait_over(service.fold(STAIRS, prefer="time")["id"])


def test_fold_that_prefers_time_has_the_fastest_of_its_plans(
    service: Service, quickest: dict[str, Any]
) -> None:
    assert (quickest["status"], quickest["prefer"]) == ("verified", "time")
    plan = Plan.load(service.directory(quickest["id"]) / "plan.npz")
    times = [each["figures"]["fold_time_s"] for each in plan.attempts if "figures" in each]
    assert len(times) > 2
    assert plan.certificate.fold_time_s == min(times)
    assert quickest["summary"]["certificate"]["fold_time_s"] == min(times)
    facts = service.http.get(f"/folds/{quickest['id']}/facts").json()
    plans = facts["choice"]["plans"]
    assert [plan["chosen"] for plan in plans].count(True) == 1
    assert f"fastest of {len(plans)} plans" in facts["verdict"]["text"]
    assert "of further computing" in facts["choice"]["text"]
    assert len(facts["attempts"]) >= len(plans)
    (first,) = (way for way in facts["compare"] if way["text"] == "First verified plan")
    assert first["form"]["prefer"] == "computing"


def test_another_preference_makes_another_fold(service: Service, quickest: dict[str, Any]) -> None:
    plain = service.wait_over(service.fold(STAIRS)["id"])
    assert plain["id"] != quickest["id"]
    assert plain["prefer"] == "computing"
    facts = service.http.get(f"/folds/{plain['id']}/facts").json()
    assert facts["choice"] is None
    assert "Shortest folding time" in [way["text"] for way in facts["compare"]]


def test_preference_of_a_baseline_is_refused(desk: Service) -> None:
    form = {"shape": "mallet-64", "prefer": "torque", "preset": "paper"}
    answer = desk.http.post("/api/folds", data=form)
    assert answer.status_code == 422
    assert (answer.json()["code"], answer.json()["where"]) == ("unsuited-prefer", "prefer")
    assert "got the preference torque" in answer.json()["detail"]


def test_preference_raises_the_expected_time_within_bounds() -> None:
    plain, choosing = FoldRequest(), FoldRequest(prefer="time")
    short, long = (
        [expected_cost(modules, request).expected_s for request in (plain, choosing)]
        for modules in (288, 9600)
    )
    assert short[1] > 3 * short[0]
    assert long[1] <= long[0] + 300.0
