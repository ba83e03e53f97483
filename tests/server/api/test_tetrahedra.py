"""Chains of tetrahedra over HTTP and on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh

from tests.server.cli.test_command_line import foldback
from tests.server.service import Service

RING = "- - - + - - - + - - -"
U = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0]]


@pytest.mark.long
@pytest.mark.slow
def test_a_typed_chain_folds_and_its_size_is_told(tmp_path: Path) -> None:
    out = str(tmp_path / "ring")
    answer = foldback("fold", "--angles", RING, "--out", out, "--json")
    assert answer.returncode == 0, answer.stderr
    summary = json.loads(answer.stdout.splitlines()[-1])
    assert (summary["status"], summary["modules"]) == ("verified", 12)
    checked = foldback("verify", out, "--largest-size", "--json")
    assert checked.returncode == 0, checked.stderr
    found = json.loads(checked.stdout.splitlines()[-1])
    assert 0.95 <= found["largest_size"] <= 1.0
    told = foldback("verify", out, "--largest-size").stdout
    assert (
        "plan and playback are free of collisions up to a module size of "
        f"{found['largest_size']:.3f}"
    ) in told


@pytest.mark.parametrize(
    ("arguments", "code", "where"),
    [
        (("--angles", "0 - x +"), "stray-character", "character 5"),
        (("--angles", "- - - + - - - + - - - +"), "overlap", "modules 0 and 12"),
        (("--angles", ""), "wrong-count", None),
        (("--angles", RING, "wrench-24"), "no-input", None),
        ((), "no-input", None),
        (("wrench-24", "--module", "sphere"), "unknown-module", "module"),
    ],
)
def test_bad_chains_are_refused_before_anything_is_simulated(
    tmp_path: Path, arguments: tuple[str, ...], code: str, where: str | None
) -> None:
    answer = foldback("fold", *arguments, "--out", str(tmp_path / "out"), "--json")
    assert answer.returncode == 2
    error = json.loads(answer.stdout.splitlines()[-1])["error"]
    assert (error["code"], error["where"]) == (code, where)


def test_a_mesh_becomes_a_chain_file(tmp_path: Path) -> None:
    mesh, out = tmp_path / "ball.stl", tmp_path / "ball.json"
    trimesh.creation.icosphere(subdivisions=2).export(mesh)
    answer = foldback(
        *("shape", str(mesh), "--module", "tetrahedron", "--modules", "96"),
        *("--out", str(out), "--json"),
    )
    assert answer.returncode == 0, answer.stderr
    report = json.loads(answer.stdout.splitlines()[-1])
    written = json.loads(out.read_text())
    assert (report["module"], written["module"]) == ("tetrahedron", "tetrahedron")
    assert len(written["joint_angles_deg"]) == report["modules"] - 1
    assert report["modules"] % 12 == 0


@pytest.mark.long
def test_the_cells_of_a_path_fold_as_rings(service: Service) -> None:
    accepted = service.fold(U[:2] + [[2, 0, 0]], module="tetrahedron")
    state = service.wait_over(accepted["id"])
    assert (state["status"], state["module"], state["modules"]) == ("verified", "tetrahedron", 36)
    plan = service.http.get(f"/api/folds/{accepted['id']}/plan.json").json()
    assert plan["joint_names"][:2] == ["joint_0", "joint_1"]


def test_a_typed_file_is_judged_at_the_door(desk: Service) -> None:
    def posted(text: str) -> tuple[int, dict[str, object]]:
        answer = desk.http.post(
            "/api/folds", files={"file": ("chain.txt", f"foldback-angles/1\n{text}".encode())}
        )
        return answer.status_code, answer.json()

    status, problem = posted("0 + ?")
    assert (status, problem["code"], problem["where"]) == (422, "stray-character", "character 5")
    status, _ = posted(RING)
    assert status == 202


def test_cells_in_several_parts_have_no_trail(desk: Service) -> None:
    data = json.dumps({"format": "foldback-voxels/1", "cells": [[0, 0, 0], [3, 0, 0]]}).encode()
    answer = desk.http.post(
        "/api/folds", files={"file": ("v.json", data)}, data={"module": "tetrahedron"}
    )
    assert answer.status_code == 422
    assert answer.json()["code"] == "no-path"
    assert "2 parts" in answer.json()["detail"]


def test_the_gallery_says_what_its_chains_are_made_of(desk: Service) -> None:
    shapes = desk.http.get("/api/shapes").json()["shapes"]
    kinds = {shape["name"]: shape["module"] for shape in shapes}
    assert kinds["tetra-ring"] == "tetrahedron"
    assert kinds["wrench-160"] == "cube"
    drawing = desk.http.get("/shapes/tetra-ring.svg")
    assert drawing.headers["content-type"].startswith("image/svg+xml")
