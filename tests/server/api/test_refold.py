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
from tests.server.service import SNAKE, SPIRAL, Service, owner


@pytest.fixture(scope="module")
def mallet(service: Service, wrench: str) -> dict[str, Any]:
    """The wrench refolded into a mallet: what the request was answered, and how it ended."""
    accepted = service.fold(refold=wrench, shape="mallet-24")
    return {"accepted": accepted, "state": service.wait_over(accepted["id"])}


def test_finished_fold_is_refolded_into_another_shape(
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


def test_play_of_refold_begins_with_the_folded_shape(
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


def test_refold_is_an_unlisted_fold_that_keeps_its_beginning(
    service: Service, wrench: str, mallet: dict[str, Any]
) -> None:
    accepted = mallet["accepted"]
    token, fold_id = accepted["owner_token"], accepted["id"]
    for form in ({"refold": wrench, "shape": "mallet-24"}, {"fold": fold_id}):
        again = service.fold(**form, token=token)
        assert (again["existing"], again["id"]) == (True, fold_id)
    assert fold_id not in {f["id"] for f in service.http.get("/api/folds").json()["folds"]}
    theirs, mine = service.directory(wrench), service.directory(fold_id)
    assert (mine / "start.npz").read_bytes() == (theirs / "plan.npz").read_bytes()
    assert (mine / "start.json").read_bytes() == (theirs / "chain.json").read_bytes()
    plain, other = service.fold(shape="mallet-24", token=token), service.fold(fold=fold_id, seed=1)
    assert plain["id"] != fold_id and service.state(plain["id"])["refold"] is None
    assert service.state(other["id"])["refold"] == mallet["state"]["refold"]
    request = json.loads((service.directory(other["id"]) / "request.json").read_bytes())
    assert request["refold"] is True
    for fold in (plain, other):
        if not fold["existing"]:
            service.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))


def test_shapes_that_fit_are_listed_and_others_are_refused(service: Service, wrench: str) -> None:
    found = service.http.get(f"/api/folds/{wrench}/refolds").json()["shapes"]
    assert [(s["name"], s["modules"]) for s in found] == [("mallet-24", 24)]
    assert service.state(wrench)["links"]["refolds"] == f"/api/folds/{wrench}/refolds"
    assert service.http.get("/api/folds/nosuchfold/refolds").status_code == 404
    for shape, what in (("mallet-64", "64 cubes"), ("tetra-dodecahedron", "24 tetrahedra")):
        status, problem = service.refused(refold=wrench, shape=shape)
        assert (status, problem["code"]) == (422, "refold-differs")
        assert f"got a shape of {what}, expected one of 24 cubes" in problem["detail"]
        assert "examples that fit: mallet-24, wrench-24." in problem["detail"]


def test_refold_that_differs_after_a_search_fails(service: Service, wrench: str) -> None:
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


def test_only_finished_folds_with_a_plan_that_folds_are_refolded(
    desk: Service, service: Service, wrench: str
) -> None:
    waiting = desk.fold(SNAKE, seed="31")

    def refused(fold_id: str = waiting["id"]) -> tuple[int, str, str]:
        status, problem = desk.refused(refold=fold_id, shape="mallet-24")
        return status, problem["code"], problem["detail"]

    assert refused()[:2] == (409, "refold-not-ready")
    desk.http.post(f"/api/folds/{waiting['id']}/cancel", headers=owner(waiting))
    assert refused()[:2] == (422, "refold-no-plan")
    assert refused("nosuchfold")[0] == 404
    theirs, mine = service.directory(wrench), desk.directory(waiting["id"])
    plan = Plan.load(theirs / "plan.npz")
    changed(plan, joint_angles_rad=0.9 * plan.joint_angles_rad).save_npz(mine / "plan.npz")
    shutil.copyfile(theirs / "chain.json", mine / "chain.json")
    status, code, detail = refused()
    assert (status, code) == (422, "refold-not-folded")
    assert "wrench-24 that does not start straight and end folded" in detail


def cli(*arguments: object) -> tuple[int, str]:
    told = CliRunner().invoke(application(), ["refold", *map(str, arguments)])
    return told.exit_code, told.output


@pytest.mark.long
@pytest.mark.slow
def test_examples_and_directories_are_refolded_on_the_command_line(tmp_path: Path) -> None:
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


def test_command_line_refuses_refolds_that_differ_or_have_no_plan(tmp_path: Path) -> None:
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
def test_refold_that_is_not_verified_exits_with_3(tmp_path: Path) -> None:
    files = [tmp_path / "spiral.json", tmp_path / "snake.json"]
    for file, cells in zip(files, (SPIRAL, SNAKE), strict=True):
        file.write_text(json.dumps(cells))
    code, told = cli(*files, "--out", tmp_path / "out", "--preset", "direct", "--json")
    assert (code, json.loads(told.splitlines()[-1])["status"]) == (3, "failed")
