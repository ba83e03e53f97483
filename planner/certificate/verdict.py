"""Verdict of a certificate: the first condition that a plan fails, or how it was verified."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from foldback.planner.certificate.figures import KINEMATICS_ONLY, SIMULATED
from foldback.planner.certificate.plan_figures import distances_from_shape, rms
from foldback.planner.certificate.swept_motions import Sweeps, followed, others
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import aligned_distances
from foldback.planner.clearance.sweep import Sweep
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.unfolding import MAX_ANGLE_DIFFERENCE_RAD

MAX_VERIFIED_ERROR_PITCH: Final = 0.01
"""Maximum RMS position error of the modules, in pitches, at the end of a simulated playback that is
certified as verified."""
MAX_START_ERROR_PITCH: Final = 1e-6
"""Maximum distance, in pitches, of modules from the cells of the first shape at the beginning of a
playback from one shape to another: rounding. A larger distance fails the certificate."""


def find_verdict(
    chain: Chain,
    start: Chain | None,
    record: Record | None,
    playback: Playback | None,
    sweeps: Sweeps,
    figures: dict[str, Any],
    size: float,
) -> str:
    """Return the verdict of a fold: the first condition that it fails, or how it was verified.

    Args:
        chain, start, record, playback: As in ``certify``.
        sweeps: Sweeps of the motions.
        figures: Figures of the plan and the simulated playback.
        size: Module size as a fraction of the pitch.
    """
    if record is not None and record.status != "straight":
        return f"failed: the explosion {record.status}: {record.reason}"
    if playback is None or sweeps.plan is None:
        return "failed: there is no playback"
    motions: dict[str, Sweep | None] = {"plan": sweeps.plan}
    for number, of_playback in enumerate(sweeps.of_robots):
        robot = f" of robot {number + 1}" if number else ""
        motions[f"simulated playback{robot}"] = of_playback
    for name, found in motions.items():
        if found is not None and found.clearance < 0.0:
            return (
                f"failed: in the {name}, modules {_pair(found)} overlap by {-found.clearance:.3g} "
                f"pitch at module size {size:g}, {_percent(found):.0f} % into the fold (frame "
                f"{found.frame:g} of the {name})"
            )
    if playback.status != "folded":
        return f"failed: the playback {playback.status}: {playback.reason}"
    if begins_otherwise := _begins_otherwise(chain, start, playback):
        return f"failed: {begins_otherwise}"
    if figures["plan_end_error_rad"] > MAX_ANGLE_DIFFERENCE_RAD:
        return "failed: the plan does not end folded"
    for name, motion in zip(motions, followed(playback), strict=False):
        if beyond := _beyond_range(chain, motion):
            return f"failed: the {name} {beyond} of the {name})"
    if playback.simulated and figures["rms_position_error"] > MAX_VERIFIED_ERROR_PITCH:
        return (
            f"failed: the playback ends {figures['rms_position_error']:.2g} pitch (RMS) from the "
            "folded shape"
        )
    for other in others(playback):
        error = rms(distances_from_shape(chain, other.angles_at(chain, -1)))
        if error > MAX_VERIFIED_ERROR_PITCH:
            return (
                f"failed: the playback of another robot ends {error:.2g} pitch (RMS) from the "
                "folded shape"
            )
    for name, found in motions.items():
        if found is not None and found.bound <= 0.0:
            return f"failed: {_unproved(name, found)}"
    return SIMULATED if playback.simulated else KINEMATICS_ONLY


def _unproved(name: str, found: Sweep) -> str:
    """Describe the frame at which the clearance of a motion could not be proved positive."""
    if found.unbounded is None or found.clearance == 0.0:
        return f"in the {name}, modules {_pair(found)} touch (frame {found.frame:g} of the {name})"
    return (
        f"in the {name}, the clearance between two frames could not be bounded "
        f"(frame {found.unbounded:g} of the {name})"
    )


def _beyond_range(chain: Chain, motion: Motion) -> str:
    """Describe the joint that a motion bends beyond its range; empty if there is none."""
    limit, angles = chain.module.angle_limit_rad, motion.angles_rad
    if not angles.size or np.abs(angles).max() <= limit + MAX_ANGLE_DIFFERENCE_RAD:
        return ""
    worst = int(np.abs(angles).argmax())
    frame = int(np.searchsorted(motion.offsets, worst, side="right")) - 1
    hinge = int(motion.first[frame] + worst - motion.offsets[frame])
    return (
        f"bends {chain.joint_names[hinge]} to {np.rad2deg(angles[worst]):.4g}°, beyond its "
        f"range of ±{np.rad2deg(limit):.4g}° (frame {frame}"
    )


def _begins_otherwise(chain: Chain, start: Chain | None, playback: Playback) -> str:
    """Describe an error of the beginning, or of a refold until it is straight; empty if none."""
    frames, plan = playback.frames, playback.reference
    straight = int((frames.phase == PHASES.index("unfolding")).sum())
    expected = np.full(len(frames), PHASES.index("playback"), dtype=np.uint8)
    if start is not None:
        expected[:straight] = PHASES.index("unfolding")
    if not np.array_equal(frames.phase, expected) or straight == len(frames):
        return "the phases of the playback are out of order"
    if np.abs(plan.angles_at(chain, straight)).max() > MAX_ANGLE_DIFFERENCE_RAD:
        passes = "start" if start is None else "become"
        return f"the plan does not {passes} straight"
    if start is None:
        return ""
    if plan.is_windowed:
        return f"a playback of windows does not start folded as {start.name}"
    off_rad = np.abs(plan.joint_angles_rad[0] - start.folded_rad).max() if straight else np.inf
    if off_rad > MAX_ANGLE_DIFFERENCE_RAD:
        return f"the plan does not start folded as {start.name}"
    simulated = frames.joint_angles_rad
    first = frames.poses(chain, 0, 1)
    if (
        np.abs(simulated[0] - start.folded_rad).max() > MAX_ANGLE_DIFFERENCE_RAD
        or np.abs(first.positions[0] - start.folded_poses.positions).max() > MAX_START_ERROR_PITCH
    ):
        return f"the playback does not start folded as {start.name}"
    off = straight_error(chain, playback)
    if off > MAX_VERIFIED_ERROR_PITCH:
        return f"the playback passes {off:.2g} pitch (RMS) from straight"
    return ""


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


def _percent(found: Sweep) -> float:
    return 100.0 * found.frame / max(1, len(found.per_frame) - 1)


def _pair(found: Sweep) -> str:
    return "?" if found.modules is None else f"{found.modules[0]} and {found.modules[1]}"
