"""Explosions on a table: recorded frames are stable within the bound, refusals are reported."""

from dataclasses import replace
from itertools import product
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.loop.recorder import Refusal
from foldback.planner.explosion.peeling.window import Peelable, WindowConfiguration
from foldback.planner.explosion.table.guard import MAX_TABLE_PENETRATION_PITCH, Guard
from foldback.planner.explosion.table.table_explosion import explode_on_table
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import TableParameters
from tests.planner.chains import chain_of, line
from tests.planner.table_search import table_paths

BOX = np.array([(x, y, z) for x in range(2) for y in range(2) for z in range(2)])


def on_table(cells: np.ndarray) -> Chain:
    return chain_of(table_paths(cells, max_paths=1)[0].cells)


@pytest.fixture(scope="module")
def record() -> Record:
    return explode_on_table(on_table(BOX), TableParameters(), seed=0)


def test_box_becomes_straight_within_the_torque_bound(record: Record, tmp_path: FilePath) -> None:
    assert record.status == "straight", record.reason
    assert record.frames.is_windowed
    chain = on_table(BOX)
    certificate = table_certificate(
        chain, record.frames, base="free", on_table=True, height=chain.table_height
    )
    assert not certificate.unbalanced
    assert certificate.torque <= record.table.bound * 1.001
    assert certificate.clearance >= -MAX_TABLE_PENETRATION_PITCH - 1e-3
    assert np.abs(record.frames.angles(chain)[-1]).max() < 1e-6
    assert np.allclose(record.frames.angles(chain)[0], chain.folded_rad, atol=1e-6)
    record.save(tmp_path / "record.npz")
    assert Record.load(tmp_path / "record.npz").table == record.table


def test_steps_beyond_the_largest_torque_are_taken_back() -> None:
    weak = replace(TableParameters(), first_bound=0.2, table_torque=0.3)
    record = explode_on_table(on_table(BOX), weak)
    assert record.status == "stalled"
    assert "0.30 w·p" in str(record.reason)
    assert record.table.bound == pytest.approx(0.3)
    assert record.table.taken_back > weak.refusals
    assert [bound for _, bound in record.table.raised][:2] == pytest.approx([0.23, 0.2645])


def test_chain_that_cannot_even_stand_fails_with_a_reason_and_its_folded_frame() -> None:
    """The long arm needs more torque than the bound, so the guard refuses every frame."""
    chain = chain_of([(0, 0, 0), (1, 0, 0), *((x, 0, 1) for x in range(1, 8)), (7, 1, 1)])
    parts: list[Motion] = []
    weak = replace(TableParameters(), first_bound=0.3, table_torque=0.3)
    record = explode_on_table(chain, weak, sink=parts.append)
    assert record.status == "stalled"
    assert "0.30 w·p" in str(record.reason)
    (only_part,) = parts
    for frames in (record.frames, only_part):
        assert np.allclose(frames.angles(chain), [chain.folded_rad], atol=1e-6)


def test_module_bent_into_the_table_is_refused_and_raises_no_bound() -> None:
    chain = on_table(BOX)
    parameters = replace(TableParameters(), refusals=0)
    guard = Guard(chain, Peelable(chain), parameters)
    flat = WindowConfiguration(time_s=0.0, first=0, angles=np.zeros_like(chain.folded_rad))
    assert guard.refusal(None, [flat]) is None
    refusals: list[Refusal | None] = []
    for hinge, angle in product((-2, -1), (-0.1, 0.1)):
        bent = flat.angles.copy()
        bent[hinge] = angle
        refusals.append(guard.refusal(None, [replace(flat, angles=bent)]))
    (refusal,) = filter(None, refusals)
    assert "into the table" in refusal.reason
    for _ in range(3):
        guard.count(refusal, 0.0)
        assert not guard.is_exhausted
    assert (guard.taken_back, guard.bound) == (3, parameters.first_bound)


def test_refusal_of_a_loop_raises_no_bound() -> None:
    row = line(24)
    guard = Guard(row, Peelable(row), replace(TableParameters(), refusals=0))
    refusal = None
    for sides, reason_words in ((6, ""), (13, "cross over itself")):
        turns = np.zeros((row.joint_count, 2))
        turns[4 : 4 + sides, 0] = 2.0 * np.pi / 12  # about the vertical
        bend = WindowConfiguration(time_s=0.0, first=0, angles=turns.ravel())
        assert guard.loops(bend) == bool(reason_words)
        refusal = guard.refusal(None, [bend])
        assert (refusal is not None) == bool(reason_words)
        assert refusal is None or reason_words in refusal.reason
    assert refusal is not None
    for _ in range(3):
        guard.count(refusal, 0.0)
        assert not guard.is_exhausted
    assert guard.bound == TableParameters().first_bound
