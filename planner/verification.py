"""Verification: a fold's directory checked anew, from its files alone."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from planner.certificate import Certificate, certify
from planner.errors import InputError
from planner.frames import PHASES
from planner.motion import motion_arrays
from planner.parameters import preset
from planner.plan import Plan
from planner.playback import Playback
from planner.progress import Report, silent
from planner.record import Record
from planner.replay import Replay, replay
from planner.timeline import Timeline, chain_attributes
from planner.windows import Windows

SAME_WITHIN: Final = 1e-9
POSES_WITHIN: Final = 1e-6
OVERLAP_WITHIN: Final = 1e-9
MOST_REPLAYED: Final = 5_000_000
"""Frames times modules that are replayed; of a longer plan every second frame, every third, …"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What a second look at a plan's files says.

    Attributes:
        certificate: Made anew from the files.
        replay: What plain MuJoCo says of the exported model with the plan's angles.
        problems: Everything that speaks against the plan, in plain words; empty when verified.
    """

    certificate: Certificate
    replay: Replay | None
    problems: tuple[str, ...]

    @property
    def verified(self) -> bool:
        """Whether nothing speaks against the plan."""
        return not self.problems

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "status": "verified" if self.verified else "failed",
            "problems": list(self.problems),
            "replay": None if self.replay is None else asdict(self.replay),
            "certificate": self.certificate.as_dict(),
        }


def verify(
    directory: FilePath, *, module_size: float | None = None, progress: Report = silent
) -> Verification:
    """Checks the plan in a directory by exact kinematics and by a replay in plain MuJoCo.

    Args:
        directory: Holds ``plan.json``, ``plan.npz``, ``model.xml`` and ``timeline.zarr``.
        module_size: Another size than the plan's own.
        progress: Told what is being checked.

    Raises:
        InputError: When a file is missing or cannot be read.
        TimelineError: When the timeline is missing or damaged.
    """
    plan = Plan.load(directory / "plan.npz")
    problems = _differences(plan, Plan.load(directory / "plan.json"))
    timeline = Timeline.open(directory / "timeline.zarr")
    try:
        record, playback = _results(plan, timeline)
    except (TypeError, AttributeError) as error:
        raise InputError(
            "not-a-plan", f"the plan's results cannot be read ({error}); plan the fold again."
        ) from error
    size = plan.certificate.module_size if module_size is None else module_size
    parameters = replace(preset(plan.preset), module_size=size)
    certificate = certify(
        plan.chain, record, playback, parameters, start=plan.start, progress=progress
    )
    if not certificate.verified:
        problems.append(certificate.verdict)
    found = None
    if len(plan.time_s):
        stride = -(-len(plan.motion) * len(plan.chain) // MOST_REPLAYED)
        found = replay(plan, _text(directory / "model.xml"), stride=stride)
        if found.pose_difference > POSES_WITHIN:
            problems.append(
                f"failed: the model's poses differ from the plan's by {found.pose_difference:.2g} "
                "pitch"
            )
        if found.overlap > OVERLAP_WITHIN:
            problems.append(
                f"failed: MuJoCo finds an overlap of {found.overlap:.2g} pitch at frame "
                f"{found.overlap_frame:g}"
            )
    return Verification(certificate=certificate, replay=found, problems=tuple(problems))


def _differences(plan: Plan, other: Plan) -> list[str]:
    if type(plan.motion) is not type(other.motion):
        return ["failed: plan.json and plan.npz differ in what they hold of a frame"]
    theirs = motion_arrays(other.motion)
    for name, mine in motion_arrays(plan.motion).items():
        if name == "joint_error_rad":
            continue  # which a plan has not
        if mine.shape != theirs[name].shape or (
            mine.size and not np.abs(mine - theirs[name]).max() <= SAME_WITHIN
        ):
            return [f"failed: plan.json and plan.npz differ in {name}"]
    mine, theirs = (p.start and chain_attributes(p.start) for p in (plan, other))
    if mine != theirs:
        return ["failed: plan.json and plan.npz differ in start"]
    return []


def _results(plan: Plan, timeline: Timeline) -> tuple[Record | None, Playback | None]:
    frames = timeline.motion()
    record = playback = None
    # The timeline of a refold, and of a smoothed plan, shows only what was made of the record.
    made = plan.start is not None or plan.smoothing is not None
    exploded = frames[np.flatnonzero(frames.phase == PHASES.index("explosion"))]
    if plan.explosion is not None and (not made or len(exploded)):
        figures = {k: v for k, v in plan.explosion.items() if k != "frames"}
        record = Record(frames=exploded, **figures)
    if plan.playback is not None:
        played = frames[np.flatnonzero(frames.phase != PHASES.index("explosion"))]
        if len(played) != len(plan.time_s):
            raise InputError(
                "wrong-timeline",
                f"got {len(played)} frames of playback in the timeline, expected "
                f"{len(plan.time_s)} as in the plan.",
            )
        if not np.array_equal(played.phase, plan.phase):
            raise InputError("wrong-timeline", "the timeline's phases are not those of the plan.")
        if isinstance(plan.motion, Windows):
            if not isinstance(played, Windows) or not played.passes_as(plan.motion):
                raise InputError(
                    "wrong-timeline", "the timeline's playback is not the motion of the plan."
                )
            reference = None
        else:
            reference = plan.joint_angles_rad
        playback = Playback(frames=played, reference_rad=reference, **plan.playback)
    return record, playback


def _text(path: FilePath) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("not-a-model", f"{path.name} cannot be read: {error}") from error
