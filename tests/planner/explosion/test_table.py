"""Explosions on a table: every frame that is kept stands within the bound; what is not is told."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path as FilePath

import numpy as np
import pytest

from planner.certificate.table import table_certificate
from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.path import Path
from planner.errors import InputError
from planner.explosion.strategies import strategies_for
from planner.explosion.table import explode_on_table
from planner.explosion.table_guard import MAX_TABLE_PENETRATION_PITCH, Guard
from planner.explosion.window import Peelable, WindowConfiguration
from planner.motion.record import Record
from planner.parameters.explosion import TableParameters
from planner.parameters.parameters import Parameters
from tests.planner.table_search import table_paths

BOX = np.array([(x, y, z) for x in range(3) for y in range(2) for z in range(2)])


def chain_of(cells: np.ndarray) -> Chain:
    return Chain.from_path(Path.from_cells(table_paths(cells, most=1)[0].cells, name="box"))


@pytest.fixture(scope="module")
def record() -> Record:
    return explode_on_table(chain_of(BOX), TableParameters(), seed=1)


def test_box_becomes_straight_within_the_torque_bound(record: Record, tmp_path: FilePath) -> None:
    assert record.status == "straight", record.reason
    assert record.frames.is_windowed
    chain = chain_of(BOX)
    found = table_certificate(
        chain, record.frames, base="free", on_table=True, height=chain.table_height
    )
    assert not found.unbalanced
    assert found.torque <= record.table.bound * 1.001
    assert found.clearance >= -MAX_TABLE_PENETRATION_PITCH - 1e-3
    assert np.abs(record.frames.angles(chain)[-1]).max() < 1e-6
    assert np.allclose(record.frames.angles(chain)[0], chain.folded_rad, atol=1e-6)
    record.save(tmp_path / "record.npz")
    assert Record.load(tmp_path / "record.npz").table == record.table


def test_steps_beyond_the_largest_torque_are_taken_back() -> None:
    weak = replace(TableParameters(), first_bound=0.2, most_torque=0.3)
    found = explode_on_table(chain_of(BOX), weak)
    assert found.status == "stalled"
    assert "0.30 w·p" in found.reason
    assert found.table.bound == pytest.approx(0.3)
    assert found.table.taken_back > weak.refusals
    assert [bound for _, bound in found.table.raised][:2] == pytest.approx([0.23, 0.2645])


def test_module_bent_into_the_table_is_refused() -> None:
    chain = chain_of(BOX)
    guard = Guard(chain, Peelable(chain), TableParameters())
    straight = np.zeros_like(chain.folded_rad)
    flat = WindowConfiguration(time_s=0.0, first=0, angles=straight)
    assert guard.refusal(None, [flat]) is None
    whys: list[str] = []
    for hinge in (-2, -1):
        for angle in (-0.1, 0.1):
            bent = straight.copy()
            bent[hinge] = angle
            refusal = guard.refusal(None, [replace(flat, angles=bent)])
            whys.append("" if refusal is None else refusal.reason)
    assert sorted(bool(why) for why in whys) == [False, False, False, True]
    assert any("into the table" in why for why in whys)


def test_refusal_by_the_table_raises_no_bound() -> None:
    chain = chain_of(BOX)
    parameters = replace(TableParameters(), refusals=0)
    guard = Guard(chain, Peelable(chain), parameters)
    refusals = []
    for hinge, turn in product((0, 1), (0.3, -0.3)):
        angles = chain.folded_rad.copy()
        angles[hinge] += turn
        refusals.append(guard.refusal(None, [WindowConfiguration(0.0, 0, angles)]))
    refusal = next(each for each in refusals if each and "into the table" in each.reason)
    for _ in range(3):
        guard.count(refusal, 0.0)
        assert guard.exhausted_by is None
    assert (guard.taken_back, guard.bound) == (3, parameters.first_bound)


def test_refusal_of_a_loop_raises_no_bound() -> None:
    row = Chain.from_path(Path.from_cells([(x, 0, 0) for x in range(24)], name="row"))
    guard = Guard(row, Peelable(row), replace(TableParameters(), refusals=0))
    refusal = None
    for sides, why in ((6, ""), (13, "across itself")):
        turns = np.zeros((row.joint_count, 2))
        turns[4 : 4 + sides, _hinge_about_the_vertical(row)] = 2.0 * np.pi / 12
        bend = WindowConfiguration(time_s=0.0, first=0, angles=turns.ravel())
        assert guard.loops(bend) == bool(why)
        refusal = guard.refusal(None, [bend])
        assert (refusal is not None) == bool(why)
        assert refusal is None or why in refusal.reason
    assert refusal is not None
    for _ in range(3):
        guard.count(refusal, 0.0)
        assert guard.exhausted_by is None
    assert guard.bound == TableParameters().first_bound


def _hinge_about_the_vertical(row: Chain) -> int:
    """Which of a joint's two hinges turns a chain that lies flat on the table."""
    for hinge in range(2):
        angles = np.zeros_like(row.folded_rad)
        angles[hinge] = 0.5
        poses = forward_kinematics(row.module, angles, root_wxyz=row.folded_wxyz)
        if np.ptp(poses.positions[:, 2]) < 1e-6:
            return hinge
    raise AssertionError("no hinge turns about the vertical")


def test_chain_off_the_lattice_is_refused_on_a_table() -> None:
    bent = Chain.from_angles(chain_of(BOX).module, np.full(8, 0.3))
    with pytest.raises(InputError, match="cubes") as error:
        strategies_for(bent, replace(Parameters(), world="table"))
    assert error.value.code == "unsuited-world"
