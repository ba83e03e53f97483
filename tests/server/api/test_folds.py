"""A fold over HTTP from the upload to its files, with a real worker."""

import io
import json
from typing import Any

import httpx
import numpy as np
import pytest

from foldback.planner.motion.timeline import Timeline
from foldback.server.limits.concurrency_quota import BUSY_RETRY_S
from foldback.server.processes.children import BUSY, ChildError, Pool
from tests.planner.chains import chain_of
from tests.server.rows import store_of
from tests.server.service_process import SNAKE, STAIRS, FinishedFold, Service, owner, wait_until
from tests.server.service_thread import ServiceThread, ServiceWith


def get(finished: FinishedFold, part: str, **params: Any) -> httpx.Response:
    return finished.http.get(f"{finished.api}/{part}", params=params)


def test_finished_fold_has_figures_and_its_events_are_in_order(finished: FinishedFold) -> None:
    state = finished.state
    assert (state["status"], state["error"], state["modules"]) == ("verified", None, 16)
    assert state["summary"]["certificate"]["min_clearance"] >= 0
    assert state["summary"]["playback"]["rms_position_error"] < 1e-3
    *progress, (name, last) = finished.events
    assert (name, last["status"], last["frames"] > 2) == ("done", "verified", True)
    assert {name for name, _ in progress} == {"progress"}
    order = [None, "read", "explode", "play_back", "certify", "export"]
    stages = [(order.index(data["stage"]), data["frames"]) for _, data in finished.events]
    assert stages == sorted(stages)
    assert [name for name, _ in finished.service.events(finished.id)] == ["progress", "done"]


def test_plan_is_downloaded_in_each_form(finished: FinishedFold) -> None:
    answer = get(finished, "plan.json")
    plan = json.loads(answer.content, parse_constant=pytest.fail)  # strict JSON
    assert answer.headers["content-disposition"].startswith("attachment")
    assert (plan["format"], plan["seed"]) == ("foldback-plan/3", 3)
    arrays = np.load(io.BytesIO(get(finished, "plan.npz").content), allow_pickle=False)
    angles = arrays["joint_angles_rad"]
    assert np.allclose(angles, plan["joint_angles_rad"], atol=1e-6)
    folded = chain_of(SNAKE).folded_rad
    for frame_angles, meant in ((angles[0], 0.0 * folded), (angles[-1], folded)):
        assert np.abs(frame_angles - meant).max() < 0.05
    assert b"<mujoco" in get(finished, "model.xml").content


def test_frames_are_those_of_the_timeline_by_stride_and_range(finished: FinishedFold) -> None:
    answer = get(finished, "frames", poses=True)
    body = json.loads(answer.content, parse_constant=pytest.fail)
    total = body["total"]
    assert (body["from"], body["to"], body["next"], body["status"]) == (0, total, None, "complete")
    assert len(body["time_s"]) == total == len(body["joint_angles_rad"])
    assert body["time_s"] == sorted(body["time_s"])
    phases = [body["phases"][i] for i in body["phase"]]
    assert [*dict.fromkeys(phases)] == ["explosion", "playback"]
    assert body["max_error_rad"][0] is None and body["max_error_rad"][-1] is not None
    arrays = [np.array(body[key]) for key in ("joint_angles_rad", "root_position", "root_wxyz")]
    poses = chain_of(SNAKE).poses(*arrays)
    assert np.allclose(poses.positions, body["positions"], atol=1e-6)
    frame_values = get(finished, "frames", **{"from": 3, "to": 11, "stride": 4}).json()
    assert frame_values["time_s"] == body["time_s"][3:11:4]
    past = get(finished, "frames", **{"from": total + 1})
    assert (past.status_code, past.json()["code"]) == (422, "no-such-frames")


def test_files_of_queued_folds_are_refused(idle: Service) -> None:
    fold_id = idle.fold(SNAKE, seed="7")["id"]
    files = ("frames", "plan.json", "plan.npz", "model.xml", "exports", "exports/urdf")
    for part in (*files, "exports/json"):
        answer = idle.http.get(f"/api/folds/{fold_id}/{part}")
        assert (answer.status_code, answer.json()["code"]) == (409, "not-ready")
        assert answer.headers["retry-after"]
    assert idle.http.get(f"/folds/{fold_id}/facts").json()["downloads"] == []


def test_folds_of_a_gallery_shape_have_its_title_and_private_ones_are_not_in_it(
    service: Service, wrench: str
) -> None:
    assert wrench not in service.http.get("/gallery").text
    assert service.state(wrench)["name"] == "Small wrench"
    assert '<h1 id="name">Small wrench</h1>' in service.http.get(f"/folds/{wrench}").text


