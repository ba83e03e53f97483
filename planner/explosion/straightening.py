"""Straightening: the end of an explosion by pure kinematics, all angles shrinking together."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.rotations import wxyz_from_matrix
from planner.clearance.clearance import closest
from planner.clearance.sweep import sweep
from planner.motion.frames import Frames
from planner.simulation.reduced import State

Array = NDArray[np.float64]
LEAST_CLEARANCE: Final = 0.02
"""Clearance in pitches to keep on the way, or half of the straight chain's where that is less."""
FRAME_S: Final = 0.1
"""Simulated seconds between two frames."""
CHUNK: Final = 128
FIRST_LOOKS: Final = 24
"""Configurations on the way that are looked at before anything else."""
LOOK_EVERY: Final = 4
"""Frames between two that are checked first, before the whole way is proved."""


def straightening(
    chain: Chain,
    state: State,
    *,
    start_s: float,
    snapshot_rad: float,
    snapshot_distance: float,
    size: float,
) -> Frames | None:
    """Frames from a nearly straight state to the straight one, q·s with s from 1 to 0.

    The root keeps its orientation and the centre of mass stays where it is.

    Returns:
        The frames after the given state, or None when modules would come too close on the way.
    """
    angles = state.angles
    for scale in np.linspace(1.0, 0.0, FIRST_LOOKS, endpoint=False):
        # What touches soon is found before the way is divided into frames.
        if _clearance(chain, scale * angles, size, LEAST_CLEARANCE) < 0.0:
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
    least = min(LEAST_CLEARANCE, 0.5 * _clearance(chain, way[-1], size, 2.0 * LEAST_CLEARANCE))
    for row in way[::LOOK_EVERY]:  # before all is proved
        if _clearance(chain, row, size, least) < least:
            return None
    swept = sweep(chain, np.concatenate([angles[None], way]), size=size)
    if swept.clearance < least or swept.bound <= 0.0:
        return None
    centre = _centres(chain, state, angles[None])[0].mean(axis=0)
    offsets = np.concatenate(
        [
            _centres(chain, state, way[start : start + CHUNK]).mean(axis=1)
            for start in range(0, count, CHUNK)
        ]
    )
    return Frames.of_phase(
        "explosion",
        time_s=start_s + FRAME_S * np.arange(1.0, count + 1.0),
        joint_angles_rad=way,
        root_position=state.position + centre - offsets,
        root_wxyz=np.broadcast_to(wxyz_from_matrix(state.rotation), (count, 4)).copy(),
    )


def _clearance(chain: Chain, angles: Array, size: float, enough: float) -> float:
    """Of one configuration; anything above ``enough`` is not told apart."""
    poses = forward_kinematics(chain.module, angles, root=chain.root)
    return closest(
        chain.module, poses.positions, poses.rotations, size=size, enough=enough
    ).clearance


def _moved(chain: Chain, state: State, scales: Array) -> Array:
    """(F − 1,) the farthest that a module moves from one scale to the next."""
    moved = np.empty(len(scales) - 1)
    for start in range(0, len(moved), CHUNK):
        part = scales[start : start + CHUNK + 1]
        centres = _centres(chain, state, part[:, None] * state.angles)
        centres -= centres.mean(axis=1, keepdims=True)
        steps = np.sqrt((np.diff(centres, axis=0) ** 2).sum(axis=2).max(axis=1))
        moved[start : start + CHUNK] = steps
    return moved


def _centres(chain: Chain, state: State, angles: Array) -> Array:
    """(F, n, 3) centres with the root where the state has it."""
    return forward_kinematics(
        chain.module,
        angles,
        root=chain.root,
        root_position=state.position,
        root_wxyz=wxyz_from_matrix(state.rotation),
    ).positions
