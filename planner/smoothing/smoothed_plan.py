"""Smoothed plan: made from a verified one, with a shorter and quieter motion.

Its record is a smoothed motion in place of an explosion. The next stages are those of any fold: it
is played back along a smooth curve, and the certificate judges that.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.reference_curve import record_lengths
from foldback.planner.progress import Cancelled, never
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.smoothing import MAX_SMOOTHED_ANGLES, RECORDED, SMOOTHED
from foldback.planner.smoothing.motion_quality import Quality
from foldback.planner.smoothing.smoothing import (
    DISTANCE_WEIGHT,
    MAX_EVALUATIONS,
    smooth,
    spacing_of,
)


def check_smoothable(plan: Plan) -> None:
    """Refuse a plan that cannot be smoothed.

    Raises:
        InputError: ``smooth-refold``, ``smooth-not-verified``, ``smooth-no-motion``,
            ``smooth-no-torques`` or ``smooth-too-long``.
    """
    name = plan.chain.name
    if plan.start is not None:
        raise InputError(
            "smooth-refold",
            f"got the refold {name}, expected a fold that starts straight; only such folds can be "
            "smoothed.",
        )
    if not plan.verified:
        raise InputError(
            "smooth-not-verified",
            f"got a plan of {name} that is not verified, expected a verified plan; fold the shape "
            "again with another seed or preset.",
        )
    if not plan.certificate.fold_time_s:
        raise InputError(
            "smooth-no-motion",
            f"got a plan of {name} in which nothing moves, expected a plan in which the chain "
            "moves.",
        )
    if plan.certificate.peak_torque_nm is None:
        raise InputError(
            "smooth-no-torques",
            f"got a plan of {name} that states no torques, expected the largest torque; fold the "
            "shape again.",
        )
    hinges, frames = len(plan.chain.folded_rad), len(plan.motion)
    if frames * hinges <= MAX_SMOOTHED_ANGLES:
        length = record_lengths(plan.chain, plan.joint_angles_rad, DISTANCE_WEIGHT)[-1]
        frames = max(frames, int(length / spacing_of(length)))
    if frames * hinges > MAX_SMOOTHED_ANGLES:
        raise InputError(
            "smooth-too-long",
            f"got a motion of {frames} frames with {frames * hinges} hinge angles in all, "
            f"expected at most {MAX_SMOOTHED_ANGLES} angles; the motion is too long to be "
            "smoothed, but `foldback retime` can limit its speed.",
        )


def smoothed_record(
    plan: Plan,
    way: str,
    *,
    module_size: float,
    seed: int,
    calm: bool = False,
    report: Callable[[float], None] | None = None,
    cancelled: Cancelled = never,
) -> Record:
    """Return a plan's motion smoothed, from folded to straight, in place of an explosion.

    Args:
        plan: A plan that may be smoothed.
        way: One of ``WAYS``.
        module_size: Module size that it is to be verified at, as a fraction of the pitch.
        seed: Seed of all random numbers.
        calm: True if hinges are to make few detours, see ``smooth``.
        report: Receives the fraction that is done, after each part.
        cancelled: Returns True to stop; the motion found so far is then taken.
    """
    start_s = time.perf_counter()
    motion = plan.whole()
    angles = motion.joint_angles_rad
    if way != RECORDED:
        looks = MAX_EVALUATIONS if way == SMOOTHED else MAX_EVALUATIONS // 4
        angles = smooth(
            plan.chain,
            angles,
            module_size=module_size,
            seed=seed,
            looks=looks,
            calm=calm,
            report=report,
            cancelled=cancelled,
        ).angles
    count = len(angles)
    stopped = cancelled()
    return Record(
        status="cancelled" if stopped else "straight",
        reason=Reason.of(Code.SMOOTHING_CANCELLED) if stopped else None,
        frames=Motion.from_frames(
            phase="explosion",
            time_s=np.linspace(0.0, float(motion.time_s[-1]), count),
            joint_angles_rad=angles[::-1],
            root_position=np.repeat(motion.root_position[:1], count, axis=0),
            root_wxyz=np.repeat(motion.root_wxyz[:1], count, axis=0),
        ),
        steps=0,
        seconds=time.perf_counter() - start_s,
        strategy=way,
    )


def before_and_after(recorded: Plan, smoothed: Plan) -> dict[str, Any]:
    """Compare the plans before and after smoothing, both in the recorded one's time; plain values.

    Args:
        recorded: The plan that was smoothed.
        smoothed: The resulting plan; without a playback its figures are None.
    """
    seconds = recorded.certificate.fold_time_s
    assert seconds is not None
    after = None
    if smoothed.certificate.peak_torque_nm is not None:
        after = Quality.of(smoothed, seconds).as_dict()
    # Clearances are comparable at one module size only.
    size = smoothed.certificate.module_size
    before = Quality.of(recorded, seconds)
    if recorded.certificate.module_size != size:
        clearance = sweep(recorded.chain, recorded.motion, module_size=size).clearance
        before = replace(before, clearance=clearance)
    return {
        "way": (smoothed.explosion or {}).get("strategy"),
        "seconds": seconds,
        "before": before.as_dict(),
        "after": after,
    }