def test_running_fold_is_cancelled_requested_again_and_deleted(service: Service) -> None:
    options = {"shape": "mallet-64", "preset": "paper"}  # it explodes slowly
    accepted = service.fold(**options)
    path = f"/api/folds/{accepted['id']}"
    event = next(data for _, data in service.events(accepted["id"]) if data["steps"])
    assert event["simulated_s"] == pytest.approx(0.01 * event["steps"])
    service.wait_exploding(accepted["id"])
    assert service.http.post(f"{path}/cancel", headers=owner(accepted)).status_code == 202
    name, last = list(service.events(accepted["id"]))[-1]
    assert (name, last["status"]) == ("done", "cancelled")
    # Its frames remain visible and the worker is free; the same request starts a new fold.
    assert service.http.get(f"{path}/frames").json()["total"] > 0
    timeline = service.directory(accepted["id"]) / "timeline"
    assert Timeline.open(timeline).status == "failed"  # the worker is then free
    second_fold = service.fold(**options)
    assert second_fold["id"] != accepted["id"]
    service.wait_exploding(second_fold["id"])
    path = f"/api/folds/{second_fold['id']}"
    assert service.http.delete(path, headers=owner(second_fold)).status_code == 204
    assert service.http.get(path).status_code == 404
    wait_until(lambda: not service.directory(second_fold["id"]).exists(), service.log.read_text)


def test_first_shape_is_folded_once(service_with: ServiceWith) -> None:
    service = service_with().start("--first-shape", "mallet-64")
    (first,) = _gallery_folds(service)
    assert first["shape"] == "mallet-64"
    assert service.stop() == 0
    with ServiceThread(service.data_dir).start("--first-shape", "mallet-64") as restarted:
        assert [fold["id"] for fold in _gallery_folds(restarted)] == [first["id"]]


def _gallery_folds(service: Service) -> list[dict[str, Any]]:
    wait_until(lambda: service.http.get("/api/folds").json()["folds"])
    return service.http.get("/api/folds").json()["folds"]


def test_fold_is_requested_again_by_its_id(idle: Service) -> None:
    cells = [[x, y, z] for x in range(3) for y in range(2) for z in range(2)][::-1]
    first = idle.fold(cells, as_voxels="true", method="blocks", seed="21")
    assert idle.http.post(f"/api/folds/{first['id']}/cancel", headers=owner(first)).is_success
    second_fold = idle.fold(fold=first["id"], seed="21")
    assert second_fold["id"] != first["id"]
    for name in ("input", "request.json", "cells.json"):
        before, after = (
            (idle.directory(f["id"]) / name).read_bytes() for f in (first, second_fold)
        )
        assert before == after
    other_fold = idle.fold(fold=first["id"], seed="22", preset="paper")
    assert idle.state(other_fold["id"])["preset"] == "paper"
    assert idle.fold(fold=other_fold["id"], seed="22", preset="paper")["existing"]
    size = sum(path.stat().st_size for path in idle.directory(other_fold["id"]).iterdir())
    with store_of(idle) as store:
        assert store.fold(other_fold["id"]).bytes == size  # counted at once, not only after its end
    gallery = idle.fold(shape="wrench-24", seed="31")
    assert idle.state(idle.fold(fold=gallery["id"], seed="32")["id"])["shape"] == "wrench-24"


def test_settings_that_change_something_make_another_fold(idle: Service) -> None:
    first = idle.fold(STAIRS, preset="paper", settings=" radial_gain=.2, damping=0.10,")
    assert idle.state(first["id"])["settings"] == "radial_gain=0.2"
    options = {"token": first["owner_token"], "preset": "paper"}
    same_fold = idle.fold(STAIRS, **options, settings="step_s=0.01,radial_gain=0.20")
    assert (same_fold["existing"], same_fold["id"]) == (True, first["id"])
    plain = idle.fold(STAIRS, **options)
    assert not plain["existing"]
    # Requests by its id match as well; derived folds use the requested settings.
    second_fold = idle.fold(fold=first["id"], **options, settings="radial_gain=0.2")
    assert (second_fold["id"], idle.fold(fold=first["id"], **options)["id"]) == (
        first["id"],
        plain["id"],
    )


def test_busy_reader_says_when_to_try_again(idle: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    def busy(*_: object, **__: object) -> None:
        raise ChildError(BUSY, "the machine is too busy; try again in a minute.")

    monkeypatch.setattr(Pool, "call", busy)
    answer = idle.upload("path.json", json.dumps(STAIRS), seed="77")
    assert (answer.status_code, answer.headers["Retry-After"]) == (503, str(BUSY_RETRY_S))
