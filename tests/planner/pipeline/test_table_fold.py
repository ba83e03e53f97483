"""Folds on a table, from cells to a plan that is simulated and certified to rest there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from examples.run_gallery import SHAPES
from planner.certificate.table_forces import TableForces
from planner.errors import InputError
from planner.motion.frames import Frames
from planner.pipeline.fold_directory import write_request
from planner.pipeline.prepare import prepare
from planner.pipeline.request import Request
from planner.pipeline.stages import LEAST_TORQUE_WP, STRONGER_MOTORS, run_stages
from planner.plan.plan import Plan
from planner.simulation.parameters import Parameters
from planner.verification.verify import verify

CELLS = [[x, y, z] for z in range(2) for y in range(2) for x in range(3)]
ON_TABLE = Request(world="table", as_voxels=True)


def test_a_box_folds_on_a_table_within_what_its_certificate_says(tmp_path: Path) -> None:
    write_request(tmp_path, ON_TABLE, json.dumps(CELLS).encode())
    run_stages(tmp_path)
    plan = Plan.load(tmp_path / "plan.json")
    table = plan.certificate.table
    assert plan.certificate.verdict.startswith("verified (simulated)"), plan.certificate.verdict
    assert table is not None
    assert table.rests
    assert table.on_table
    assert table.torque is not None
    assert table.torque <= Parameters().table.most_torque
    assert len(table.torques) == len(plan.motion)
    assert plan.certificate.peak_torque_nm is not None
    # Motors are limited by what the record asks, which the plan's curve leaves by a little.
    allowed = 1.05 * STRONGER_MOTORS * max(table.torque, LEAST_TORQUE_WP)
    assert plan.certificate.peak_torque_nm <= allowed * table.unit_nm
    assert any("rictionless" in words for words in table.assumptions)
    assert len(TableForces.load(tmp_path / "table.npz")) == len(plan.motion)
    assert verify(tmp_path).verified, verify(tmp_path).problems
    forged = replace(plan.certificate, table=replace(table, torque=0.5 * table.torque))
    replace(plan, certificate=forged).save_npz(tmp_path / "plan.npz")
    assert "certificate.table" in " ".join(verify(tmp_path).problems)
    assert isinstance(plan.motion, Frames)
    assert plan.playback is not None
    lifted = replace(plan.motion, root_position=plan.motion.root_position + [0.0, 0.0, 0.01])
    replace(plan, motion=lifted).save_npz(tmp_path / "plan.npz")
    assert "whose first module is clamped" in " ".join(verify(tmp_path).problems)
    hurried = {**plan.playback, "steps": plan.playback["steps"] // 2}
    replace(plan, playback=hurried).save_npz(tmp_path / "plan.npz")
    assert "playback.steps" in " ".join(verify(tmp_path).problems)


def test_what_lies_flat_is_verified_again_from_its_files(tmp_path: Path) -> None:
    """Its hinges turn by less than they are folded by from the moment in which they are free."""
    cells = [[x, y, 0] for x in range(3) for y in range(3)]
    write_request(tmp_path, ON_TABLE, json.dumps(cells).encode())
    run_stages(tmp_path)
    assert verify(tmp_path).verified, verify(tmp_path).problems


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (Request(world="moon"), "unknown-world"),  # pyright: ignore[reportArgumentType]
        (Request(world="table", preset="paper"), "unsuited-world"),
        (Request(world="table", module="tetrahedron"), "unsuited-world"),
        (Request(world="table", strategy="blocks"), "unsuited-world"),
        (Request(world="table", refold=True), "unsuited-world"),
        (Request(settings="table_torque=4"), "bad-settings"),
    ],
)
def test_what_a_table_cannot_have_is_refused(request_: Request, code: str) -> None:
    with pytest.raises(InputError) as error:
        request_.check()
    assert error.value.code == code


def test_settings_of_the_table_reach_the_explosion() -> None:
    asked = Request(world="table", settings="table_torque=4,table_friction=0.1")
    assert asked.parameters().table.most_torque == 4.0
    assert asked.parameters().table.friction == 0.1


def test_a_shape_without_a_path_for_a_table_is_told_why() -> None:
    shape = (SHAPES / "wrench-24.json").read_bytes()
    made = prepare(shape, "wrench-24.json", ON_TABLE.path_options())
    with pytest.raises(InputError, match="hairpin"):
        _ = made.chain


def test_a_path_that_goes_down_is_refused() -> None:
    path = [[0, 0, 1], [1, 0, 1], [2, 0, 1], [2, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]]
    with pytest.raises(InputError) as error:
        prepare(json.dumps(path).encode(), None, Request(world="table").path_options())
    assert error.value.code == "not-for-a-table"
