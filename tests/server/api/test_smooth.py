"""Smoothed folds over HTTP, with a real worker, and on the command line."""

from contextlib import closing
from pathlib import Path

import pytest

from foldback.planner.plan.plan import Plan
from foldback.planner.verification.verify import verify
from foldback.server.admin.fold_tasks import AdminTasks
from foldback.server.processes.children import Pool
from tests.server.cli.test_command_line import foldback
from tests.server.rows import store_of
from tests.server.service_process import FinishedFold, bearer
from tests.server.service_thread import ServiceWith


@pytest.fixture(scope="module")
def smoothed(finished: FinishedFold) -> FinishedFold:
    """Fold that was smoothed from the finished one."""
    accepted = finished.service.fold(smooth=finished.id)
    state = finished.service.wait_over(accepted["id"])
    return FinishedFold(finished.service, accepted, [], state)


def test_verified_fold_is_smoothed(finished: FinishedFold, smoothed: FinishedFold) -> None:
    state = smoothed.state
    assert state["status"] == "verified", state
    assert (state["smooths"], state["refold"]) == (finished.id, None)
    assert state["name"] == finished.state["name"]
    figures = state["summary"]["smoothing"]
    recorded = Plan.load(finished.directory / "plan.npz")
    assert figures["before"]["frames"] == len(recorded.time_s)
    assert figures["after"]["length_rad"] < figures["before"]["length_rad"]
    body = smoothed.http.get(f"{smoothed.api}/frames").json()
    assert {body["phases"][i] for i in body["phase"]} == {"playback"}
    assert len(body["phase"]) == figures["after"]["frames"]
    assert smoothed.http.get(f"{smoothed.api}/plan.json").json()["smoothing"] == figures
    assert verify(smoothed.directory).verified
    copy = smoothed.directory / "recorded.npz"
    assert copy.read_bytes() == (finished.directory / "plan.npz").read_bytes()


def test_page_of_smoothed_fold_compares_figures(
    finished: FinishedFold, smoothed: FinishedFold
) -> None:
    facts = smoothed.http.get(f"{smoothed.page}/facts").json()
    assert facts["name"].endswith(", smoothed") and not facts["smooth_question"]
    rows = {row["label"]: row for row in facts["smoothing"]["rows"]}
    for moment in ("before", "after"):
        assert rows["Frames"][moment] == str(
            smoothed.state["summary"]["smoothing"][moment]["frames"]
        )
    assert {"Folding time", "Largest torque", "Clearance"} < set(rows)
    assert facts["smoothing"]["gain"].startswith("Travel ")
    assert "smoothed: " in facts["verdict"]["text"]
    assert facts["compare"][0]["id"] == finished.id
    assert smoothed.http.get(facts["smoothing"]["compare"]).status_code == 200
    recorded = finished.http.get(f"{finished.page}/facts").json()
    assert "about 5 s" in recorded["smooth_question"] and recorded["smoothing"] is None


def test_smoothed_fold_is_requested_once_and_unlisted(
    finished: FinishedFold, smoothed: FinishedFold
) -> None:
    for form in ({"smooth": finished.id}, {"fold": smoothed.id}):
        second_fold = smoothed.service.fold(**form, token=smoothed.token)
        assert (second_fold["existing"], second_fold["id"]) == (True, smoothed.id)
    listed = smoothed.http.get("/api/folds").json()["folds"]
    assert smoothed.id not in {fold["id"] for fold in listed}


def test_smoothed_fold_outlives_the_original_and_starts_again_from_its_record(
    finished: FinishedFold,
    smoothed: FinishedFold,
    service_with: ServiceWith,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # No process that reads is started, as the input has been read before.
    read = {"name": "path", "module": "cube", "module_words": None, "modules": 16}
    monkeypatch.setattr(Pool, "call", lambda *_, **__: read)
    plain, smoothed_id = finished.id, smoothed.id
    assert plain in smoothed.http.get(smoothed.page).text
    # A page of the original does not reveal the link of the smoothed fold.
    embedded = smoothed.http.get(f"/embed/{smoothed_id}").text
    assert smoothed_id in embedded and plain not in embedded
    # Here the folds are private and no worker takes the queued one.
    other_service_with = service_with()
    other_service_with.copy_from(smoothed.service, plain, smoothed_id)
    other_service_with.start()
    before = other_service_with.http.get(f"{smoothed.page}/facts").json()
    assert before["smoothing"]["compare"] == f"/compare?a={plain}&b={smoothed_id}"
    with store_of(other_service_with) as store:
        assert store.delete(plain)
    facts = other_service_with.http.get(f"{smoothed.page}/facts").json()
    assert facts["smoothing"]["rows"] and facts["smoothing"]["compare"] is None
    assert [compared_fold["text"] for compared_fold in facts["compare"]] == ["Another random start"]
    assert plain not in other_service_with.http.get(smoothed.page).text
    recorded = other_service_with.directory(smoothed_id) / "recorded.npz"
    expected = recorded.read_bytes()
    with closing(AdminTasks(other_service_with.settings)) as admin_tasks:
        admin_tasks.requeue(smoothed_id, force=True)
    assert (other_service_with.state(smoothed_id)["status"], recorded.read_bytes()) == (
        "queued",
        expected,
    )
    other_service_with.http.post(f"{smoothed.api}/cancel", headers=bearer(smoothed.token))
    second_fold = other_service_with.fold(fold=smoothed_id)
    assert (second_fold["existing"], other_service_with.state(second_fold["id"])["smooths"]) == (
        False,
        plain,
    )


def test_options_that_do_not_suit_smoothing_are_refused(
    finished: FinishedFold, smoothed: FinishedFold
) -> None:
    for form, status, code in (
        ({"smooth": finished.id, "preset": "paper"}, 422, "smooth-preset"),
        ({"smooth": finished.id, "strategy": "peel"}, 422, "smooth-strategy"),
        ({"smooth": finished.id, "shape": "mallet-24"}, 422, "file-or-shape"),
        ({"fold": smoothed.id, "preset": "direct"}, 422, "smooth-preset"),
        ({"smooth": "nosuchfold"}, 404, "no-such-fold"),
    ):
        answer, problem = finished.service.refusal(**form)
        assert (answer, problem["code"]) == (status, code), problem


@pytest.mark.long
def test_plan_is_smoothed_on_the_command_line(finished: FinishedFold, tmp_path: Path) -> None:
    done = foldback("smooth", finished.directory, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("verified (simulated)", "Largest torque", "Before", "After", "×", "Travel "):
        assert word in done.stdout
    assert verify(tmp_path).verified
