"""GLB: accepted by the validator, and folded in Blender as in the plan."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

VALIDATE = """
const validator = require('gltf-validator');
const data = new Uint8Array(require('fs').readFileSync(process.argv[1]));
validator.validateBytes(data).then((report) => console.log(JSON.stringify(report.issues)));
"""
Z_UP_TO_Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
SINGLE = 2e-6
"""Tolerance in pitches and of rotations, since the file has single precision."""


def test_validator_finds_no_fault_in_the_scene(exported: Any) -> None:
    done = subprocess.run(
        [os.environ["FOREIGN_NODE"], "-e", VALIDATE, str(exported.directory / "fold.glb")],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NODE_PATH": os.environ["FOREIGN_MODULES"]},
    )
    issues = json.loads(done.stdout)
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_blender_shows_the_folded_modules_as_the_plan(exported: Any, tmp_path: Path) -> None:
    out = tmp_path / "matrices.json"
    script = str(Path(__file__).with_name("in_blender.py"))
    glb = str(exported.directory / "fold.glb")
    subprocess.run([os.environ["FOREIGN_BLENDER"], script, glb, str(out)], check=True)
    shape_values = json.loads(out.read_text())
    for i in range(len(exported.centres_m)):
        matrix = np.array(shape_values[f"module_{i}"])
        off = matrix[:3, 3] - exported.positions_m[-1, i]
        assert np.abs(off).max() <= 1e-6
        # Blender rotates both the axes of each object and those of its mesh from y up to z up.
        np.testing.assert_allclose(
            matrix[:3, :3] @ Z_UP_TO_Y_UP, exported.rotations[-1, i], atol=SINGLE
        )
