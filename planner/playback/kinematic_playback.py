"""Kinematic playback: the reference itself, for chains too long to be simulated as one tree."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from foldback.planner.arrays import FRAMES_AT_ONCE, Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import MAX_SMOOTH_CURVE_MODULES
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion, Phase
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.playback.reference_curve import Reference, clear_reference, resting_reference
from foldback.planner.playback.time_scaling import (
    SCALING_STEPS,
    hinge_bounded_times,
    smooth_scaling,
)
from foldback.planner.playback.unfolding import Unfolding


def kinematic_frames(
    chain: Chain,
    recorded: Motion,
    parameters: PlaybackParameters,
    *,
    module_size: float,
    start_s: float,
    frame_rad: float,
    unfolding: Unfolding | None,
    rests: Ints | None = None,
) -> Iterator[Motion]:
    """Yield the frames of a kinematic playback, in chunks.

    The centre of mass of a dense motion stays at rest.

    Args:
        chain: The chain.
        recorded: Snapshots of the explosion to play in reverse.
        parameters: Parameters of the reference and its speed.
        module_size: Size of the modules as a fraction of the pitch.
        start_s: Time of the first frame, s.
        frame_rad: Approximate turn of a hinge between two frames, rad.
        unfolding: Motion by which the chain becomes straight first; None if it is straight.
        rests: Snapshots at which the chain rests between turns; None if it does not.
    """
    if recorded.is_windowed or (
        rests is None and len(chain) > MAX_SMOOTH_CURVE_MODULES and unfolding is None
    ):
        yield _as_recorded(chain, recorded, parameters, start_s)
        return
    if rests is None:
        reference = clear_reference(
            chain,
            recorded.joint_angles_rad[::-1],
            spacing_rad=parameters.spacing_rad,
            distance_weight=parameters.distance_weight,
            module_size=module_size,
        )
        places = reference.places(frame_rad)
        steps_rad = reference.steps_rad(places)
        seconds = parameters.step_s * parameters.steps_per_rad * float(steps_rad.sum())
        playing_s = hinge_bounded_times(steps_rad, seconds)
    else:
        reference = resting_reference(recorded.joint_angles_rad[rests][::-1])
        s_per_rad = parameters.step_s * parameters.steps_per_rad
        places, playing_s = _resting_places(reference, frame_rad, s_per_rad)
    if unfolding is None:
        last = recorded[-1:]
        first = last.joint_angles_rad[0]
        position, wxyz = last.root_position[0], last.root_wxyz[0]
    else:
        first = unfolding.chain.folded_rad
        position, wxyz = root_folded(unfolding.chain)
    centre = chain.poses(first, position, wxyz).positions.mean(axis=0)

    def at_rest(phase: Phase, times: Array, angles: Array) -> Motion:
        free = chain.poses(angles, np.zeros(3), wxyz).positions.mean(axis=1)
        return Motion.from_frames(
            phase=phase,
            time_s=times,
            joint_angles_rad=angles,
            root_position=centre - free,
            root_wxyz=np.broadcast_to(wxyz, (len(angles), 4)).copy(),
        )

    if unfolding is not None:
        # Its last frame is straight, and so is the first one of what follows.
        times = start_s + unfolding.time_s[-1] - unfolding.time_s[::-1]
        yield at_rest("unfolding", times[:-1], quantised(unfolding.folding_rad[::-1][:-1]))
        start_s = float(times[-1])
    for start in range(0, len(places), FRAMES_AT_ONCE):
        part = slice(start, start + FRAMES_AT_ONCE)
        yield at_rest(
            "playback", start_s + playing_s[part], quantised(reference.spline(places[part]))
        )


def rests_between_places(reference: Reference, frame_rad: float) -> Ints:
    """Return the (R,) numbers of the frames at rest of a kinematic playback."""
    assert reference.rests is not None
    turns = np.diff(reference.rests) * reference.length_rad
    counts = np.maximum(1, np.ceil(turns / frame_rad - 1e-9).astype(np.int64))
    return np.concatenate([[0], np.cumsum(counts)])


def _resting_places(
    reference: Reference, frame_rad: float, s_per_rad: float
) -> tuple[Array, Array]:
    """Return (F,) parameters and times of frames, evenly spaced from one rest to the next."""
    assert reference.rests is not None
    rests, at = reference.rests, rests_between_places(reference, frame_rad)
    places = np.interp(np.arange(at[-1] + 1), at, rests)
    seconds = np.diff(rests) * reference.length_rad * s_per_rad
    ends = np.concatenate([[0.0], np.cumsum(seconds)])
    even = smooth_scaling(steps=SCALING_STEPS, step_s=1.0 / SCALING_STEPS)
    step = np.clip(np.searchsorted(rests, places, "right") - 1, 0, len(rests) - 2)
    parts = (places - rests[step]) / (rests[step + 1] - rests[step])
    shares = np.interp(parts, even.u, np.linspace(0.0, 1.0, SCALING_STEPS + 1))
    return places, ends[step] + shares * seconds[step]


def _as_recorded(
    chain: Chain, recorded: Motion, parameters: PlaybackParameters, start_s: float
) -> Motion:
    """Return the record in reverse: between two of its frames the hinges run evenly.

    A windowed motion has the speed of a smooth reference on the same hinges.
    """
    backwards = recorded[::-1]
    s_per_rad = parameters.step_s * parameters.steps_per_rad
    if recorded.is_windowed:
        # The stops of a simulated joint give a little.
        farthest = chain.module.largest_angle_rad
        angles = quantised(backwards.angles_rad, np.array([-farthest, farthest]))
        angles = angles.astype(np.float32)
        lengths = np.concatenate([[0.0], np.cumsum(backwards.steps(chain)[0])])
        total = float(lengths[-1])
        scaling = smooth_scaling(steps=SCALING_STEPS, step_s=1.0 / SCALING_STEPS)
        shares = np.interp(
            lengths / max(total, 1e-12), scaling.u, np.linspace(0.0, 1.0, SCALING_STEPS + 1)
        )
        times = s_per_rad * total * shares
    else:
        angles = quantised(backwards.angles_rad)
        steps_rad, _ = backwards.with_angles(angles).steps(chain)
        times = hinge_bounded_times(steps_rad, s_per_rad * float(steps_rad.sum()))
    return backwards.with_angles(angles).with_columns(time_s=start_s + times, phase="playback")


def root_folded(chain: Chain) -> tuple[Array, Array]:
    """Return the (3,) position and (4,) orientation of the root when folded."""
    folded = chain.folded_poses
    return folded.positions[chain.root], folded.wxyzs[chain.root]
