"""Verdict of a certificate: the first condition that a plan fails."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from foldback.planner.certificate.plan_figures import distances_from_shape, rms
from foldback.planner.certificate.swept_motions import Sweeps, followed, motions_of_other_robots
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import aligned_distances
from foldback.planner.clearance.sweep import Sweep
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.unfolding import MAX_ANGLE_DIFFERENCE_RAD
from foldback.planner.reasons import Reason, ReasonValues
from foldback.planner.reasons import ReasonCode as Code

MAX_STOP_GIVE_RAD: Final = 1e-4
"""Maximum angle, rad, by which a simulated joint may be beyond the end of its range: where a shape
is folded up to there, the joint's stop holds it, and gives a little."""
MAX_VERIFIED_ERROR_PITCH: Final = 0.01
"""Maximum RMS position error of the modules, in pitches, at the end of a simulated playback that is
certified as verified."""
MAX_START_ERROR_PITCH: Final = 1e-6
"""Maximum distance, in pitches, of modules from the cells of the first shape at the beginning of a
playback from one shape to another: rounding. A larger distance fails the certificate."""


def find_reason(
    chain: Chain,
    start: Chain | None,
    record: Record | None,
    playback: Playback | None,
    sweeps: Sweeps,
    figures: dict[str, Any],
    module_size: float,
) -> Reason | None:
    """Return the first condition that a fold fails; None if it is verified.

    Args:
        chain, start, record, playback: As in ``certify``.
        sweeps: Sweeps of the motions.
        figures: Figures of the plan and the simulated playback.
        module_size: Module size as a fraction of the pitch.
    """
    if record is not None and record.status != "straight":
        return record.reason or Reason.of(Code.EXPLOSION_FAILED, status=record.status)
    if playback is None or sweeps.plan is None:
        return Reason.of(Code.NO_PLAYBACK)
    swept: list[tuple[ReasonValues, Sweep | None]] = [({"motion": "plan"}, sweeps.plan)]
    for number, of_playback in enumerate(sweeps.of_robots):
        motion: ReasonValues = {"motion": "simulated playback"}
        if playback.mujoco_rad is not None and number == len(sweeps.of_robots) - 1:
            motion = {"motion": "simulated playback in MuJoCo"}
        elif number:
            motion["robot"] = number
        swept.append((motion, of_playback))
    for motion, sweep in swept:
        if sweep is not None and sweep.clearance < 0.0:
            return _overlap(motion, sweep, module_size)
    if playback.status != "folded":
        return playback.reason or Reason.of(Code.PLAYBACK_FAILED, status=playback.status)
    if wrong_beginning := _wrong_beginning(chain, start, playback):
        return wrong_beginning
    if figures["plan_end_error_rad"] > MAX_ANGLE_DIFFERENCE_RAD:
        return Reason.of(Code.PLAN_END)
    for (motion, _), frames in zip(swept, followed(playback), strict=False):
        give = MAX_ANGLE_DIFFERENCE_RAD if motion.get("motion") == "plan" else MAX_STOP_GIVE_RAD
        if beyond := _beyond_range(chain, motion, frames, give):
            return beyond
    if playback.simulated and figures["rms_position_error"] > MAX_VERIFIED_ERROR_PITCH:
        return Reason.of(Code.PLAYBACK_END, error=figures["rms_position_error"])
    for other_motion in motions_of_other_robots(playback):
        error = rms(distances_from_shape(chain, other_motion.angles_at(chain, -1)))
        if error > MAX_VERIFIED_ERROR_PITCH:
            return Reason.of(Code.OTHER_ROBOT_END, error=error)
    for motion, sweep in swept:
        if sweep is not None and sweep.bound <= 0.0:
            return _unproved(motion, sweep)
    return None


def _overlap(motion: ReasonValues, sweep: Sweep, module_size: float) -> Reason:
    """Return the deepest overlap of a motion."""
    return Reason.of(
        Code.OVERLAP,
        motion,
        modules=_modules(sweep),
        depth=-float(sweep.clearance),
        module_size=module_size,
        progress=float(sweep.frame) / max(1, len(sweep.per_frame) - 1),
        frame=float(sweep.frame),
    )


