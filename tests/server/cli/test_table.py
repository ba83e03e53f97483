"""``foldback table``: what it prints, writes and ends with."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from planner.certificate.table_figures import TableCertificate
from planner.motion.motion import Motion
from planner.simulation.parameters import Parameters
from server.cli.command_line import application
from tests.planner.certificate.test_table import moving
from tests.planner.chains import line
from tests.planner.plans import unverified


def table(*arguments: str | Path) -> Result:
    return CliRunner().invoke(
        application(), ["table", *map(str, arguments)], prog_name="foldback", terminal_width=200
    )


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    chain = line(6)
    motion: Motion = moving(chain, 1, -0.3)
    unverified(chain, motion, Parameters()).save_npz(tmp_path / "plan.npz")
    return tmp_path


def test_a_plan_that_rests(plan: Path) -> None:
    done = table(plan, "--module-kg", "0.1", "--pitch-mm", "50", "--bound", "12")
    assert done.exit_code == 0, done.output
    assert "rests on a table within" in done.stdout
    assert "frictionless" in done.stdout
    found = TableCertificate.from_dict(json.loads((plan / "table.json").read_text()))
    assert found.rests
    assert found.torque == pytest.approx(10.0 * np.cos(0.3 / 4), rel=1e-3)
    assert found.unit_nm == pytest.approx(0.1 * 9.81 * 0.05)


def test_a_plan_that_does_not_rest_ends_with_three(plan: Path) -> None:
    done = table(plan / "plan.npz", "--base", "free", "--out", plan / "mine.json", "--json")
    assert done.exit_code == 3
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["verdict"].startswith("failed: the chain would tip over")
    assert json.loads((plan / "mine.json").read_text()) == told


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--base", "held"), "expected clamped or free"),
        (("--friction", "-1"), "friction"),
        (("--pitch-mm", "0"), "pitch_m"),
    ],
)
def test_bad_input_ends_with_two(plan: Path, options: tuple[str, ...], words: str) -> None:
    done = table(plan, *options)
    assert done.exit_code == 2
    assert words in done.stderr
    assert table(plan / "none").exit_code == 2
