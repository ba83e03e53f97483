"""Smoothed folds through HTTP, with a real worker, and on the command line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import closing
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


def test_verified_fold_is_smoothed(service: Service, wrench: str, smoothed: dict[str, Any]) -> None:
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


def test_link_from_smoothed_to_original_fold_ends_with_the_original(
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


def test_page_of_smoothed_fold_compares_figures(
    service: Service, wrench: str, smoothed: dict[str, Any]
) -> None:
    fold_id = smoothed["state"]["id"]
    facts = service.http.get(f"/folds/{fold_id}/facts").json()
    assert (facts["name"], facts["smoothable"]) == ("Small wrench, smoothed", False)
    rows = {row["label"]: row for row in facts["smoothing"]["rows"]}
    told = smoothed["state"]["summary"]["smoothing"]
    assert rows["Frames"]["before"] == str(told["before"]["frames"])
    assert rows["Frames"]["after"] == str(told["after"]["frames"])
    assert {"Folding time", "Largest torque", "Clearance"} < set(rows)
    assert facts["compare"][0]["id"] == wrench
    assert service.http.get(facts["smoothing"]["compare"]).status_code == 200
    recorded = service.http.get(f"/folds/{wrench}/facts").json()
    assert (recorded["smoothable"], recorded["smoothing"]) == (True, None)


def test_smoothed_fold_is_requested_once_and_unlisted(
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


def test_requeued_smoothing_starts_from_the_recorded_plan(
    service: Service, smoothed: dict[str, Any]
) -> None:
    fold_id = smoothed["accepted"]["id"]
    recorded = service.directory(fold_id) / "recorded.npz"
    before = recorded.read_bytes()
    with closing(AdminTasks(Settings(data_dir=service.data_dir))) as admin_tasks:
        admin_tasks.requeue(fold_id, force=True)
    assert service.wait_over(fold_id)["status"] == "verified"
    assert recorded.read_bytes() == before


@pytest.mark.long
def test_smoothing_cancelled_while_queued_is_requested_again(
    service: Service, finished: dict[str, Any], here_with: Callable[..., ServiceHere]
) -> None:
    idle = here_with()
    idle.take_over(service, finished["id"])
    idle.start()
    accepted = idle.fold(smooth=finished["id"])
    idle.http.post(f"/api/folds/{accepted['id']}/cancel", headers=owner(accepted))
    again = idle.fold(fold=accepted["id"])
    assert not again["existing"]
    assert idle.state(again["id"])["smooths"] == finished["id"]


def test_options_that_do_not_suit_smoothing_are_refused(
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


def test_only_verified_folds_are_smoothed(desk: Service, service: Service, wrench: str) -> None:
    waiting = desk.fold(SNAKE, seed="43")
    here = desk.directory(waiting["id"])

    def refused() -> tuple[int, str]:
        status, problem = desk.refused(smooth=waiting["id"])
        return status, problem["code"]

    assert refused() == (409, "smooth-not-ready")
    desk.http.post(f"/api/folds/{waiting['id']}/cancel", headers=owner(waiting))
    assert refused() == (422, "smooth-no-plan")
    theirs = service.directory(wrench)
    plan = Plan.load(theirs / "plan.npz")
    failed = replace(plan.certificate, verdict="failed: it overlaps")
    replace(plan, certificate=failed).save_npz(here / "plan.npz")
    shutil.copyfile(theirs / "chain.json", here / "chain.json")
    assert refused() == (422, "smooth-not-verified")
    assert not desk.http.get(f"/folds/{waiting['id']}/facts").json()["smoothable"]


def cli(*arguments: object) -> tuple[int, str]:
    told = CliRunner().invoke(application(), [*map(str, arguments)])
    return told.exit_code, told.output


@pytest.mark.long
def test_plan_is_smoothed_on_the_command_line(
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


def test_command_line_smooths_only_plans_into_another_directory(
    service: Service, wrench: str, tmp_path: Path
) -> None:
    here = service.directory(wrench)
    for source, out, refused in (
        (tmp_path, tmp_path / "out", "not-a-plan"),
        (here, here, "smooth-in-place"),
    ):
        code, told = cli("smooth", source, "--out", out, "--json")
        assert (code, json.loads(told.splitlines()[-1])["error"]["code"]) == (2, refused)