def _unproved(motion: ReasonValues, sweep: Sweep) -> Reason:
    """Return the frame at which the clearance of a motion could not be proved positive."""
    if sweep.unbounded is None or sweep.clearance == 0.0:
        return Reason.of(Code.TOUCH, motion, modules=_modules(sweep), frame=float(sweep.frame))
    return Reason.of(Code.CLEARANCE_UNPROVED, motion, frame=float(sweep.unbounded))


def _beyond_range(chain: Chain, motion: ReasonValues, frames: Motion, give: float) -> Reason | None:
    """Return the joint that a motion bends farther beyond its range than stops give, in rad."""
    low, high = chain.stops_rad().T
    angles = frames.angles_rad
    if not angles.size or (angles.min() >= low.max() and angles.max() <= high.min()):
        return None
    worst, frame, hinge = give, -1, -1
    for k, (first, begin) in enumerate(zip(frames.first, frames.offsets[:-1], strict=True)):
        row = angles[begin : frames.offsets[k + 1]]
        hinges = slice(first, first + len(row))
        beyond = np.maximum(row - high[hinges], low[hinges] - row)
        if beyond.max(initial=0.0) > worst:
            worst, frame, hinge = float(beyond.max()), k, int(first + beyond.argmax())
    if frame < 0:
        return None
    angle = float(angles[frames.offsets[frame] + hinge - frames.first[frame]])
    return Reason.of(
        Code.JOINT_BEYOND_RANGE,
        motion,
        joint=chain.joint_names[hinge],
        angle_rad=angle,
        limit_rad=float(high[hinge] if angle > high[hinge] else low[hinge]),
        frame=float(frame),
    )


def _wrong_beginning(chain: Chain, start: Chain | None, playback: Playback) -> Reason | None:
    """Return an error of the beginning, or of a refold until it is straight; None if none."""
    frames, plan = playback.frames, playback.reference
    straight = int((frames.phase == PHASES.index("unfolding")).sum())
    expected = np.full(len(frames), PHASES.index("playback"), dtype=np.uint8)
    if start is not None:
        expected[:straight] = PHASES.index("unfolding")
    if not np.array_equal(frames.phase, expected) or straight == len(frames):
        return Reason.of(Code.PHASE_ORDER)
    if np.abs(plan.angles_at(chain, straight)).max() > MAX_ANGLE_DIFFERENCE_RAD:
        return Reason.of(Code.STARTS_BENT if start is None else Code.NEVER_STRAIGHT)
    if start is None:
        return None
    if plan.is_windowed:
        return Reason.of(Code.WINDOWED_START, start=start.name)
    off_rad = np.abs(plan.joint_angles_rad[0] - start.folded_rad).max() if straight else np.inf
    if off_rad > MAX_ANGLE_DIFFERENCE_RAD:
        return Reason.of(Code.PLAN_START, start=start.name)
    simulated = frames.joint_angles_rad
    first = frames.poses(chain, 0, 1)
    if (
        np.abs(simulated[0] - start.folded_rad).max() > MAX_ANGLE_DIFFERENCE_RAD
        or np.abs(first.positions[0] - start.folded_poses.positions).max() > MAX_START_ERROR_PITCH
    ):
        return Reason.of(Code.PLAYBACK_START, start=start.name)
    error = straight_error(chain, playback)
    if error > MAX_VERIFIED_ERROR_PITCH:
        return Reason.of(Code.STRAIGHT_ERROR, error=error)
    return None


def straight_error(chain: Chain, playback: Playback) -> float:
    """Return the RMS distance of a refold's modules from straight, in pitches, after alignment.

    It is measured where the motions of the two shapes meet, and 0 for other folds.
    """
    frames = playback.frames
    straight = int((frames.phase == PHASES.index("unfolding")).sum())
    if straight in (0, len(frames)):
        return 0.0
    still, identity = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    passed = chain.poses(frames.joint_angles_rad[straight], still, identity).positions
    line = chain.poses(np.zeros_like(chain.folded_rad), still, identity).positions
    return rms(aligned_distances(passed, line))


def _modules(sweep: Sweep) -> list[int] | None:
    return None if sweep.modules is None else [int(module) for module in sweep.modules]
