"""Playback on a table: loads that limited motors can or cannot hold, and a box that folds there."""

from dataclasses import replace

import numpy as np
import pytest

from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.table.table_explosion import explode_on_table
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.explosion import TableParameters
from foldback.planner.parameters.playback import TablePlaybackParameters
from foldback.planner.playback.table_playback import TablePlayback, play_on_table
from tests.case import case
from tests.planner.chains import anchored, chain_of
from tests.planner.table_replay import table_replay
from tests.planner.table_search import table_paths
from tests.refusal import refused

ARM = 15.0
"""Torque of a cantilever of five modules, w·p."""
SLOW = replace(TablePlaybackParameters(), fastest=0.02)
BOX = np.array([(x, y, z) for x in range(2) for y in range(2) for z in range(2)])


def move_between(chain: Chain, angles: np.ndarray) -> Motion:
    """Return straight lines between configurations, with module 0 fixed in its folded pose."""
    steps = [np.linspace(a, b, 40) for a, b in zip(angles, angles[1:], strict=False)]
    frames = anchored("explosion", np.concatenate(steps)).windowed(chain)
    return frames.with_columns(
        base_position=np.tile(chain.folded_position, (len(frames), 1)),
        base_wxyz=np.tile(chain.folded_wxyz, (len(frames), 1)),
    )


@pytest.fixture(scope="module")
def arm() -> tuple[Chain, Motion]:
    """Row clamped three pitches above the table, which folds a leg down to it."""
    cells = [(0, 0, 3), (1, 0, 3), (2, 0, 3), (3, 0, 3), (3, 0, 2), (3, 0, 1), (3, 0, 0)]
    chain = chain_of(cells)
    return chain, move_between(chain, np.array([chain.folded_rad, np.zeros(len(chain.folded_rad))]))


def rms(table_playback: TablePlayback) -> float:
    return float(np.sqrt((table_playback.position_errors**2).mean()))


def play_arm(arm: tuple[Chain, Motion], share: float) -> TablePlayback:
    return play_on_table(*arm, torque_limit_wp=share * ARM, parameters=SLOW)


def test_motors_a_little_stronger_than_the_weight_hold_an_arm(arm: tuple[Chain, Motion]) -> None:
    table_playback = play_arm(arm, 1.5)
    assert table_playback.status == "folded", table_playback.reason
    assert rms(table_playback) < 0.02
    assert table_playback.largest_torque <= 1.5 * ARM * (1.0 + 1e-9)
    # At the start of the motion, the loaded hinge needs the static torque of the weight.
    assert table_playback.torques[1].max() == pytest.approx(ARM, rel=0.05)


def test_arm_falls_with_weak_motors(arm: tuple[Chain, Motion]) -> None:
    table_playback = play_arm(arm, 0.8)
    assert table_playback.status == "missed"
    assert "is too weak: " in str(table_playback.reason)
    assert f"{0.8 * ARM:.3g} w·p" in str(table_playback.reason)


def test_table_replay_drops_an_arm_below_its_torque(arm: tuple[Chain, Motion]) -> None:
    chain, record = arm
    held_playback = table_replay(chain, record[-1:], torque=ARM)
    assert held_playback.holds, held_playback
    dropped = table_replay(chain, record[-1:], torque=ARM, spare=0.8)
    assert not dropped.holds
    assert dropped.drifts[0] > 0.5


@pytest.fixture(scope="module")
def row() -> tuple[Chain, Motion]:
    """Modules that lie flat, three of which are swung over the table."""
    chain = chain_of([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 2, 0), (1, 3, 0)])
    return chain, move_between(chain, np.array([chain.folded_rad, np.zeros(6)]))


def test_friction_needs_torque(row: tuple[Chain, Motion]) -> None:
    """Without friction the torque is nearly zero."""
    chain, record = row
    smooth, rough = (
        play_on_table(chain, record, torque_limit_wp=8.0, friction=mu, parameters=SLOW)
        for mu in (0.0, 0.3)
    )
    assert smooth.status == rough.status == "folded"
    drag = 0.3 * (1 + 2 + 3)
    middle = slice(len(smooth.torques) // 3, 2 * len(smooth.torques) // 3)
    turning = slice(0, None, 2)  # hinges with a vertical axis
    assert np.median(smooth.torques[middle, turning].max(axis=1)) < 0.1 * drag
    assert np.median(rough.torques[middle, turning].max(axis=1)) > 0.9 * drag


def test_chain_with_a_free_base_drifts(row: tuple[Chain, Motion]) -> None:
    chain, record = row
    held_playback, free = (
        play_on_table(
            chain, record, torque_limit_wp=8.0, friction=0.3, clamped=clamped, parameters=SLOW
        )
        for clamped in (True, False)
    )
    assert held_playback.status == free.status == "folded"
    for playback, fixed in ((held_playback, True), (free, False)):
        frames = playback.frames
        poses = chain.poses(frames.joint_angles_rad, frames.root_position, frames.root_wxyz)
        base_travel = np.linalg.norm(poses.positions[:, 0] - chain.folded_position, axis=1).max()
        assert (base_travel < 1e-6) if fixed else (base_travel > 0.1)
        turned = np.abs(poses.rotations[:, 0] - poses.rotations[0, 0]).max()
        assert (turned < 1e-6) if fixed else (turned > 0.3)
    # The free chain ends elsewhere, but in the planned shape.
    assert free.position_errors.max() < 0.05
    assert free.position_errors[-1] < 0.005


def test_box_folds_on_the_table_with_half_as_much_torque_again() -> None:
    chain = chain_of(table_paths(BOX, max_paths=1)[0].cells)
    record = explode_on_table(chain, TableParameters(), seed=0)
    assert record.status == "straight", record.reason
    assert record.frames.is_windowed
    needed = table_certificate(
        chain, record.frames[::-1], on_table=True, height=chain.table_height
    ).torque
    assert needed is not None
    table_playback = play_on_table(chain, record.frames, torque_limit_wp=1.5 * max(needed, 1.0))
    assert table_playback.status == "folded", table_playback.reason
    assert rms(table_playback) < 0.05
    assert table_playback.position_errors[-1] < 0.05
    np.testing.assert_allclose(table_playback.frames.joint_angles_rad[0], 0.0, atol=1e-6)
    assert np.abs(table_playback.frames.joint_angles_rad[-1] - chain.folded_rad).max() < 0.05
    error = np.abs(table_playback.frames.joint_angles_rad - table_playback.reference_rad)
    np.testing.assert_allclose(table_playback.frames.joint_error_rad, error, atol=1e-6)

    rests = table_replay(chain, table_playback.frames, torque=max(needed, 1.0), count=4)
    assert rests.holds, rests


def test_playback_on_a_table_out_of_range_is_refused(arm: tuple[Chain, Motion]) -> None:
    for limit, friction in ((0.0, 0.0), (1.0, 3.0)):
        with case((limit, friction)), refused("bad-table"):
            play_on_table(*arm, torque_limit_wp=limit, friction=friction)
    with refused("no-record"):
        play_on_table(arm[0], arm[1][:1], torque_limit_wp=1.0)
