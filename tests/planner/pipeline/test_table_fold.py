"""Folds on a table, from cells to a plan that is simulated and certified to rest there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from examples.run_gallery import SHAPES
from planner.certificate.table_forces import TableForces
from planner.errors import InputError
from planner.parameters.parameters import Parameters
from planner.pipeline.playing_back import MIN_SIZING_TORQUE_WP, TABLE_MOTOR_RESERVE
from planner.pipeline.prepare import prepare
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.verification.own_parameters import own_parameters
from planner.verification.verify import verify

CELLS = [[x, y, z] for z in range(2) for y in range(2) for x in range(2)]
ON_TABLE = FoldRequest(world="table", as_voxels=True)
RUBBING = "table_friction=0.1"


def test_a_box_folds_on_a_table_within_what_its_certificate_says(tmp_path: Path) -> None:
    Workspace(tmp_path).write_request(ON_TABLE, json.dumps(CELLS).encode())
    run_stages(tmp_path)
    plan = Plan.load(tmp_path / "plan.json")
    table = plan.certificate.table
    assert plan.certificate.verdict.startswith("verified (simulated)"), plan.certificate.verdict
    assert table.rests
    assert table.on_table
    assert table.torque <= Parameters().table.most_torque
    assert len(table.torques) == len(plan.motion)
    # Motors are limited by what the record asks, which the plan's curve leaves by a little.
    allowed = 1.05 * TABLE_MOTOR_RESERVE * max(table.torque, MIN_SIZING_TORQUE_WP)
    assert plan.certificate.peak_torque_nm <= allowed * table.unit_nm
    assert any("No friction" in words for words in table.assumptions)
    assert len(TableForces.load(tmp_path / "table.npz")) == len(plan.motion)
    assert verify(tmp_path).verified, verify(tmp_path).problems
    reworded = replace(plan.certificate, table=replace(table, assumptions=("No friction.",)))
    replace(plan, certificate=reworded).save_npz(tmp_path / "plan.npz")
    assert "plan.npz certificate" not in " ".join(verify(tmp_path).problems)
    forged = replace(plan.certificate, table=replace(table, torque=0.5 * table.torque))
    replace(plan, certificate=forged).save_npz(tmp_path / "plan.npz")
    assert "plan.npz certificate.table" in " ".join(verify(tmp_path).problems)
    assert not plan.motion.is_windowed
    lifted = plan.motion.with_columns(root_position=plan.motion.root_position + [0.0, 0.0, 0.01])
    replace(plan, motion=lifted).save_npz(tmp_path / "plan.npz")
    assert "whose first module is clamped" in " ".join(verify(tmp_path).problems)
    hurried = {**plan.playback, "steps": plan.playback["steps"] // 2}
    replace(plan, playback=hurried).save_npz(tmp_path / "plan.npz")
    assert "playback.steps" in " ".join(verify(tmp_path).problems)


@pytest.mark.long
def test_with_friction_a_chain_lies_free_and_its_plan_drifts_as_it_does(tmp_path: Path) -> None:
    Workspace(tmp_path).write_request(
        replace(ON_TABLE, settings=RUBBING), json.dumps(CELLS).encode()
    )
    run_stages(tmp_path)
    plan = Plan.load(tmp_path / "plan.npz")
    table, motion = plan.certificate.table, plan.motion
    assert plan.certificate.verdict.startswith("verified (simulated)"), plan.certificate.verdict
    assert (table.base, table.friction) == ("free", 0.1)
    assert "friction 0.1, free base" in table.verdict
    assert not motion.is_windowed
    held = motion.clamped(plan.chain)
    assert np.abs(motion.root_position - held.root_position).max() > 0.05
    assert verify(tmp_path).verified, verify(tmp_path).problems

    def refused(**changed: Any) -> str:
        replace(plan, **changed).save_npz(tmp_path / "plan.npz")
        return " ".join(verify(tmp_path).problems)

    table_parameters = {**plan.parameters["table"], "base": "clamped"}
    told = refused(parameters={**plan.parameters, "table": table_parameters})
    assert "plan.npz root_position of a chain whose first module is clamped" in told
    assert "timeline.zarr root_position of a chain whose first module is clamped" in told
    assert "that drifts like the playback" in refused(motion=held)
    lifted = motion.with_columns(root_position=motion.root_position + [0.0, 0.0, 0.01])
    assert "that drifts like the playback" in refused(motion=lifted)


@pytest.mark.parametrize(
    ("told", "base", "held"),
    [
        ({"friction": 0.1}, "clamped", True),  # as before there was a choice
        ({"friction": 0.0, "clamped": True}, "free", True),
        ({"friction": 0.1, "base": "free"}, "free", False),
        ({"friction": 0.0, "base": "clamped"}, "clamped", True),
    ],
)
def test_how_a_plan_was_held_is_read_from_its_parameters(
    told: dict[str, object], base: str, held: bool
) -> None:
    table = own_parameters(plan_told(told), None).table
    assert (table.base, table.held) == (base, held)


def test_a_plan_that_is_held_in_no_known_way_is_refused() -> None:
    with pytest.raises(InputError, match=r"'held' in parameters\.table\.base"):
        own_parameters(plan_told({"friction": 0.1, "base": "held"}), None)


def plan_told(table: dict[str, object]) -> Plan:
    """What is read of a plan's parameters."""
    parameters = {"world": "table", "table": table}
    return cast("Plan", SimpleNamespace(parameters=parameters, preset="default"))


