"""Refolds through HTTP, with a real worker, and on the command line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner
from websockets.sync.client import connect

from planner.plan.plan import Plan
from planner.readers.gallery import Gallery
from planner.verification.verify import verify
from server.cli.command_line import application
from tests.planner.plans import changed
from tests.server.service import SNAKE, SPIRAL, Service, bearer, owner


@pytest.fixture(scope="module")
def mallet(service: Service, wrench: str) -> dict[str, Any]:
    """The wrench refolded into a mallet: what the request was answered, and how it ended."""
    accepted = service.fold(refold=wrench, shape="mallet-24")
    return {"accepted": accepted, "state": service.wait_over(accepted["id"])}


def test_a_finished_fold_goes_on_to_another_shape(
    service: Service, wrench: str, mallet: dict[str, Any]
) -> None:
    state = mallet["state"]
    assert state["status"] == "verified", state
    assert state["id"] != wrench
    assert (state["refold"], state["shape"]) == (service.state(wrench)["name"], "mallet-24")
    assert state["summary"]["refold"]["start"] == "wrench-24"
    here = f"/api/folds/{state['id']}"
    body = service.http.get(f"{here}/frames").json()
    phases = [body["phases"][i] for i in body["phase"]]
    assert [*dict.fromkeys(phases)] == ["unfolding", "playback"]
    assert phases.index("playback") == state["summary"]["refold"]["straight_frame"]
    assert body["joint_angles_rad"][0] == pytest.approx(
        Plan.load(service.directory(wrench) / "plan.npz").chain.folded_rad.tolist()
    )
    assert service.http.get(f"{here}/plan.json").json()["start"]["name"] == "wrench-24"
    assert verify(service.directory(state["id"])).verified


def test_a_robot_is_to_be_brought_to_the_shape_that_it_begins_with(
    service: Service, wrench: str, mallet: dict[str, Any]
) -> None:
    base = str(service.http.base_url).replace("http", "ws", 1).rstrip("/")
    folded = Plan.load(service.directory(wrench) / "plan.npz").chain.folded_rad
    assert np.abs(folded).max() > 1.5
    with connect(f"{base}/api/folds/{mallet['state']['id']}/play", max_size=None) as socket:
        begin, waiting = (json.loads(socket.recv(timeout=30)) for _ in range(2))
        assert begin["joint_angles_rad"] == pytest.approx(folded.tolist(), abs=1e-5)
        assert waiting["because"] == "start"
        error = np.abs(folded).max()  # of a robot that is straight
        socket.send(json.dumps({"do": "report", "joint_angles_rad": [0.0] * len(folded)}))
        told = json.loads(socket.recv(timeout=30))
        assert (told["is"], told["error_rad"]) == ("waiting", pytest.approx(error))


def test_it_is_a_fold_of_its_own_that_is_not_listed(
    service: Service, wrench: str, mallet: dict[str, Any]
) -> None:
    token = mallet["accepted"]["owner_token"]
    again = service.fold(refold=wrench, shape="mallet-24", token=token)
    assert again["existing"]
    assert again["id"] == mallet["accepted"]["id"]
    listed = service.http.get("/api/folds").json()["folds"]
    assert again["id"] not in {f["id"] for f in listed}
    plain = service.fold(shape="mallet-24", token=token)
    assert plain["id"] != again["id"]
    assert service.state(plain["id"])["refold"] is None
    service.http.post(f"/api/folds/{plain['id']}/cancel", headers=bearer(token))


def test_a_refold_keeps_its_beginning_and_is_repeated_as_one(
    service: Service, wrench: str, mallet: dict[str, Any]
) -> None:
    fold_id = mallet["accepted"]["id"]
    theirs, mine = service.directory(wrench), service.directory(fold_id)
    assert (mine / "start.npz").read_bytes() == (theirs / "plan.npz").read_bytes()
    assert (mine / "start.json").read_bytes() == (theirs / "chain.json").read_bytes()
    repeated = service.fold(fold=fold_id)
    assert (repeated["existing"], repeated["id"]) == (True, fold_id)
    other = service.fold(fold=fold_id, seed="1")
    assert service.state(other["id"])["refold"] == mallet["state"]["refold"]
    request = json.loads((service.directory(other["id"]) / "request.json").read_bytes())
    assert request["refold"] is True
    service.http.post(f"/api/folds/{other['id']}/cancel", headers=owner(other))


def test_what_fits_is_listed(service: Service, wrench: str) -> None:
    found = service.http.get(f"/api/folds/{wrench}/refolds").json()["shapes"]
    assert [(s["name"], s["modules"]) for s in found] == [("mallet-24", 24)]
    link = service.state(wrench)["links"]["refolds"]
    assert service.http.get(link).json()["shapes"] == found
    assert service.http.get("/api/folds/nosuchfold/refolds").status_code == 404


def test_a_shape_that_differs_is_refused_with_those_that_fit(service: Service, wrench: str) -> None:
    for shape, what in (("mallet-64", "64 cubes"), ("tetra-dodecahedron", "24 tetrahedra")):
        status, problem = service.refused(refold=wrench, shape=shape)
        assert (status, problem["code"]) == (422, "refold-differs")
        assert f"got a shape of {what}, expected one of 24 cubes" in problem["detail"]
        assert "examples that fit: mallet-24, wrench-24." in problem["detail"]


def test_what_is_only_known_after_a_search_is_refused_then(service: Service, wrench: str) -> None:
    box = [[x, y, z] for x in range(3) for y in range(3) for z in range(3)][:26]
    answer = service.http.post(
        "/api/folds",
        data={"refold": wrench, "as_voxels": "true", "repair": "true"},
        files={"file": ("box.json", json.dumps(box))},
    )
    assert answer.status_code == 202, answer.text
    state = service.wait_over(answer.json()["id"])
    assert (state["status"], state["stage"]) == ("failed", "read")
    assert state["error"]["code"] == "refold-differs"
    assert "examples that fit: mallet-24, wrench-24." in state["error"]["detail"]


def test_only_a_finished_fold_with_a_plan_is_refolded(desk: Service) -> None:
    waiting = desk.fold(SNAKE, seed="31")
    status, problem = desk.refused(refold=waiting["id"], shape="mallet-24")
    assert (status, problem["code"]) == (409, "refold-not-ready")
    assert "queued" in problem["detail"]
    desk.http.post(f"/api/folds/{waiting['id']}/cancel", headers=owner(waiting))
    status, problem = desk.refused(refold=waiting["id"], shape="mallet-24")
    assert (status, problem["code"]) == (422, "refold-no-plan")
    assert desk.refused(refold="nosuchfold", shape="mallet-24")[0] == 404
    assert desk.refused(refold=waiting["id"])[1]["code"] == "file-or-shape"


def test_a_plan_that_never_comes_to_its_shape_is_no_beginning(
    desk: Service, service: Service, wrench: str
) -> None:
    over = desk.fold(SNAKE, seed="32")
    desk.http.post(f"/api/folds/{over['id']}/cancel", headers=owner(over))
    theirs, mine = service.directory(wrench), desk.directory(over["id"])
    plan = Plan.load(theirs / "plan.npz")
    changed(plan, joint_angles_rad=0.9 * plan.joint_angles_rad).save_npz(mine / "plan.npz")
    shutil.copyfile(theirs / "chain.json", mine / "chain.json")
    status, problem = desk.refused(refold=over["id"], shape="mallet-24")
    assert (status, problem["code"]) == (422, "refold-not-folded")
    assert "wrench-24 that does not start straight and end folded" in problem["detail"]


def cli(*arguments: object) -> tuple[int, str]:
    told = CliRunner().invoke(application(), ["refold", *map(str, arguments)])
    return told.exit_code, told.output


@pytest.mark.long
@pytest.mark.slow
def test_two_examples_are_refolded_on_the_command_line(tmp_path: Path) -> None:
    code, told = cli("wrench-24", "mallet-24", "--out", tmp_path, "--json")
    assert code == 0, told
    summary = json.loads(told.splitlines()[-1])
    assert (summary["status"], summary["refold"]["start"]) == ("verified", "wrench-24")
    assert verify(tmp_path).verified
    assert Plan.load(tmp_path / "start" / "plan.npz").chain.name == "wrench-24"
    # Folders of plans are taken on either side.
    code, told = cli(tmp_path, tmp_path / "start", "--out", tmp_path / "back", "--module-size", 0.9)
    assert code == 0, told
    assert "mallet-24" in told
    back = Plan.load(tmp_path / "back" / "plan.npz")
    assert back.certificate.module_size == 0.9
    assert (back.start.name, back.chain.name) == ("mallet-24", "wrench-24")


def test_the_command_line_refuses_what_differs_and_what_is_no_plan(tmp_path: Path) -> None:
    code, told = cli("wrench-160", "hammer", "--out", tmp_path, "--json")
    assert code == 2
    error = json.loads(told.splitlines()[-1])["error"]
    assert error["code"] == "refold-differs"
    fitting = [s.name for s in Gallery().fitting("cube", 160)]
    assert f"examples that fit: {', '.join(fitting[:6])}" in error["detail"]
    assert not (tmp_path / "timeline.zarr").exists()
    assert not (tmp_path / "start" / "timeline.zarr").exists()
    empty = tmp_path / "empty"
    empty.mkdir()
    code, told = cli(empty, "hammer", "--out", tmp_path / "out")
    assert code == 2
    assert "plan.npz" in told


@pytest.mark.long
@pytest.mark.slow
def test_a_plan_that_is_not_verified_exits_with_3(tmp_path: Path) -> None:
    files = []
    for name, cells in (("spiral", SPIRAL), ("snake", SNAKE)):
        files.append(tmp_path / f"{name}.json")
        files[-1].write_text(json.dumps(cells))
    code, told = cli(*files, "--out", tmp_path / "out", "--preset", "direct", "--json")
    assert code == 3
    assert json.loads(told.splitlines()[-1])["status"] == "failed"
