"""Straightening: the end of an explosion by pure kinematics, all angles shrinking together."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.clearance.clearance import closest
from foldback.planner.clearance.sweep import sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.simulation.reduced_state import State

STRAIGHTENING_CLEARANCE_PITCH: Final = 0.02
"""Minimum clearance, pitches, while all angles of a nearly straight chain shrink to 0 without
simulation; half of the straight chain's own clearance if that is less."""
KINEMATIC_FRAME_S: Final = 0.1
"""Time between two frames, s, while angles shrink to 0 without simulation. It only sets the times
of these frames."""
STRAIGHTENING_CHUNK_FRAMES: Final = 128
"""Maximum number of frames whose module positions are computed at once while a chain is
straightened without simulation."""


def straightening(
    chain: Chain,
    state: State,
    *,
    start_s: float,
    snapshot_rad: float,
    snapshot_distance: float,
    module_size: float,
) -> Motion | None:
    """Return frames from a nearly straight state to the straight one, q·s with s from 1 to 0.

    The root keeps its orientation and the centre of mass keeps its position.

    Returns:
        The frames after the given state, or None if modules would come too close on the way.
    """
    angles = state.angles
    for scale in np.linspace(1.0, 0.0, 24, endpoint=False):
        # What touches soon is found before the way is divided into frames.
        if _clearance(chain, scale * angles, module_size, STRAIGHTENING_CLEARANCE_PITCH) < 0.0:
            return None
    turned = np.abs(angles).max() / snapshot_rad
    count = int(np.ceil(max(turned, 1.0)))
    while True:
        moved = _moved(chain, state, np.linspace(1.0, 0.0, count + 1)) / snapshot_distance
        if moved.max() <= 1.0:
            break
        count = int(np.ceil(1.05 * count * moved.max()))
    # A long chain does not straighten evenly: its ends move most at first.
    passed = np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned / count))])
    even = np.linspace(0.0, passed[-1], max(1, int(np.ceil(1.01 * passed[-1]))) + 1)
    scales = np.interp(even, passed, np.linspace(1.0, 0.0, count + 1))[1:]
    scales[-1] = 0.0
    count = len(scales)
    way = scales[:, None] * angles
    min_clearance = min(
        STRAIGHTENING_CLEARANCE_PITCH,
        0.5 * _clearance(chain, way[-1], module_size, 2.0 * STRAIGHTENING_CLEARANCE_PITCH),
    )
    for row in way[::4]:  # before all is proved
        if _clearance(chain, row, module_size, min_clearance) < min_clearance:
            return None
    swept = sweep(chain, np.concatenate([angles[None], way]), module_size=module_size)
    if swept.clearance < min_clearance or swept.bound <= 0.0:
        return None
    centre = _centres(chain, state, angles[None])[0].mean(axis=0)
    offsets = np.concatenate(
        [
            _centres(chain, state, way[start : start + STRAIGHTENING_CHUNK_FRAMES]).mean(axis=1)
            for start in range(0, count, STRAIGHTENING_CHUNK_FRAMES)
        ]
    )
    return Motion.from_frames(
        phase="explosion",
        time_s=start_s + KINEMATIC_FRAME_S * np.arange(1.0, count + 1.0),
        joint_angles_rad=way,
        root_position=state.position + centre - offsets,
        root_wxyz=np.broadcast_to(wxyz_from_matrix(state.rotation), (count, 4)).copy(),
    )


def _clearance(chain: Chain, angles: Array, module_size: float, enough: float) -> float:
    """Return the clearance of one configuration, pitches; values above ``enough`` are not exact."""
    poses = forward_kinematics(chain.module, angles, root=chain.root)
    return closest(
        chain.module, poses.positions, poses.rotations, module_size=module_size, enough=enough
    ).clearance


def _moved(chain: Chain, state: State, scales: Array) -> Array:
    """Return the (F − 1,) largest distance of a module from one scale to the next, pitches."""
    moved = np.empty(len(scales) - 1)
    for start in range(0, len(moved), STRAIGHTENING_CHUNK_FRAMES):
        part = scales[start : start + STRAIGHTENING_CHUNK_FRAMES + 1]
        centres = _centres(chain, state, part[:, None] * state.angles)
        centres -= centres.mean(axis=1, keepdims=True)
        steps = np.sqrt((np.diff(centres, axis=0) ** 2).sum(axis=2).max(axis=1))
        moved[start : start + STRAIGHTENING_CHUNK_FRAMES] = steps
    return moved


def _centres(chain: Chain, state: State, angles: Array) -> Array:
    """Return (F, n, 3) centres with the root at its pose in the state."""
    return forward_kinematics(
        chain.module,
        angles,
        root=chain.root,
        root_position=state.position,
        root_wxyz=wxyz_from_matrix(state.rotation),
    ).positions