def test_what_lies_flat_is_verified_again_from_its_files(tmp_path: Path) -> None:
    """Its hinges turn by less than they are folded by from the moment in which they are free."""
    cells = [[x, y, 0] for x in range(3) for y in range(3)]
    Workspace(tmp_path).write_request(ON_TABLE, json.dumps(cells).encode())
    run_stages(tmp_path)
    assert verify(tmp_path).verified, verify(tmp_path).problems


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (FoldRequest(world="moon"), "unknown-world"),  # pyright: ignore[reportArgumentType]
        (FoldRequest(world="table", preset="paper"), "unsuited-world"),
        (FoldRequest(world="table", module="tetrahedron"), "unsuited-world"),
        (FoldRequest(world="table", strategy="blocks"), "unsuited-world"),
        (FoldRequest(world="table", refold=True), "unsuited-world"),
        (FoldRequest(settings="table_torque=4"), "bad-settings"),
        (FoldRequest(settings="table_base=free"), "bad-settings"),
    ],
)
def test_what_a_table_cannot_have_is_refused(request_: FoldRequest, code: str) -> None:
    with pytest.raises(InputError) as error:
        request_.check()
    assert error.value.code == code


def test_settings_of_the_table_reach_the_explosion() -> None:
    asked = FoldRequest(
        world="table", settings="table_torque=4, table_friction=0.1, table_base=clamped"
    )
    table = asked.parameters().table
    assert (table.most_torque, table.friction, table.base) == (4.0, 0.1, "clamped")
    assert FoldRequest(world="table", settings=RUBBING).parameters().table.base == "free"
    same = replace(asked, settings="table_base=free").canonical()
    assert same == FoldRequest(world="table")


def test_a_shape_without_a_path_for_a_table_is_told_why() -> None:
    shape = (SHAPES / "wrench-24.json").read_bytes()
    made = prepare(shape, "wrench-24.json", ON_TABLE.path_options())
    with pytest.raises(InputError, match="turns back directly above itself"):
        _ = made.chain


def test_a_path_that_goes_down_is_refused() -> None:
    path = [[0, 0, 1], [1, 0, 1], [2, 0, 1], [2, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]]
    with pytest.raises(InputError) as error:
        prepare(json.dumps(path).encode(), None, FoldRequest(world="table").path_options())
    assert error.value.code == "not-for-a-table"
