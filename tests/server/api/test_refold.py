"""Refolds over HTTP, with a real worker, and on the command line."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.plan.plan import Plan
from foldback.planner.reasons import Reason, ReasonCode
from foldback.planner.verification.verify import verify
from tests.planner.plans import with_values
from tests.server.cli.test_command_line import foldback_json
from tests.server.files.test_damage import SMALL
from tests.server.service_process import SNAKE, Service, owner


def test_finished_fold_is_refolded_into_another_shape_unlisted(
    service: Service, wrench: str
) -> None:
    """The planner's tests check the result of a refold."""
    accepted = service.fold(refold=wrench, shape="mallet-24")
    token, fold_id = accepted["owner_token"], accepted["id"]
    state = service.wait_over(fold_id)
    assert state["status"] == "verified", state
    assert (state["refold"], state["shape"]) == (service.state(wrench)["name"], "mallet-24")
    assert state["summary"]["refold"]["start"] == "wrench-24"
    body = service.http.get(f"/api/folds/{fold_id}/frames").json()
    phases = [body["phases"][i] for i in body["phase"]]
    assert [*dict.fromkeys(phases)] == ["unfolding", "playback"]
    wrench_directory, fold_directory = service.directory(wrench), service.directory(fold_id)
    assert verify(fold_directory).verified
    assert (fold_directory / "start.npz").read_bytes() == (
        wrench_directory / "plan.npz"
    ).read_bytes()
    assert (fold_directory / "start.json").read_bytes() == (
        wrench_directory / "chain.json"
    ).read_bytes()
    for form in ({"refold": wrench, "shape": "mallet-24"}, {"fold": fold_id}):
        assert service.fold(**form, token=token)["id"] == fold_id
    assert fold_id not in {f["id"] for f in service.http.get("/api/folds").json()["folds"]}
    other_fold = service.fold(fold=fold_id, seed=1)
    assert service.state(other_fold["id"])["refold"] == state["refold"]
    assert json.loads((service.directory(other_fold["id"]) / "request.json").read_bytes())["refold"]
    service.http.post(f"/api/folds/{other_fold['id']}/cancel", headers=owner(other_fold))


def test_shapes_that_fit_are_listed_and_others_are_refused(service: Service, wrench: str) -> None:
    fitting_shapes = service.http.get(service.state(wrench)["links"]["refolds"]).json()["shapes"]
    assert [(s["name"], s["modules"]) for s in fitting_shapes] == [("mallet-24", 24)]
    for shape, count_words in (("mallet-64", "64 cubes"), ("tetra-dodecahedron", "24 tetrahedra")):
        status, problem = service.refusal(refold=wrench, shape=shape)
        assert (status, problem["code"]) == (422, "refold-differs")
        assert f"got a shape of {count_words}, expected 24 cubes" in problem["detail"]
        assert "these examples fit: mallet-24, wrench-24." in problem["detail"]


def test_refold_that_differs_after_a_search_fails(service: Service, wrench: str) -> None:
    box = [[x, y, z] for x in range(3) for y in range(3) for z in range(3)][:26]
    accepted = service.fold(box, refold=wrench, as_voxels="true", repair="true")
    state = service.wait_over(accepted["id"])
    assert (state["status"], state["stage"]) == ("failed", "read")
    assert state["error"]["code"] == "refold-differs"
    assert "these examples fit: mallet-24, wrench-24." in state["error"]["detail"]


def test_only_finished_folds_with_a_suitable_plan_are_refolded_or_smoothed(
    idle: Service, tmp_path: Path
) -> None:
    waiting = idle.fold(SNAKE, seed="31")
    forms = {"refold": {"refold": waiting["id"], "shape": "tetra-cube-2"}}
    forms["smooth"] = {"smooth": waiting["id"]}

    def refused(use: str) -> tuple[int, str, str]:
        status, problem = idle.refusal(**forms[use])
        return status, problem["code"], problem["detail"]

    assert [refused(use)[:2] for use in forms] == [(409, f"{use}-not-ready") for use in forms]
    idle.http.post(f"/api/folds/{waiting['id']}/cancel", headers=owner(waiting))
    assert [refused(use)[:2] for use in forms] == [(422, f"{use}-no-plan") for use in forms]
    assert idle.refusal(refold="nosuchfold", shape="tetra-cube-2")[0] == 404
    unpack(SMALL.read_bytes(), tmp_path)
    fold_directory = idle.directory(waiting["id"])
    shutil.copyfile(tmp_path / "chain.json", fold_directory / "chain.json")
    plan = Plan.load(tmp_path / "plan.npz")
    other_plan = with_values(plan, joint_angles_rad=0.9 * plan.joint_angles_rad)
    other_plan.save_npz(fold_directory / "plan.npz")
    status, code, detail = refused("refold")
    assert (status, code) == (422, "refold-not-folded")
    assert "that does not start straight and end folded" in detail
    failed = replace(plan.certificate, reason=Reason.of(ReasonCode.PLAN_END))
    replace(plan, certificate=failed).save_npz(fold_directory / "plan.npz")
    assert refused("smooth")[:2] == (422, "smooth-not-verified")
    assert not idle.http.get(f"/folds/{waiting['id']}/facts").json()["smooth_question"]


@pytest.mark.long
@pytest.mark.slow
def test_examples_and_directories_are_refolded_on_the_command_line(tmp_path: Path) -> None:
    summary = foldback_json("refold", "wrench-24", "mallet-24", "--out", tmp_path)
    assert (summary["status"], summary["refold"]["start"]) == ("verified", "wrench-24")
    # Each of the two shapes may be a directory with a plan.
    start, out = tmp_path / "start", tmp_path / "back"
    foldback_json("refold", tmp_path, start, "--out", out, "--module-size", "0.9")
    refolded_plan = Plan.load(out / "plan.npz")
    assert refolded_plan.certificate.module_size == 0.9
    assert (refolded_plan.start.name, refolded_plan.chain.name) == ("mallet-24", "wrench-24")
