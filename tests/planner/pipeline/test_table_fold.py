"""Folds on a table: from cells to a plan that is simulated and certified to be stable there."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.errors import InputError
from foldback.planner.parameters.explosion import TableParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.playing_back import MIN_SIZING_TORQUE_WP, TABLE_MOTOR_RESERVE
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.plan import Plan
from foldback.planner.verification.plan_parameters import plan_parameters
from foldback.planner.verification.verify import verify
from tests.planner.conftest import SHAPES
from tests.planner.folds import run_fold
from tests.refusal import refused

CELLS = json.dumps([[x, y, z] for z in range(2) for y in range(2) for x in range(2)]).encode()
FRICTION = "table_friction=0.1"


def problems(directory: Path, plan: Plan, **changed: Any) -> str:
    """Return the problems that a verification finds in a changed plan."""
    replace(plan, **changed).save_npz(directory / "plan.npz")
    return " ".join(verify(directory).problems)


def test_box_folds_on_a_table_within_the_torques_of_its_certificate(tmp_path: Path) -> None:
    plan = run_fold(tmp_path, CELLS, world="table", as_voxels=True)
    table, motion = plan.certificate.table, plan.motion
    assert plan.certificate.verified and plan.certificate.simulated, plan.certificate.verdict
    assert table.rests
    assert table.on_table
    assert table.torque <= Parameters().table.table_torque
    assert len(table.torques) == len(motion)
    # The record's torque limits the motors; the plan's curve exceeds it slightly.
    allowed = 1.05 * TABLE_MOTOR_RESERVE * max(table.torque, MIN_SIZING_TORQUE_WP)
    assert plan.certificate.peak_torque_nm <= allowed * table.unit_nm
    assert any("No friction" in words for words in table.assumptions)
    assert len(TableForces.load(tmp_path / "table.npz")) == len(motion)
    assert verify(tmp_path).verified, verify(tmp_path).problems
    reworded = replace(plan.certificate, table=replace(table, assumptions=("No friction.",)))
    assert "plan.npz certificate" not in problems(tmp_path, plan, certificate=reworded)
    forged = replace(plan.certificate, table=replace(table, torque=0.5 * table.torque))
    hurried = {**plan.playback, "steps": plan.playback["steps"] // 2}
    computed_problems = problems(tmp_path, plan, certificate=forged, playback=hurried)
    assert (
        "plan.npz certificate.table" in computed_problems and "playback.steps" in computed_problems
    )
    assert not motion.is_windowed
    lifted = motion.with_columns(root_position=motion.root_position + [0.0, 0.0, 0.01])
    assert "whose first module is clamped" in problems(tmp_path, plan, motion=lifted)


@pytest.mark.long
def test_plan_with_friction_has_a_free_base_and_its_drift(tmp_path: Path) -> None:
    plan = run_fold(tmp_path, CELLS, world="table", as_voxels=True, settings=FRICTION)
    table, motion = plan.certificate.table, plan.motion
    assert plan.certificate.verified and plan.certificate.simulated, plan.certificate.verdict
    assert (table.base, table.friction) == ("free", 0.1)
    assert "friction μ = 0.1 and no clamped module" in table.verdict
    assert not motion.is_windowed
    clamped_motion = motion.clamped(plan.chain)
    assert np.abs(motion.root_position - clamped_motion.root_position).max() > 0.05
    assert verify(tmp_path).verified, verify(tmp_path).problems
    table_parameters = {**plan.parameters["table"], "table_base": "clamped"}
    text = problems(tmp_path, plan, parameters={**plan.parameters, "table": table_parameters})
    assert "a chain whose first module is clamped: plan.npz root_position" in text
    assert "a chain whose first module is clamped: timeline root_position" in text
    lifted = motion.with_columns(root_position=motion.root_position + [0.0, 0.0, 0.01])
    for motion_part in (clamped_motion, lifted):
        assert "that drifts like the playback" in problems(tmp_path, plan, motion=motion_part)


def test_base_of_a_plan_is_read_from_its_parameters() -> None:
    def table_of(table: dict[str, object]) -> TableParameters:
        data = SimpleNamespace(parameters={"world": "table", "table": table}, preset="default")
        return plan_parameters(cast("Plan", data), None).table

    for data, base, is_fixed in (
        ({"table_friction": 0.1}, "free", False),  # what is absent has its default
        ({"table_friction": 0.0}, "free", True),
        ({"table_friction": 0.1, "table_base": "free"}, "free", False),
        ({"table_friction": 0.0, "table_base": "clamped"}, "clamped", True),
    ):
        assert (table_of(data).table_base, table_of(data).held) == (base, is_fixed), data
    with pytest.raises(InputError, match=r"'held' in parameters\.table\.table_base"):
        table_of({"table_friction": 0.1, "table_base": "held"})


def test_flat_shape_on_a_table_is_verified_from_its_files(tmp_path: Path) -> None:
    """Free hinges of this shape rotate by less than their folded angles."""
    cells = [[x, y, 0] for y in range(3) for x in range(2)]
    run_fold(tmp_path, json.dumps(cells).encode(), world="table", as_voxels=True)
    assert verify(tmp_path).verified, verify(tmp_path).problems


def test_settings_of_a_table_are_its_parameters() -> None:
    request = FoldRequest(
        world="table", settings="table_torque=4, table_friction=0.1, table_base=clamped"
    )
    table = request.parameters().table
    assert (table.table_torque, table.table_friction, table.table_base) == (4.0, 0.1, "clamped")
    assert FoldRequest(world="table", settings=FRICTION).parameters().table.table_base == "free"
    same_fold_request = replace(request, settings="table_base=free").canonical()
    assert same_fold_request == FoldRequest(world="table")


def test_shape_without_a_path_for_a_table_is_refused_with_the_reason() -> None:
    shape = (SHAPES / "wrench-24.json").read_bytes()
    options = FoldRequest(world="table", as_voxels=True).path_options()
    with pytest.raises(InputError, match="cannot turn back directly above itself"):
        _ = prepare(shape, "wrench-24.json", options).chain
    path = [[0, 0, 1], [1, 0, 1], [2, 0, 1], [2, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]]
    with refused("not-for-a-table"):
        prepare(json.dumps(path).encode(), None, FoldRequest(world="table").path_options())
