"""Measuring: the figures of a timeline, worked out apart from the simulation.

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
from numpy.typing import NDArray

from planner.certificate.certificate import MOVING_FRACTION, Certificate, torque_unit_nm
from planner.certificate.metrics import (
    FRAMES_A_CHUNK,
    REACH,
    Curves,
    Figures,
    Floats,
    Integers,
    write,
)
from planner.chain.chain import Chain
from planner.chain.dynamics import floating_torques, motion_of
from planner.chain.kinematics import forward_kinematics
from planner.clearance.sweep import sweep
from planner.kernels.clearance import Solid, module_clearances
from planner.motion.frames import PHASES, Frames
from planner.motion.inverse import inverse_dynamics
from planner.motion.timeline import Timeline
from planner.motion.windows import Windows
from planner.parameters.parameters import Parameters

Array = NDArray[np.float64]
MARGIN: Final = 32
"""Frames beyond each end of a chunk that its spline is fitted to as well. A frame's influence falls
to a quarter from one to the next, so 32 leave nothing of where chunks meet."""
MOST_THREADS: Final = 4
STILL: Final = 1e-9
"""Speed of the fastest hinge up to which none counts as moving."""
EXPLOSION: Final = PHASES.index("explosion")


def write_figures(
    timeline: str | FilePath,
    path: str | FilePath,
    parameters: Parameters,
    *,
    certificate: Certificate | None = None,
    clearances: Array | None = None,
) -> None:
    """Works the figures of a timeline out and saves them, some frames at a time.

    Of a timeline of windows there are only those of the whole frames, ``Curves``; clearances of
    ``planner.clearance.sweep.CLEARANCE_CAP`` and more are not told apart, and torques are those at
    some frames.

    Args:
        timeline: Where the timeline is.
        path: Where the figures shall be; what is there is replaced.
        parameters: For the module size and the physical units.
        certificate: What was verified of the fold: torques are then those of its fold time. Without
            it, that of the frames themselves under the joint speed limit.
        clearances: Of windows that are played back: what the certificate found at each of them, so
            that they are not swept again.

    Raises:
        TimelineError: When there is no timeline, or it is damaged.
    """
    read = Timeline.open(timeline)
    if read.windowed:
        # Of all modules in all frames there would be billions.
        write([_curves(read, parameters, certificate, clearances)], len(read), str(path))
        return
    write(_parts(read, parameters, certificate), len(read), str(path))


def clearances_of(chain: Chain, angles_rad: Array, *, size: float) -> tuple[Floats, Integers]:
    """Each module's clearance and the module it is nearest to, see ``Figures``.

    Args:
        chain: The chain.
        angles_rad: (F, J) configurations.
        size: Module size as a fraction of the pitch.

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
        Solid(module.hull, float(size), module.inner_radius),
        module.apart,
        REACH,
        clearance,
        nearest,
    )
    return clearance, nearest


