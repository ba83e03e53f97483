"""``foldback servos``: a table, the same values as JSON, and refusals."""

from pathlib import Path

import pytest

from foldback.planner.plan.plan import Plan
from foldback.planner.servos.servos import servos
from foldback.planner.servos.sizing import total_turn_rad
from tests.server.cli.test_command_line import foldback, foldback_json
from tests.server.cli.test_table import write_plan

ARGUMENTS = ("--torque", "4", "--pitch-mm", "40")


def test_servos_are_listed_from_the_most_suitable() -> None:
    answer = foldback("servos", *ARGUMENTS)
    assert answer.returncode == 0, answer.stderr
    assert all(f"{servo.maker} {servo.name}" in answer.stdout for servo in servos())
    assert answer.stdout.index("STS3032") < answer.stdout.index("MX-106T")
    assert "yes, 1.8×" in answer.stdout
    shapes = ("--shape", "3x3x3=3.6", "--shape", "a=b=3160")
    report = foldback_json("servos", *ARGUMENTS, "--material", "pla-box", *shapes)
    assert len(report["servos"]) == len(servos())
    assert report["shapes"]["a=b"] == []
    assert "SG90" not in report["shapes"]["3x3x3"]  # rotates by 150° only
    assert "none" in foldback("servos", *ARGUMENTS, *shapes).stdout


def test_returncode_is_3_when_no_servo_would_do() -> None:
    assert foldback("servos", "--torque", "3160", "--pitch-mm", "40").returncode == 3
    alone = foldback("servos", *ARGUMENTS, "--servo", "mg996r", "--mass-g", "130")
    assert alone.returncode == 3
    assert "turns only 120°" in " ".join(alone.stdout.split())


def test_least_folding_time_of_a_plan(tmp_path: Path) -> None:
    plan = Plan.load(write_plan(tmp_path, modules=4))
    arguments = (*ARGUMENTS, "--servo", "STS3032", "--plan", str(tmp_path))
    row = foldback_json("servos", *arguments)["servos"][0]
    speed = (1.0 - row["need_nm"] / (3.0 * row["gives_nm"])) * 1.0472 / 0.09
    assert row["least_s"] == pytest.approx(total_turn_rad(plan.joint_angles_rad) / speed, rel=1e-3)
    assert "Folding" in foldback("servos", *arguments).stdout
    assert "Folds" not in foldback("servos", *ARGUMENTS).stdout
