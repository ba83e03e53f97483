"""``foldback table``: its output, files and exit status."""

import json
from pathlib import Path

import numpy as np
import pytest

from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.parameters.parameters import Parameters
from tests.planner.certificate.test_table_certificate import swing
from tests.planner.chains import line
from tests.planner.plans import unverified
from tests.server.api.test_table import SLAB
from tests.server.cli.test_command_line import foldback, foldback_json


def test_shape_without_a_path_for_a_table_lists_versions_that_have_one(tmp_path: Path) -> None:
    slab, out = tmp_path / "slab.json", tmp_path / "path.json"
    slab.write_text(json.dumps(SLAB))
    command = ("shape", str(slab), "--as-voxels", "--world", "table", "--out", str(out))
    none = foldback(*command)
    assert none.returncode == 3 and not out.exists()
    assert none.stderr.splitlines()[1:] == [
        "A similar shape has a path: --repair (9 modules)",
        "A similar shape has a path: --method blocks (64 modules)",
    ]
    data = foldback_json(*command, "--repair")
    assert (data["modules"], data["offers"]) == (9, [])
    assert len(json.loads(out.read_bytes())["cells"]) == 9


def test_shape_of_a_long_path_for_a_table_warns(tmp_path: Path) -> None:
    row, out = tmp_path / "row.json", tmp_path / "path.json"
    for length, warned in ((96, False), (97, True)):
        row.write_text(json.dumps([[x, 0, 0] for x in range(length)]))
        command = ("shape", str(row), "--world", "table", "--out", str(out))
        done = foldback(*command)
        assert done.returncode == 0, done.stderr
        assert ("usually get stuck on a table" in done.stderr) == warned


def write_plan(directory: Path, modules: int = 6) -> Path:
    """Write the plan of a straight chain that turns one hinge, and return its path."""
    chain = line(modules)
    unverified(chain, swing(chain, 1, -0.3), Parameters()).save_npz(directory / "plan.npz")
    return directory / "plan.npz"


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return write_plan(tmp_path).parent


def test_plan_that_rests_on_a_table_is_certified(plan: Path) -> None:
    done = foldback("table", plan, "--module-kg", "0.1", "--pitch-mm", "50", "--bound", "12")
    assert done.returncode == 0, done.stderr
    assert "stays on the table" in done.stdout
    assert "without friction" in done.stdout
    table_certificate = TableCertificate.from_dict(json.loads((plan / "table.json").read_text()))
    assert table_certificate.rests
    assert table_certificate.torque == pytest.approx(10.0 * np.cos(0.3 / 4), rel=1e-3)
    assert table_certificate.unit_nm == pytest.approx(0.1 * 9.81 * 0.05)


def test_plan_that_does_not_rest_exits_with_3(plan: Path) -> None:
    out = plan / "mine.json"
    data = foldback_json("table", plan / "plan.npz", "--base", "free", "--out", out, status=3)
    assert data["verdict"].startswith("failed: the chain would tip over")
    assert json.loads(out.read_text()) == data
