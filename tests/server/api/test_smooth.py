"""Smoothed folds through HTTP, with a real worker, and on the command line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from planner.plan.plan import Plan
from planner.verification.verify import verify
from server.cli.command_line import application
from server.operate.fold_tasks import AdminTasks
from server.settings import Settings
from tests.server.here import ServiceHere
from tests.server.service import SNAKE, Service, owner


@pytest.fixture(scope="module")
def asked(service: Service) -> dict[str, Any]:
    """A finished fold of a gallery shape: what the request was answered."""
    accepted = service.fold(shape="wrench-24", seed="41", module_size="0.9")
    assert service.wait_over(accepted["id"])["status"] == "verified"
    return accepted


@pytest.fixture(scope="module")
def wrench(asked: dict[str, Any]) -> str:
    """Its id."""
    return asked["id"]


@pytest.fixture(scope="module")
def smoothed(service: Service, wrench: str) -> dict[str, Any]:
    """It, smoothed: what the request was answered, and how it ended."""
    accepted = service.fold(smooth=wrench)
    return {"accepted": accepted, "state": service.wait_over(accepted["id"])}


def test_a_verified_fold_is_smoothed_as_a_fold_of_its_own(
    service: Service, wrench: str, smoothed: dict[str, Any]
) -> None:
    state = smoothed["state"]
    assert state["status"] == "verified", state
    assert (state["smooths"], state["refold"], state["shape"]) == (wrench, None, "wrench-24")
    assert (state["module_size"], state["name"]) == (0.9, service.state(wrench)["name"])
    told = state["summary"]["smoothing"]
    recorded = Plan.load(service.directory(wrench) / "plan.npz")
    assert told["before"]["frames"] == len(recorded.time_s)
    assert told["after"]["length_rad"] < told["before"]["length_rad"]
    here = f"/api/folds/{state['id']}"
    body = service.http.get(f"{here}/frames").json()
    assert {body["phases"][i] for i in body["phase"]} == {"playback"}
    assert len(body["phase"]) == told["after"]["frames"]
    assert service.http.get(f"{here}/plan.json").json()["smoothing"] == told
    assert verify(service.directory(state["id"])).verified
    assert service.state(wrench)["smooths"] is None


def test_it_leads_to_the_recorded_one_only_while_that_is_there(
    service: Service,
    asked: dict[str, Any],
    smoothed: dict[str, Any],
    here_with: Callable[..., ServiceHere],
) -> None:
    wrench, shown = asked["id"], smoothed["state"]["id"]
    assert wrench in service.http.get(f"/folds/{shown}").text
    # Nor does a site that shows it give away the link of the other.
    embedded = service.http.get(f"/embed/{shown}").text
    assert shown in embedded and wrench not in embedded
    # Where the others do not miss it.
    other = here_with()
    other.take_over(service, wrench, shown)
    other.start()
    before = other.http.get(f"/folds/{shown}/facts").json()
    assert before["smoothing"]["compare"] == f"/compare?a={wrench}&b={shown}"
    assert other.http.delete(f"/api/folds/{wrench}", headers=owner(asked)).status_code == 204
    facts = other.http.get(f"/folds/{shown}/facts").json()
    assert facts["smoothing"]["rows"] and facts["smoothing"]["compare"] is None
    assert [each["text"] for each in facts["compare"]] == ["Another seed"]
    assert wrench not in other.http.get(f"/folds/{shown}").text


def test_its_page_says_what_has_changed(
    service: Service, wrench: str, smoothed: dict[str, Any]
) -> None:
    fold_id = smoothed["state"]["id"]
    facts = service.http.get(f"/folds/{fold_id}/facts").json()
    assert facts["name"] == "Small wrench, smoothed"
    assert not facts["smoothable"]
    assert facts["smoothing"]["compare"] == f"/compare?a={wrench}&b={fold_id}"
    rows = {row["label"]: row for row in facts["smoothing"]["rows"]}
    told = smoothed["state"]["summary"]["smoothing"]
    frames = rows["Frames"]
    assert frames["before"] == str(told["before"]["frames"])
    assert frames["after"] == str(told["after"]["frames"])
    assert {"Folding time", "Largest torque", "Clearance"} < set(rows)
    assert facts["compare"][0]["id"] == wrench
    assert service.http.get(facts["smoothing"]["compare"]).status_code == 200
    recorded = service.http.get(f"/folds/{wrench}/facts").json()
    assert recorded["smoothable"]
    assert recorded["smoothing"] is None


def test_it_is_asked_for_once_and_repeated_as_one(
    service: Service, wrench: str, smoothed: dict[str, Any]
) -> None:
    fold_id = smoothed["accepted"]["id"]
    token = smoothed["accepted"]["owner_token"]
    for form in ({"smooth": wrench}, {"fold": fold_id, "module_size": "0.9"}):
        again = service.fold(**form, token=token)
        assert (again["existing"], again["id"]) == (True, fold_id)
    listed = service.http.get("/api/folds").json()["folds"]
    assert fold_id not in {f["id"] for f in listed}
    plan = service.directory(wrench) / "plan.npz"
    assert (service.directory(fold_id) / "recorded.npz").read_bytes() == plan.read_bytes()
    other = service.fold(smooth=wrench, seed="1")
    assert other["id"] != fold_id
    service.http.post(f"/api/folds/{other['id']}/cancel", headers=owner(other))


def test_it_is_computed_again_from_what_it_was_made_of(
    service: Service, smoothed: dict[str, Any]
) -> None:
    fold_id = smoothed["accepted"]["id"]
    recorded = service.directory(fold_id) / "recorded.npz"
    before = service.state(fold_id), recorded.read_bytes()
    admin_tasks = AdminTasks(Settings(data_dir=service.data_dir))
    try:
        admin_tasks.requeue(fold_id, force=True)
    finally:
        admin_tasks.close()
    after = service.wait_over(fold_id), recorded.read_bytes()
    assert after[0]["status"] == before[0]["status"] == "verified"
    assert after[1] == before[1]


@pytest.mark.long
def test_one_that_was_cancelled_before_it_began_is_folded_again(
    service: Service, finished: dict[str, Any], here_with: Callable[..., ServiceHere]
) -> None:
    idle = here_with()
    recorded = finished["id"]
    idle.take_over(service, recorded)
    idle.start()
    accepted = idle.fold(smooth=recorded)
    idle.http.post(f"/api/folds/{accepted['id']}/cancel", headers=owner(accepted))
    assert idle.wait_over(accepted["id"])["status"] == "cancelled"
    again = idle.fold(fold=accepted["id"])
    assert not again["existing"]
    assert idle.state(again["id"])["smooths"] == recorded


def test_options_that_it_cannot_have_are_refused(
    service: Service, wrench: str, smoothed: dict[str, Any]
) -> None:
    for form, code in (
        ({"smooth": wrench, "preset": "paper"}, "smooth-preset"),
        ({"smooth": wrench, "strategy": "peel"}, "smooth-strategy"),
        ({"smooth": wrench, "shape": "mallet-24"}, "file-or-shape"),
        ({"smooth": wrench, "refold": wrench}, "smooth-or-refold"),
        ({"fold": smoothed["accepted"]["id"], "preset": "direct"}, "smooth-preset"),
    ):
        status, problem = service.refused(**form)
        assert (status, problem["code"]) == (422, code), problem
    assert service.refused(smooth="nosuchfold")[0] == 404
    assert service.refused(smooth="a\x00b")[0] == 422


def test_only_a_verified_fold_is_smoothed(desk: Service, service: Service, wrench: str) -> None:
    waiting = desk.fold(SNAKE, seed="43")
    status, problem = desk.refused(smooth=waiting["id"])
    assert (status, problem["code"]) == (409, "smooth-not-ready")
    desk.http.post(f"/api/folds/{waiting['id']}/cancel", headers=owner(waiting))
    status, problem = desk.refused(smooth=waiting["id"])
    assert (status, problem["code"]) == (422, "smooth-no-plan")
    theirs, mine = service.directory(wrench), desk.directory(waiting["id"])
    plan = Plan.load(theirs / "plan.npz")
    failed = replace(plan.certificate, verdict="failed: it overlaps")
    replace(plan, certificate=failed).save_npz(mine / "plan.npz")
    shutil.copyfile(theirs / "chain.json", mine / "chain.json")
    status, problem = desk.refused(smooth=waiting["id"])
    assert (status, problem["code"]) == (422, "smooth-not-verified")
    assert not desk.http.get(f"/folds/{waiting['id']}/facts").json()["smoothable"]


def cli(*arguments: object) -> tuple[int, str]:
    told = CliRunner().invoke(application(), [*map(str, arguments)])
    return told.exit_code, told.output


@pytest.mark.long
def test_a_plan_is_smoothed_on_the_command_line(
    service: Service, wrench: str, tmp_path: Path
) -> None:
    recorded = service.directory(wrench)
    code, told = cli("smooth", recorded, "--out", tmp_path / "smooth")
    assert code == 0, told
    for word in ("verified (simulated)", "Largest torque", "Before", "After", "×"):
        assert word in told
    assert verify(tmp_path / "smooth").verified
    code, told = cli("smooth", recorded, "--out", tmp_path / "again", "--json")
    assert code == 0
    summary = json.loads(told.splitlines()[-1])
    assert summary["certificate"]["module_size"] == 0.9
    plans = [Plan.load(tmp_path / name / "plan.npz") for name in ("smooth", "again")]
    np.testing.assert_array_equal(*(plan.joint_angles_rad for plan in plans))


def test_the_command_line_refuses_what_is_no_plan(
    service: Service, wrench: str, tmp_path: Path
) -> None:
    code, told = cli("smooth", tmp_path, "--out", tmp_path / "out", "--json")
    assert code == 2
    assert json.loads(told.splitlines()[-1])["error"]["code"] == "not-a-plan"
    here = service.directory(wrench)
    code, told = cli("smooth", here, "--out", here, "--json")
    assert code == 2
    assert json.loads(told.splitlines()[-1])["error"]["code"] == "smooth-in-place"