def _parts(
    timeline: Timeline, parameters: Parameters, certificate: Certificate | None
) -> Iterator[Figures]:
    """The figures of a timeline, a chunk of frames at a time; at least one, which may be empty."""
    unit = torque_unit_nm(timeline.chain, parameters)
    unit /= max(_slower(timeline, parameters, certificate), 1e-12) ** 2

    def part(around: Frames, here: slice) -> Figures:
        torque = unit * _torques(timeline.chain, around, here, whole=not here.start)
        return _of_frames(timeline.chain, around, here, torque, parameters.module_size)

    chunks = _read_chunks(timeline)
    before, now = timeline.frames(0, 0), next(chunks)
    threads = min(MOST_THREADS, os.cpu_count() or 1)
    due: deque[Future[Figures]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        while now is not None:
            after = next(chunks, None)
            around = Frames.joined([before, now, *([] if after is None else [after[:MARGIN]])])
            due.append(pool.submit(part, around, slice(len(before), len(before) + len(now))))
            if len(due) > threads:
                yield due.popleft().result()
            before, now = now[-MARGIN:], after
        for left in due:
            yield left.result()


def _curves(
    timeline: Timeline,
    parameters: Parameters,
    certificate: Certificate | None,
    known: Array | None,
) -> Curves:
    """The figures of a timeline of windows."""
    chain, windows = timeline.chain, timeline.windows()
    clearance = np.empty(len(windows), dtype=np.float32)
    torque = np.full(len(windows), np.nan, dtype=np.float32)
    moving = np.zeros(len(windows), dtype=np.int32)
    unit = torque_unit_nm(chain, parameters)
    unit /= max(_slower(timeline, parameters, certificate), 1e-12) ** 2
    seen: tuple[Windows, Floats] | None = None
    for phase in np.unique(windows.phase)[::-1]:
        numbers = np.flatnonzero(windows.phase == phase)
        part = windows[numbers]
        if phase != EXPLOSION and known is not None and len(known) == len(part):
            clearance[numbers] = known
        elif seen is not None and seen[0].passes_as(part[::-1]):
            # A kinematic playback passes through what was recorded.
            clearance[numbers] = seen[1][::-1]
        else:
            clearance[numbers] = sweep(chain, part, size=parameters.module_size).per_frame
        seen = part, clearance[numbers]
        steps = part.steps(chain, fraction=MOVING_FRACTION)[1]
        moving[numbers] = np.concatenate([steps[:1], steps]) if len(steps) else 0
        if phase != EXPLOSION:
            found = inverse_dynamics(chain, part)
            if len(found.frames):
                torque[numbers] = unit * np.interp(
                    np.arange(len(numbers)), found.frames, found.largest
                )
    return Curves(
        max_error_rad=windows.largest_errors.astype(np.float32),
        min_clearance=clearance,
        hinges_moving=moving,
        peak_torque_nm=torque,
    )


def _read_chunks(timeline: Timeline) -> Iterator[Frames]:
    """All frames, each chunk read once."""
    for start in range(0, max(1, len(timeline)), FRAMES_A_CHUNK):
        yield timeline.frames(start, min(start + FRAMES_A_CHUNK, len(timeline)))


def _of_frames(chain: Chain, around: Frames, here: slice, torque: Array, size: float) -> Figures:
    frames = around[here]
    broken = np.flatnonzero(~np.isfinite(frames.joint_angles_rad).all(axis=1))
    angles = frames.joint_angles_rad.copy()
    angles[broken] = 0.0
    clearance, nearest = clearances_of(chain, angles, size=size)
    clearance[broken] = np.nan
    nearest[broken] = -1
    return Figures(
        clearance=clearance,
        nearest=nearest,
        torque_nm=torque.astype(np.float32),
        max_error_rad=_largest(frames.joint_error_rad),
        min_clearance=clearance.min(axis=1, initial=REACH),
        hinges_moving=_moving(around)[here],
        peak_torque_nm=_largest(np.abs(torque)),
    )


def _largest(values: Array) -> Floats:
    """The largest of every row; NaN when there is one in it, or nothing at all."""
    if not values.shape[1]:
        return np.full(len(values), np.nan, dtype=np.float32)
    return values.max(axis=1).astype(np.float32)


def _moving(frames: Frames) -> Integers:
    """Hinges that move from the frame before, of the first frame of a phase to the frame after."""
    count = len(frames)
    if count < 2:
        return np.zeros(count, dtype=np.int32)
    speeds = _speeds(frames)
    fastest = speeds.max(axis=1, initial=0.0)
    moving = (speeds > MOVING_FRACTION * fastest[:, None]).sum(axis=1)
    moving[~(fastest > STILL)] = 0
    begins = np.concatenate([[True], np.diff(frames.phase) != 0])
    step = np.where(begins, np.arange(count), np.arange(count) - 1)
    return moving[np.minimum(step, count - 2)].astype(np.int32)


def _torques(chain: Chain, around: Frames, here: slice, *, whole: bool) -> Array:
    """Torques in simulation units of the frames ``here``, from the motion of those around them.

    NaN in the explosion and where they can't be told. ``whole`` says that nothing comes before
    the frames, so that what is played in them begins there. A refold's unfolding and folding are
    one motion, which rests when it is straight.
    """
    played = around.phase != EXPLOSION
    angles, times = around.joint_angles_rad[played], around.time_s[played]
    torques = np.full_like(around.joint_angles_rad[here], np.nan)
    wanted = played[here]
    if not wanted.any() or not (np.isfinite(angles).all() and np.isfinite(times).all()):
        return torques
    at = np.flatnonzero(np.arange(len(played))[played] >= here.start)[: wanted.sum()]
    rates, accelerations = motion_of(times, angles, at, from_rest=whole or not played[0])
    torques[wanted] = floating_torques(chain.module, angles[at], rates, accelerations)
    return torques


def _slower(timeline: Timeline, parameters: Parameters, certificate: Certificate | None) -> float:
    """How many times slower than simulated a robot folds; 1 where nothing is played."""
    times, phases = timeline.clock()
    times = times[phases != EXPLOSION]
    if not len(times) or times[-1] <= times[0]:
        return 1.0
    if certificate is not None and certificate.fold_time_s:
        return certificate.fold_time_s / float(times[-1] - times[0])
    if timeline.windowed:
        windows = timeline.windows(len(phases) - len(times), len(phases))
        steps, _ = windows.steps(timeline.chain)
        speeds = steps / np.maximum(np.diff(times), 1e-12)
        return float(speeds.max(initial=0.0)) / parameters.joint_speed_limit_rad_s
    fastest = 0.0
    for start in range(len(phases) - len(times), len(phases) - 1, FRAMES_A_CHUNK):
        frames = timeline.frames(start, min(start + FRAMES_A_CHUNK + 1, len(phases)))
        fastest = max(fastest, float(_speeds(frames).max(initial=0.0)))
    return fastest / parameters.joint_speed_limit_rad_s


def _speeds(frames: Frames) -> Array:
    """(F − 1, J) mean speeds of the hinges between every frame and the next."""
    elapsed = np.maximum(np.diff(frames.time_s), 1e-12)
    return np.abs(np.diff(frames.joint_angles_rad, axis=0)) / elapsed[:, None]
