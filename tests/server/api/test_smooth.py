"""Smoothed folds through HTTP, with a real worker, and on the command line."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from planner.plan.plan import Plan
from planner.verification.verify import verify
from server.admin.fold_tasks import AdminTasks
from server.processes.children import Reader
from server.store.folds import Store
from tests.server.cli.test_command_line import foldback
from tests.server.service_process import FinishedFold, Service, owner
from tests.server.service_thread import ServiceThread


@pytest.fixture(scope="module")
def plain(finished: FinishedFold) -> str:
    """Id of the fold that is smoothed."""
    return finished.id


@pytest.fixture(scope="module")
def smoothed(service: Service, plain: str) -> dict[str, Any]:
    """Smoothed fold: the answer to its request, and its final state."""
    accepted = service.fold(smooth=plain)
    return {"accepted": accepted, "state": service.wait_over(accepted["id"])}


def test_verified_fold_is_smoothed(service: Service, plain: str, smoothed: dict[str, Any]) -> None:
    state = smoothed["state"]
    assert state["status"] == "verified", state
    assert (state["smooths"], state["refold"]) == (plain, None)
    assert state["name"] == service.state(plain)["name"]
    figures = state["summary"]["smoothing"]
    recorded = Plan.load(service.directory(plain) / "plan.npz")
    assert figures["before"]["frames"] == len(recorded.time_s)
    assert figures["after"]["length_rad"] < figures["before"]["length_rad"]
    path = f"/api/folds/{state['id']}"
    body = service.http.get(f"{path}/frames").json()
    assert {body["phases"][i] for i in body["phase"]} == {"playback"}
    assert len(body["phase"]) == figures["after"]["frames"]
    assert service.http.get(f"{path}/plan.json").json()["smoothing"] == figures
    assert verify(service.directory(state["id"])).verified


def test_page_of_smoothed_fold_compares_figures(
    service: Service, plain: str, smoothed: dict[str, Any]
) -> None:
    facts = service.http.get(f"/folds/{smoothed['state']['id']}/facts").json()
    assert facts["name"].endswith(", smoothed") and not facts["smoothable"]
    rows = {row["label"]: row for row in facts["smoothing"]["rows"]}
    figures = smoothed["state"]["summary"]["smoothing"]
    for when in ("before", "after"):
        assert rows["Frames"][when] == str(figures[when]["frames"])
    assert {"Folding time", "Largest torque", "Clearance"} < set(rows)
    assert facts["compare"][0]["id"] == plain
    assert service.http.get(facts["smoothing"]["compare"]).status_code == 200
    recorded = service.http.get(f"/folds/{plain}/facts").json()
    assert (recorded["smoothable"], recorded["smoothing"]) == (True, None)


def test_smoothed_fold_is_requested_once_and_unlisted(
    service: Service, plain: str, smoothed: dict[str, Any]
) -> None:
    fold_id, token = smoothed["accepted"]["id"], smoothed["accepted"]["owner_token"]
    for form in ({"smooth": plain}, {"fold": fold_id}):
        again = service.fold(**form, token=token)
        assert (again["existing"], again["id"]) == (True, fold_id)
    assert fold_id not in {f["id"] for f in service.http.get("/api/folds").json()["folds"]}
    plan = service.directory(plain) / "plan.npz"
    assert (service.directory(fold_id) / "recorded.npz").read_bytes() == plan.read_bytes()


def test_smoothed_fold_outlives_the_original_and_starts_again_from_its_record(
    service: Service,
    plain: str,
    smoothed: dict[str, Any],
    service_with: Callable[..., ServiceThread],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # No process that reads is started, as the input has been read before.
    read = {"name": "path", "module": "cube", "modules": 16}
    monkeypatch.setattr(Reader, "check", lambda *_, **__: read)
    shown = smoothed["state"]["id"]
    assert plain in service.http.get(f"/folds/{shown}").text
    # A page of the original does not reveal the link of the smoothed fold.
    embedded = service.http.get(f"/embed/{shown}").text
    assert shown in embedded and plain not in embedded
    # Here the folds are private and no worker takes the queued one.
    other = service_with()
    other.copy_from(service, plain, shown)
    other.start()
    before = other.http.get(f"/folds/{shown}/facts").json()
    assert before["smoothing"]["compare"] == f"/compare?a={plain}&b={shown}"
    with closing(Store(other.settings)) as store:
        assert store.delete(plain)
    facts = other.http.get(f"/folds/{shown}/facts").json()
    assert facts["smoothing"]["rows"] and facts["smoothing"]["compare"] is None
    assert [each["text"] for each in facts["compare"]] == ["Another seed"]
    assert plain not in other.http.get(f"/folds/{shown}").text
    recorded = other.directory(shown) / "recorded.npz"
    known = recorded.read_bytes()
    with closing(AdminTasks(other.settings)) as admin_tasks:
        admin_tasks.requeue(shown, force=True)
    assert (other.state(shown)["status"], recorded.read_bytes()) == ("queued", known)
    other.http.post(f"/api/folds/{shown}/cancel", headers=owner(smoothed["accepted"]))
    again = other.fold(fold=shown)
    assert (again["existing"], other.state(again["id"])["smooths"]) == (False, plain)


def test_options_that_do_not_suit_smoothing_are_refused(
    service: Service, plain: str, smoothed: dict[str, Any]
) -> None:
    for form, status, code in (
        ({"smooth": plain, "preset": "paper"}, 422, "smooth-preset"),
        ({"smooth": plain, "strategy": "peel"}, 422, "smooth-strategy"),
        ({"smooth": plain, "shape": "mallet-24"}, 422, "file-or-shape"),
        ({"fold": smoothed["accepted"]["id"], "preset": "direct"}, 422, "smooth-preset"),
        ({"smooth": "nosuchfold"}, 404, "no-such-fold"),
    ):
        answer, problem = service.refusal(**form)
        assert (answer, problem["code"]) == (status, code), problem


@pytest.mark.long
def test_plan_is_smoothed_on_the_command_line(service: Service, plain: str, tmp_path: Path) -> None:
    done = foldback("smooth", str(service.directory(plain)), "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("verified (simulated)", "Largest torque", "Before", "After", "×"):
        assert word in done.stdout
    assert verify(tmp_path).verified
