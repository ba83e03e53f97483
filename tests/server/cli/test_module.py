"""``foldback module``, and ``fold --module FILE``: modules of one's own on the command line."""

import json
from pathlib import Path

import numpy as np
import pytest

from foldback.planner.plan.plan import Plan
from tests.planner.chain.test_module_checks import document
from tests.planner.readers.test_urdf_module import urdf
from tests.server.cli.test_command_line import foldback, foldback_json


def test_module_out_of_a_urdf_file_folds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("slabs.urdf").write_bytes(urdf())
    assert (
        "has no faults: 1 piece, 1 hinge"
        in foldback("module", "slabs.urdf", "--out", "m.json").stdout
    )
    assert foldback_json("module", "m.json") == {
        "status": "checked",
        "name": "two-slabs",
        "notes": [],
    }
    angles = "40 " * 6
    foldback_json("fold", "--module", "m.json", "--angles", angles, "--out", "arc")  # verified
    plan = Plan.load(tmp_path / "arc" / "plan.npz")
    assert (plan.chain.module.name, len(plan.chain), plan.chain.pitch_m) == ("two-slabs", 7, 0.06)
    np.testing.assert_allclose(np.rad2deg(plan.chain.folded_rad), 40.0)
    # Masses and speeds of the real robot are those of the URDF file.
    assert plan.certificate.joint_speed_limit_rad_s == 4.0
    density = 0.1 / (2 * 0.02 * 0.016 * 0.016)
    np.testing.assert_allclose(plan.parameters["density_kg_m3"], density)
    limits = ("--max-acceleration", "10", "--out", "arc.csv")
    motors = foldback_json("retime", "arc", *limits)["motors"]
    assert motors["motor_torque_nm"] == 1.5


def test_faults_of_a_module_end_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    free = json.dumps(document()).replace('"range_deg": [-80, 80]', '"range_deg": null')
    Path("free.json").write_text(free)
    for command in (("module", "free.json"), ("fold", "free.json", "--out", "out")):
        answer = foldback(*command)
        assert answer.returncode == 2
        assert "collide at 9" in answer.stderr
