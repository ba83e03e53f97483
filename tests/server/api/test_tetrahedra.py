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
def test_typed_chain_is_folded_and_its_largest_module_size_found(tmp_path: Path) -> None:
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
    assert f"free of collisions up to a module size of {found['largest_size']:.3f}" in told


@pytest.mark.parametrize(
    ("arguments", "code", "where"),
    [
        (("--angles", "0 - x +"), "stray-character", "character 5"),
        (("--angles", RING, "wrench-24"), "no-input", None),
        ((), "no-input", None),
        (("wrench-24", "--module", "sphere"), "unknown-module", "module"),
    ],
)
def test_bad_chains_are_refused_on_the_command_line(
    tmp_path: Path, arguments: tuple[str, ...], code: str, where: str | None
) -> None:
    answer = foldback("fold", *arguments, "--out", str(tmp_path / "out"), "--json")
    assert answer.returncode == 2
    error = json.loads(answer.stdout.splitlines()[-1])["error"]
    assert (error["code"], error["where"]) == (code, where)


def test_shape_command_writes_a_chain_for_a_mesh(tmp_path: Path) -> None:
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
def test_cells_of_a_path_fold_as_rings_of_tetrahedra(service: Service) -> None:
    accepted = service.fold(U[:2] + [[2, 0, 0]], module="tetrahedron")
    state = service.wait_over(accepted["id"])
    assert (state["status"], state["module"], state["modules"]) == ("verified", "tetrahedron", 36)
    plan = service.http.get(f"/api/folds/{accepted['id']}/plan.json").json()
    assert plan["joint_names"][:2] == ["joint_0", "joint_1"]


def test_uploads_of_tetrahedra_are_checked(desk: Service) -> None:
    apart = json.dumps({"format": "foldback-voxels/1", "cells": [[0, 0, 0], [3, 0, 0]]})
    for text, form, status, code, where in (
        ("foldback-angles/1\n0 + ?", {}, 422, "stray-character", "character 5"),
        (f"foldback-angles/1\n{RING}", {}, 202, None, None),
        (apart, {"module": "tetrahedron"}, 422, "no-path", None),
    ):
        file = {"file": ("chain.txt", text.encode())}
        answer = desk.http.post("/api/folds", files=file, data=form)
        told = answer.json()
        assert (answer.status_code, told.get("code"), told.get("where")) == (status, code, where)


def test_shapes_are_listed_with_their_modules_and_drawn(desk: Service) -> None:
    shapes = desk.http.get("/api/shapes").json()["shapes"]
    kinds = {shape["name"]: shape["module"] for shape in shapes}
    assert (kinds["tetra-ring"], kinds["wrench-160"]) == ("tetrahedron", "cube")
    drawing = desk.http.get("/shapes/tetra-ring.svg")
    assert drawing.headers["content-type"].startswith("image/svg+xml")
