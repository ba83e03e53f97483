"""Frame metrics: figures of every frame, computed apart from the simulation.

Clearance by separating axes, as in the certificate; torques by inverse dynamics along the recorded
motion.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path as FilePath
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.figures_store import (
    CLEARANCE_REACH_PITCH,
    Curves,
    Figures,
    Floats,
    Integers,
    write,
)
from foldback.planner.certificate.plan_figures import MOVING_SPEED_SHARE, torque_unit_nm
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import floating_torques, spline_derivatives
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core import module_clearances
from foldback.planner.core.structures import Solid
from foldback.planner.motion.inverse_dynamics import inverse_dynamics
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.parameters import Parameters

FRAMES_PER_FILE: Final = 128
"""Number of frames whose figures are computed and stored together."""
SPLINE_MARGIN_FRAMES: Final = 32
"""Number of frames beyond each end of a chunk of a motion that the spline for the chunk's rates and
accelerations is fitted to as well. A frame's influence falls to a quarter from one frame to the
next, so that 32 make the result independent of the division into chunks; fewer do not, more take
time. Computed."""
EXPLOSION: Final = PHASES.index("explosion")


def write_figures(
    timeline: str | FilePath,
    path: str | FilePath,
    parameters: Parameters,
    *,
    certificate: Certificate | None = None,
    plan: Motion | None = None,
) -> None:
    """Compute the figures of a timeline and save them, in chunks of frames.

    A timeline of windows has only figures of whole frames, ``Curves``: clearances are capped at
    ``planner.clearance.sweep.CLEARANCE_CAP``, and torques are computed at some frames.

    Args:
        timeline: Path of the timeline.
        path: Path of the figures; a file that is there is replaced.
        parameters: Parameters of the fold: module size and physical units.
        certificate: Certificate of the fold, whose fold time scales the torques. Without it, the
            fold time is that of the frames under the joint speed limit.
        plan: Motion of the plan, for a timeline of windows: its clearances are shown in place of
            those of the simulated windows. None for the latter.

    Raises:
        TimelineError: There is no timeline, or it is damaged.
    """
    read = Timeline.open(timeline)
    if read.windowed:
        # Of all modules in all frames there would be billions.
        write([_curves(read, parameters, certificate, plan)], path)
        return
    write(_parts(read, parameters, certificate), path)


def clearances_of(
    chain: Chain, angles_rad: Array, *, module_size: float
) -> tuple[Floats, Integers]:
    """Return each module's clearance and the module it is nearest to, see ``Figures``.

    Args:
        chain: The chain.
        angles_rad: (F, J) configurations.
        module_size: Module size as a fraction of the pitch.

    Returns:
        (F, N) clearances and (F, N) modules.
    """
    module = chain.module
    poses = forward_kinematics(module, angles_rad, root=chain.root)
    clearance = np.empty(poses.positions.shape[:2], dtype=np.float32)
    nearest = np.empty(clearance.shape, dtype=np.int32)
    module_clearances(
        poses.positions,
        poses.rotations,
        Solid(module.hull, float(module_size), module.inner_radius),
        module.apart,
        CLEARANCE_REACH_PITCH,
        clearance,
        nearest,
    )
    return clearance, nearest


def _parts(
    timeline: Timeline, parameters: Parameters, certificate: Certificate | None
) -> Iterator[Figures]:
    """Yield the figures of a timeline, a chunk of frames at a time; at least one, maybe empty."""
    unit = torque_unit_nm(timeline.chain, parameters)
    unit /= max(_slower(timeline, parameters, certificate), 1e-12) ** 2

    def part(around: Motion, frames: slice) -> Figures:
        torque = unit * _torques(timeline.chain, around, frames, is_first=not frames.start)
        return _of_frames(timeline.chain, around, frames, torque, parameters.module_size)

    chunks = _read_chunks(timeline)
    before, now = timeline.frames(0, 0), next(chunks)
    threads = min(4, os.cpu_count() or 1)
    due: deque[Future[Figures]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        while now is not None:
            after = next(chunks, None)
            around = Motion.joined(
                [before, now, *([] if after is None else [after[:SPLINE_MARGIN_FRAMES]])]
            )
            due.append(pool.submit(part, around, slice(len(before), len(before) + len(now))))
            if len(due) > threads:
                yield due.popleft().result()
            before, now = now[-SPLINE_MARGIN_FRAMES:], after
        for future in due:
            yield future.result()


def _curves(
    timeline: Timeline,
    parameters: Parameters,
    certificate: Certificate | None,
    plan: Motion | None,
) -> Curves:
    """Return the figures of a timeline of windows."""
    chain, windows = timeline.chain, timeline.windows()
    clearance = np.empty(len(windows), dtype=np.float32)
    torque = np.full(len(windows), np.nan, dtype=np.float32)
    moving = np.zeros(len(windows), dtype=np.int32)
    unit = torque_unit_nm(chain, parameters)
    unit /= max(_slower(timeline, parameters, certificate), 1e-12) ** 2
    mirrored: tuple[Motion, Floats] | None = None
    for phase in np.unique(windows.phase)[::-1]:
        numbers = np.flatnonzero(windows.phase == phase)
        part = windows[numbers]
        if mirrored is not None and mirrored[0].passes_as(part[::-1]):
            # A kinematic playback passes through what was recorded.
            clearance[numbers] = mirrored[1][::-1]
        else:
            shown = part
            if phase != EXPLOSION and plan is not None and len(plan) == len(part):
                shown = plan
            # Only the frames count, so nothing is proved between them.
            swept = sweep(chain, shown, module_size=parameters.module_size, share=0.0)
            clearance[numbers] = swept.per_frame
        mirrored = part, clearance[numbers]
        steps = part.steps(chain, fraction=MOVING_SPEED_SHARE)[1]
        moving[numbers] = np.concatenate([steps[:1], steps]) if len(steps) else 0
        if phase != EXPLOSION:
            dynamics = inverse_dynamics(chain, part)
            if len(dynamics.frames):
                torque[numbers] = unit * np.interp(
                    np.arange(len(numbers)), dynamics.frames, dynamics.largest
                )
    return Curves(
        max_error_rad=windows.largest_errors.astype(np.float32),
        min_clearance=clearance,
        hinges_moving=moving,
        peak_torque_nm=torque,
    )


def _read_chunks(timeline: Timeline) -> Iterator[Motion]:
    """Yield all frames in the parts whose figures are stored together."""
    for start in range(0, max(1, len(timeline)), FRAMES_PER_FILE):
        yield timeline.frames(start, min(start + FRAMES_PER_FILE, len(timeline)))


def _of_frames(
    chain: Chain, around: Motion, frames_here: slice, torque: Array, module_size: float
) -> Figures:
    frames = around[frames_here]
    broken = np.flatnonzero(~np.isfinite(frames.joint_angles_rad).all(axis=1))
    angles = frames.joint_angles_rad.copy()
    angles[broken] = 0.0
    clearance, nearest = clearances_of(chain, angles, module_size=module_size)
    clearance[broken] = np.nan
    nearest[broken] = -1
    return Figures(
        clearance=clearance,
        nearest=nearest,
        torque_nm=torque.astype(np.float32),
        max_error_rad=_largest(frames.joint_error_rad),
        min_clearance=clearance.min(axis=1, initial=CLEARANCE_REACH_PITCH),
        hinges_moving=_moving(around)[frames_here],
        peak_torque_nm=_largest(np.abs(torque)),
    )


def _largest(values: Array) -> Floats:
    """Return the largest value of every row; NaN if the row has a NaN, or no values."""
    if not values.shape[1]:
        return np.full(len(values), np.nan, dtype=np.float32)
    return values.max(axis=1).astype(np.float32)


def _moving(frames: Motion) -> Integers:
    """Count hinges that move from the frame before; at the start of a phase, to the frame after."""
    count = len(frames)
    if count < 2:
        return np.zeros(count, dtype=np.int32)
    speeds = _speeds(frames)
    fastest = speeds.max(axis=1, initial=0.0)
    moving = (speeds > MOVING_SPEED_SHARE * fastest[:, None]).sum(axis=1)
    moving[~(fastest > 1e-9)] = 0  # such speeds are rounding
    begins = np.concatenate([[True], np.diff(frames.phase) != 0])
    step = np.where(begins, np.arange(count), np.arange(count) - 1)
    return moving[np.minimum(step, count - 2)].astype(np.int32)


def _torques(chain: Chain, around: Motion, frames: slice, *, is_first: bool) -> Array:
    """Return torques in simulation units of the frames ``frames``, from the motion around them.

    They are NaN in the explosion and where they cannot be computed. With ``is_first``, no frame
    comes before these, and the playback begins in them. A refold's unfolding and folding are one
    motion, which rests when it is straight.
    """
    played = around.phase != EXPLOSION
    angles, times = around.joint_angles_rad[played], around.time_s[played]
    torques = np.full_like(around.joint_angles_rad[frames], np.nan)
    is_played = played[frames]
    if not is_played.any() or not (np.isfinite(angles).all() and np.isfinite(times).all()):
        return torques
    at = np.flatnonzero(np.arange(len(played))[played] >= frames.start)[: is_played.sum()]
    rates, accelerations = spline_derivatives(
        times, angles, at, from_rest=is_first or not played[0]
    )
    torques[is_played] = floating_torques(chain.module, angles[at], rates, accelerations)
    return torques


def _slower(timeline: Timeline, parameters: Parameters, certificate: Certificate | None) -> float:
    """Return the ratio of a robot's fold time to the simulated one; 1 without a playback."""
    times, phases = timeline.clock()
    times = times[phases != EXPLOSION]
    if not len(times) or times[-1] <= times[0]:
        return 1.0
    if certificate is not None and certificate.fold_time_s:
        return certificate.fold_time_s / float(times[-1] - times[0])
    fastest = 0.0
    for start in range(len(phases) - len(times), len(phases) - 1, timeline.chunk_frames):
        stop = min(start + timeline.chunk_frames + 1, len(phases))
        motion = timeline.motion(start, stop)
        steps_rad, _ = motion.steps(timeline.chain)
        elapsed = np.maximum(np.diff(motion.time_s), 1e-12)
        fastest = max(fastest, float((steps_rad / elapsed).max(initial=0.0)))
    return fastest / parameters.joint_speed_limit_rad_s


def _speeds(frames: Motion) -> Array:
    """Return the (F − 1, J) mean speeds of the hinges between frames, rad/s."""
    elapsed = np.maximum(np.diff(frames.time_s), 1e-12)
    return np.abs(np.diff(frames.joint_angles_rad, axis=0)) / elapsed[:, None]
