"""Kinematic playback: the reference itself, for chains too long to be simulated as one tree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.parameters import PlaybackParameters
from planner.record import Record
from planner.reference import clear_reference
from planner.timelaw import smooth_law
from planner.timeline import Frames, Phase
from planner.unfolding import Unfolding

Array = NDArray[np.float64]
CHUNK: Final = 256


def kinematic_frames(
    chain: Chain,
    record: Record,
    parameters: PlaybackParameters,
    *,
    module_size: float,
    start_s: float,
    frame_rad: float,
    unfolding: Unfolding | None,
) -> Iterator[Frames]:
    """The frames of a kinematic playback, some at a time; the centre of mass stays at rest.

    Args:
        chain: The chain.
        record: The explosion to play in reverse.
        parameters: Of the reference and its speed.
        module_size: Size of the modules as a fraction of the pitch.
        start_s: Time of the first frame.
        frame_rad: Length of the record between two frames.
        unfolding: How the chain becomes straight first; None when it is.
    """
    reference = clear_reference(
        chain,
        record.frames.joint_angles_rad[::-1],
        spacing_rad=parameters.spacing_rad,
        distance_weight=parameters.distance_weight,
        size=module_size,
    )
    count = max(2, int(np.ceil(reference.length_rad / frame_rad)))
    law = smooth_law(steps=count, step_s=parameters.step_s * parameters.steps_per_rad * frame_rad)
    if unfolding is None:
        last = record.frames[-1:]
        first = last.joint_angles_rad[0]
        position, wxyz = last.root_position[0], last.root_wxyz[0]
    else:
        first = unfolding.chain.folded_rad
        position, wxyz = root_folded(unfolding.chain)
    centre = chain.poses(first, position, wxyz).positions.mean(axis=0)

    def at_rest(phase: Phase, times: Array, angles: Array) -> Frames:
        free = chain.poses(angles, np.zeros(3), wxyz).positions.mean(axis=1)
        return Frames.of_phase(
            phase,
            time_s=times,
            joint_angles_rad=angles,
            root_position=centre - free,
            root_wxyz=np.broadcast_to(wxyz, (len(angles), 4)).copy(),
        )

    if unfolding is not None:
        # Its last frame is straight, and so is the first one of what follows.
        times = start_s + unfolding.time_s[-1] - unfolding.time_s[::-1]
        yield at_rest("unfolding", times[:-1], unfolding.folding_rad[::-1][:-1])
        start_s = float(times[-1])
    for start in range(0, count + 1, CHUNK):
        part = slice(start, min(start + CHUNK, count + 1))
        times = start_s + law.step_s * np.arange(count + 1.0)[part]
        yield at_rest("playback", times, reference.spline(law.u[part]))


def root_folded(chain: Chain) -> tuple[Array, Array]:
    """(3,) and (4,) the root's pose when folded."""
    folded = chain.folded_poses
    return folded.positions[chain.root], folded.wxyzs[chain.root]
