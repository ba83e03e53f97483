"""Straightening: the end of an explosion by pure kinematics, all angles shrinking together."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.clearance import closest
from planner.frames import Frames
from planner.kinematics import forward_kinematics
from planner.rotations import wxyz_from_matrix
from planner.segments import State

Array = NDArray[np.float64]
LEAST_CLEARANCE: Final = 0.02
FRAME_S: Final = 0.1


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
    centre = _centres(chain, state, angles[None])[0].mean(axis=0)
    count = int(np.ceil(max(np.abs(angles).max() / snapshot_rad, 1.0)))
    while True:
        scales = np.linspace(1.0, 0.0, count + 1)
        centres = _centres(chain, state, scales[:, None] * angles)
        centred = centres - centres.mean(axis=1, keepdims=True)
        moved = float(np.sqrt((np.diff(centred, axis=0) ** 2).sum(axis=2).max()))
        if moved <= snapshot_distance:
            break
        # A long chain does not straighten evenly: its ends move most at first.
        count = int(np.ceil(1.05 * count * moved / snapshot_distance))
    way = scales[1:, None] * angles
    for row in way:
        poses = forward_kinematics(chain.module, row, root=chain.root)
        place = closest(
            chain.module, poses.positions, poses.rotations, size=size, enough=LEAST_CLEARANCE
        )
        if place.clearance < LEAST_CLEARANCE:
            return None
    return Frames.of_phase(
        "explosion",
        time_s=start_s + FRAME_S * np.arange(1.0, count + 1.0),
        joint_angles_rad=way,
        root_position=state.position + centre - centres[1:].mean(axis=1),
        root_wxyz=np.broadcast_to(wxyz_from_matrix(state.rotation), (count, 4)).copy(),
    )


def _centres(chain: Chain, state: State, angles: Array) -> Array:
    """(F, n, 3) centres with the root where the state has it."""
    return forward_kinematics(
        chain.module,
        angles,
        root=chain.root,
        root_position=state.position,
        root_wxyz=wxyz_from_matrix(state.rotation),
    ).positions
