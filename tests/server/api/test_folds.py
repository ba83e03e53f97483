"""A fold from the upload to its files, through HTTP, with a real worker."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.motion.timeline import Timeline
from server.jobs.housekeeping import CANCELLED_FOLD_S, Housekeeping
from server.settings import Settings
from server.store.folds import Store
from tests.server.here import ServiceHere
from tests.server.service import SNAKE, STAIRS, Service, owner


def get(service: Service, finished: dict[str, Any], part: str, **params: Any) -> httpx.Response:
    return service.http.get(f"/api/folds/{finished['id']}/{part}", params=params)


def test_a_fold_is_verified_with_figures(finished: dict[str, Any]) -> None:
    state = finished["state"]
    assert state["status"] == "verified", state
    assert state["error"] is None
    assert state["modules"] == 16
    assert state["summary"]["certificate"]["min_clearance"] >= 0
    assert state["summary"]["playback"]["rms_position_error"] < 1e-3


def test_events_tell_the_stages_in_order_and_end(finished: dict[str, Any]) -> None:
    names = [name for name, _ in finished["events"]]
    assert names[-1] == "done"
    assert set(names[:-1]) == {"progress"}
    order = [None, "read", "explode", "play_back", "certify", "export"]
    stages = [order.index(data["stage"]) for _, data in finished["events"]]
    assert stages == sorted(stages)
    frames = [data["frames"] for _, data in finished["events"]]
    assert frames == sorted(frames)
    last = finished["events"][-1][1]
    assert last["status"] == "verified"
    assert last["frames"] > 2


def test_events_of_a_finished_fold_end_at_once(service: Service, finished: dict[str, Any]) -> None:
    assert [name for name, _ in service.events(finished["id"])] == ["progress", "done"]


def test_the_plan_can_be_downloaded(service: Service, finished: dict[str, Any]) -> None:
    answer = get(service, finished, "plan.json")
    plan = answer.json()
    assert answer.headers["content-disposition"].startswith("attachment")
    assert plan["format"] == "foldback-plan/3"
    assert plan["seed"] == 3
    arrays = np.load(io.BytesIO(get(service, finished, "plan.npz").content), allow_pickle=False)
    angles = arrays["joint_angles_rad"]
    assert np.allclose(angles, plan["joint_angles_rad"], atol=1e-6)
    assert np.abs(angles[0]).max() < 0.05  # from straight …
    folded = Chain.from_path(Path.from_cells(SNAKE)).folded_rad
    assert np.abs(angles[-1] - folded).max() < 0.01  # … to folded
    assert b"<mujoco" in get(service, finished, "model.xml").content


def test_frames_are_those_of_the_timeline(service: Service, finished: dict[str, Any]) -> None:
    body = get(service, finished, "frames", poses=True).json()
    total = body["total"]
    assert (body["from"], body["to"], body["next"]) == (0, total, None)
    assert body["status"] == "complete"
    assert len(body["time_s"]) == total == len(body["joint_angles_rad"])
    assert body["time_s"] == sorted(body["time_s"])
    phases = [body["phases"][i] for i in body["phase"]]
    assert phases == sorted(phases)
    assert set(phases) == {"explosion", "playback"}
    errors = body["max_error_rad"]
    assert errors[0] is None
    assert errors[-1] is not None
    chain = Chain.from_path(Path.from_cells(SNAKE))
    poses = chain.poses(
        np.array(body["joint_angles_rad"]),
        np.array(body["root_position"]),
        np.array(body["root_wxyz"]),
    )
    assert np.allclose(poses.positions, body["positions"], atol=1e-6)


def test_frames_by_stride_and_range(service: Service, finished: dict[str, Any]) -> None:
    everything = get(service, finished, "frames").json()
    some = get(service, finished, "frames", **{"from": 3, "to": 11, "stride": 4}).json()
    assert some["time_s"] == everything["time_s"][3:11:4]
    none = get(service, finished, "frames", **{"from": everything["total"]}).json()
    assert none["time_s"] == []
    past = get(service, finished, "frames", **{"from": everything["total"] + 1})
    assert (past.status_code, past.json()["code"]) == (422, "no-such-frames")


def test_long_answers_are_cut_and_lead_on(service: Service, finished: dict[str, Any]) -> None:
    # A second one on the same folds, which gives few frames at once.
    sparing = ServiceHere(service.data_dir, frames_per_answer=7).start()
    link: str | None = f"/api/folds/{finished['id']}/frames?stride=2"
    times: list[float] = []
    while link is not None:
        body = sparing.http.get(link).json()
        assert len(body["time_s"]) <= 7
        times += body["time_s"]
        link = body["next"]
    assert sparing.stop() == 0
    assert len(times) == (body["total"] + 1) // 2
    assert times == sorted(set(times))


def test_what_is_not_there_yet_says_so(desk: Service) -> None:
    fold_id = desk.fold(SNAKE, seed="7")["id"]
    for part in ("frames", "plan.json", "plan.npz", "model.xml"):
        answer = desk.http.get(f"/api/folds/{fold_id}/{part}")
        assert (answer.status_code, answer.json()["code"]) == (409, "not-ready")


@pytest.mark.parametrize("fold_id", ["nosuchfold", "..", "%2e%2e%2fsecret", "a" * 500])
def test_unknown_folds_are_not_found(desk: Service, fold_id: str) -> None:
    for part in ("", "/events", "/frames", "/plan.json"):
        answer = desk.http.get(f"/api/folds/{fold_id}{part}")
        assert answer.status_code == 404
        assert answer.json()["code"]


def test_the_list_shows_the_gallery_and_ones_own_only(desk: Service) -> None:
    mine = desk.fold(SNAKE, seed="8")
    public = desk.fold(shape="mallet-64")
    anyone = {f["id"] for f in desk.http.get("/api/folds").json()["folds"]}
    me = {f["id"] for f in desk.http.get("/api/folds", headers=owner(mine)).json()["folds"]}
    assert public["id"] in anyone
    assert mine["id"] not in anyone
    assert me == anyone | {mine["id"]}


ODD = (
    {"seed": "5"},
    {"preset": "paper"},
    {"preset": "direct"},
    {"module_size": "0.5"},
    {"ends": "surface"},
)


def test_only_the_plain_fold_of_a_gallery_shape_is_public(desk: Service) -> None:
    odd = [desk.fold(shape="mallet-24", **more) for more in ODD]
    plain = desk.fold(shape="mallet-24")
    listed = {f["id"] for f in desk.http.get("/api/folds").json()["folds"]}
    assert plain["id"] in listed
    assert not listed & {fold["id"] for fold in odd}
    mine = desk.http.get("/api/folds", headers=owner(odd[0])).json()["folds"]
    assert odd[0]["id"] in {f["id"] for f in mine}


def test_only_a_public_fold_is_shown_in_the_gallery(service: Service, wrench: str) -> None:
    assert wrench not in service.http.get("/gallery").text
    plain = service.fold(shape="wrench-24")
    assert service.wait_over(plain["id"])["status"] == "verified"
    assert f"/folds/{plain['id']}" in service.http.get("/gallery").text


def test_a_gallery_shape_keeps_its_title(service: Service, desk: Service, wrench: str) -> None:
    titles = {s["name"]: s["title"] for s in service.http.get("/api/shapes").json()["shapes"]}
    assert titles["wrench-24"] == "Small wrench"
    data = service.http.get("/api/shapes/wrench-24.json").content
    answer = service.http.post("/api/folds", files={"file": ("mine.json", data)})
    assert service.wait_over(answer.json()["id"])["name"] == "wrench-24"  # as the file says
    for seed in ("0", "5"):
        waiting = desk.fold(shape="wrench-24", seed=seed)
        assert desk.state(waiting["id"])["name"] == "Small wrench"
    assert service.state(wrench)["name"] == "Small wrench"
    assert '<h1 id="name">Small wrench</h1>' in service.http.get(f"/folds/{wrench}").text


def test_a_running_fold_is_cancelled_and_the_same_can_be_asked_anew(service: Service) -> None:
    options = {"shape": "mallet-64", "preset": "paper"}  # it explodes slowly
    accepted = service.fold(**options)
    assert service.wait_exploding(accepted["id"])["status"] == "running"
    told = next(
        data
        for name, data in service.events(accepted["id"])
        if name == "progress" and data["stage"] == "explode" and data["steps"]
    )
    assert told["simulated_s"] == pytest.approx(0.01 * told["steps"])
    answer = service.http.post(f"/api/folds/{accepted['id']}/cancel", headers=owner(accepted))
    assert answer.status_code == 202
    events = list(service.events(accepted["id"]))
    assert events[-1][0] == "done"
    assert events[-1][1]["status"] == "cancelled"
    # Its frames stay to be looked at; the worker is free for others; the same begins anew.
    assert service.http.get(f"/api/folds/{accepted['id']}/frames").json()["total"] > 0
    timeline = service.directory(accepted["id"]) / "timeline.zarr"
    assert Timeline.open(timeline).status == "failed"  # nobody waits for more
    again = service.fold(**options)
    assert again["id"] != accepted["id"]
    service.wait_exploding(again["id"])
    assert service.http.delete(f"/api/folds/{again['id']}", headers=owner(again)).status_code == 204
    assert service.http.get(f"/api/folds/{again['id']}").status_code == 404
    other = service.fold(SNAKE, seed="12")
    assert service.wait_over(other["id"])["status"] == "verified"
    assert not (service.directory(again["id"])).exists()


def test_figures_and_health(service: Service, finished: dict[str, Any]) -> None:
    assert service.http.get("/health").json() == {"status": "ok"}
    ready = service.http.get("/ready")
    assert ready.status_code == 200
    assert {
        "ready": True,
        "database": "ok",
        "disk": "ok",
        "workers": 1,
    }.items() <= ready.json().items()
    figures = dict(
        line.rsplit(" ", 1)
        for line in service.metrics().text.splitlines()
        if not line.startswith("#")
    )
    assert float(figures['foldback_folds{status="verified"}']) >= 1
    assert float(figures["process_resident_memory_bytes"]) > 1e6


def test_the_first_shape_is_folded_once(here_with: Callable[..., ServiceHere]) -> None:
    service = here_with().start("--first-shape", "mallet-64")
    ids = _gallery_folds(service)
    assert len(ids) == 1
    assert service.stop() == 0
    again = ServiceHere(service.data_dir).start("--first-shape", "mallet-64")
    assert _gallery_folds(again) == ids
    assert again.stop() == 0


def _gallery_folds(service: Service) -> list[str]:
    deadline = time.monotonic() + 30
    while not (folds := service.http.get("/api/folds").json()["folds"]):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert [f["shape"] for f in folds] == ["mallet-64"]
    return [f["id"] for f in folds]


def test_json_is_strict(service: Service, finished: dict[str, Any]) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    for part in ("frames", "plan.json"):
        json.loads(get(service, finished, part).content, parse_constant=refuse)


def test_a_fold_is_asked_for_once_more_by_its_id(desk: Service) -> None:
    cells = [[x, y, z] for x in range(3) for y in range(2) for z in range(2)][::-1]
    first = desk.fold(cells, as_voxels="true", method="blocks", seed="21")
    assert desk.http.post(f"/api/folds/{first['id']}/cancel", headers=owner(first)).is_success
    again = desk.fold(fold=first["id"], seed="21")
    assert again["id"] != first["id"]
    folder = desk.data_dir / "folds"
    for name in ("input", "request.json", "cells.json"):
        before, after = ((folder / fold["id"] / name).read_bytes() for fold in (first, again))
        assert before == after
    other = desk.fold(fold=first["id"], seed="22", preset="paper")
    assert desk.state(other["id"])["preset"] == "paper"
    assert desk.fold(fold=other["id"], seed="22", preset="paper")["existing"]
    size = sum(path.stat().st_size for path in (folder / other["id"]).iterdir())
    # They count from now on, not from its end on; the cancelled one goes.
    settings = Settings(data_dir=desk.data_dir)
    store = Store(settings)
    try:
        assert store.fold(other["id"]).bytes == size
        later = time.time() + 2 * CANCELLED_FOLD_S
        Housekeeping(settings, store, clock=lambda: later).remove_cancelled()
    finally:
        store.close()
    assert desk.http.post("/api/folds", data={"fold": first["id"]}).status_code == 404
    assert desk.http.get(f"/folds/{first['id']}").status_code == 404


def test_settings_make_another_fold_unless_they_change_nothing(desk: Service) -> None:
    first = desk.fold(STAIRS, preset="paper", settings=" radial_gain=.2, damping=0.10,")
    assert desk.state(first["id"])["settings"] == "radial_gain=0.2"
    request = json.loads((desk.directory(first["id"]) / "request.json").read_bytes())
    assert request["settings"] == "radial_gain=0.2"
    token = first["owner_token"]

    def again(**form: str) -> dict[str, Any]:
        return desk.fold(STAIRS, token=token, **{"preset": "paper", **form})

    same = again(settings="step_s=0.01,radial_gain=0.20")
    assert (same["existing"], same["id"]) == (True, first["id"])
    plain = again()
    assert not plain["existing"]
    assert again(settings="damping=0.1")["id"] == plain["id"]
    assert not again(settings="radial_gain=0.3")["existing"]
    # By its id, too; what is made of it goes with the settings that are asked for.
    link = {"fold": first["id"], "preset": "paper"}
    assert desk.fold(**link, settings="radial_gain=0.2", token=token)["id"] == first["id"]
    assert desk.fold(**link, settings="radial_gain=0.2")["id"] == first["id"]
    assert desk.fold(**link, token=token)["id"] == plain["id"]


@pytest.mark.long
def test_a_published_fold_is_refolded(service: Service) -> None:
    asked = {"preset": "paper", "settings": "radial_gain=2"}
    first = service.fold(STAIRS, **asked)
    state = service.wait_over(first["id"])
    assert (state["status"], state["settings"]) == ("verified", "radial_gain=2")
    parameters = service.http.get(f"/api/folds/{first['id']}/plan.json").json()["parameters"]
    assert parameters["explosion"]["radial_gain"] == 2
    turned = [[y, x, z] for x, y, z in STAIRS]
    back = service.fold(turned, refold=first["id"], **asked)
    state = service.wait_over(back["id"])
    assert (state["status"], state["settings"]) == ("verified", "radial_gain=2")
    again = service.fold(fold=back["id"], token=back["owner_token"], **asked)
    assert (again["existing"], again["id"]) == (True, back["id"])


def test_a_fold_of_the_gallery_stays_one_when_asked_for_again(desk: Service) -> None:
    first = desk.fold(shape="wrench-24", seed="31")
    again = desk.fold(fold=first["id"], seed="32")
    assert desk.state(again["id"])["shape"] == "wrench-24"


def test_a_fold_that_is_not_there_cannot_be_asked_for_again(desk: Service) -> None:
    for name in ("nosuchfold", "../../etc", ""):
        assert desk.http.post("/api/folds", data={"fold": name}).status_code in (404, 422)
    both = desk.http.post("/api/folds", data={"fold": "a", "shape": "wrench-24"})
    assert both.json()["code"] == "file-or-shape"
