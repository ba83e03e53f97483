"""Chains of tetrahedra over HTTP and on the command line."""

import json
from pathlib import Path

import pytest
import trimesh

from tests.server.cli.test_command_line import foldback_json
from tests.server.service_process import Service

RING = "- - - + - - - + - - -"


@pytest.mark.long
@pytest.mark.slow
def test_typed_chain_is_folded_and_its_largest_module_size_found(tmp_path: Path) -> None:
    out = str(tmp_path / "ring")
    summary = foldback_json("fold", "--angles", RING, "--out", out)
    assert (summary["status"], summary["modules"]) == ("verified", 12)
    assert 0.95 <= foldback_json("verify", out, "--largest-size")["largest_size"] <= 1.0


def test_shape_command_writes_a_chain_for_a_mesh(tmp_path: Path) -> None:
    mesh, out = tmp_path / "ball.stl", tmp_path / "ball.json"
    trimesh.creation.icosphere(subdivisions=2).export(mesh)
    expected = ("--module", "tetrahedron", "--modules", "48", "--out", out)
    report = foldback_json("shape", mesh, *expected)
    written = json.loads(out.read_text())
    assert (report["module"], written["module"]) == ("tetrahedron", "tetrahedron")
    assert len(written["joint_angles_deg"]) == report["modules"] - 1
    assert 0.9 * 48 <= report["modules"] <= 48


def test_uploads_of_tetrahedra_are_checked(idle: Service) -> None:
    apart = json.dumps({"format": "foldback-voxels/1", "cells": [[0, 0, 0], [3, 0, 0]]})
    for text, form, status, code, error_place in (
        ("foldback-angles/1\n0 + ?", {}, 422, "stray-character", "character 5"),
        (f"foldback-angles/1\n{RING}", {}, 202, None, None),
        (apart, {"module": "tetrahedron"}, 422, "no-path", None),
    ):
        answer = idle.upload("chain.txt", text, **form)
        body = answer.json()
        assert (answer.status_code, body.get("code"), body.get("where")) == (
            status,
            code,
            error_place,
        )
