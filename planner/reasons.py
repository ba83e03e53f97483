"""Reasons: why a plan is not verified, as a code with values, and its text."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Literal, TypedDict, cast

MotionName = Literal["plan", "record", "playback", "simulated playback"]


class ReasonCode(StrEnum):
    """Code of a reason."""

    CANCELLED = "cancelled"
    NO_PLAYBACK = "no-playback"
    EXPLOSION_FAILED = "explosion-failed"
    PLAYBACK_FAILED = "playback-failed"
    OVERLAP = "overlap"
    TOUCH = "touch"
    CLEARANCE_UNPROVED = "clearance-unproved"
    JOINT_BEYOND_RANGE = "joint-beyond-range"
    PLAN_END = "plan-end"
    PLAYBACK_END = "playback-end"
    OTHER_ROBOT_END = "other-robot-end"
    PHASE_ORDER = "phase-order"
    NEVER_STRAIGHT = "never-straight"
    STARTS_BENT = "starts-bent"
    WINDOWED_START = "windowed-start"
    PLAN_START = "plan-start"
    PLAYBACK_START = "playback-start"
    STRAIGHT_ERROR = "straight-error"
    DIFFERENT_MODULES = "different-modules"
    NO_FRAMES = "no-frames"
    NO_PLAN = "no-plan"
    UNREADABLE_MOTION = "unreadable-motion"
    ANGLE_COUNT = "angle-count"
    PLAN_SHAPE = "plan-shape"
    NOT_FINITE = "not-finite"
    TIME_ORDER = "time-order"
    OTHER_ROBOTS = "other-robots"
    TIPS_OVER = "tips-over"
    NO_TABLE = "no-table"
    SINKS_INTO_TABLE = "sinks-into-table"
    TORQUE_LIMIT = "torque-limit"


class ReasonValues(TypedDict, total=False):
    """Values of a reason; lengths in pitches, torques in w·p, modules and frames counted from 0.

    Attributes:
        motion: Motion that fails.
        robot: Index of the simulated robot; absent for the one that is shown.
        frame: Frame of the motion; a fraction lies between two frames.
        progress: Share of the motion before that frame.
        modules: Two modules; None if they are not known.
        depth: Depth of an overlap.
        module_size: Size of the modules as a fraction of the pitch.
        joint: Name of a hinge.
        angle_rad, limit_rad: Its angle and the limit of its range.
        error: RMS distance of the modules from their places.
        start, chain: Names of the shapes of a refold.
        joints: Number of hinges.
        shape, expected: Shape of an array of angles and the expected one; one dimension if only the
            angles of moving hinges are stored.
        count, frames: Number of frames that fail, and of all frames.
        torque, limit_torque: Torque of a hinge and its limit.
        limit: Maximum length that is allowed.
        friction: μ between modules and table.
        clamped: True if the first module is clamped to the table.
        status, detail: Status of a motion that failed, and its own reason.
    """

    motion: MotionName
    robot: int
    frame: float
    progress: float
    modules: list[int] | None
    depth: float
    module_size: float
    joint: str
    angle_rad: float
    limit_rad: float
    error: float
    start: str
    chain: str
    joints: int
    shape: list[int]
    expected: list[int]
    count: int
    frames: int
    torque: float
    limit_torque: float
    limit: float
    friction: float
    clamped: bool
    status: str
    detail: str


class ReasonFigures(TypedDict):
    """``Reason`` as plain JSON values."""

    code: str
    values: ReasonValues


@dataclass(frozen=True, slots=True)
class Reader:
    """Style of a reason's text.

    Attributes:
        first: Number of the first module, frame and robot.
        length: Returns a length in pitches as text.
        frame: Returns a frame as text, given its number counted from 0.
        place: Returns the place of a frame in a motion as text, given the frame and the motion's
            name; empty to leave it out.
        detail: Returns the reason of a motion that failed.
    """

    first: int
    length: Callable[[float], str]
    frame: Callable[[float], str]
    place: Callable[[float, str], str]
    detail: Callable[[str], str] = str


PROGRAMS: Final = Reader(
    first=0,
    length="{:.3g} pitch".format,
    frame="{:g}".format,
    place=lambda frame, motion: f" (frame {frame:g} of the {motion})",
)
"""Style for files and the API: numbers count from 0, lengths are in pitches."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Reason as a value: a code, and the values that its text names."""

    code: ReasonCode
    values: ReasonValues

    @classmethod
    def of(cls, code: ReasonCode, common: ReasonValues | None = None, **values: Any) -> Reason:
        """Return a reason with these values, see ``ReasonValues``.

        Args:
            code: The code.
            common: Values that several reasons share.
            values: Further values.
        """
        return cls(code, cast(ReasonValues, {**(common or {}), **values}))

    def as_dict(self) -> ReasonFigures:
        """Return plain JSON values."""
        return {"code": str(self.code), "values": self.values}

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the reason as a phrase in plain English."""
        values = self.values
        failed = self.code in (ReasonCode.EXPLOSION_FAILED, ReasonCode.PLAYBACK_FAILED)
        if failed and (detail := reader.detail(values.get("detail", ""))):
            return detail
        return TEXTS[self.code].format(**_words(values, reader))


def _words(values: ReasonValues, reader: Reader) -> dict[str, Any]:
    """Return the values as texts, by name."""
    words: dict[str, Any] = {**values}
    if motion := words.get("motion"):
        if "robot" in words:
            motion = words["motion"] = f"{motion} of robot {words['robot'] + reader.first}"
        words["at"] = reader.place(words["frame"], motion) if "frame" in words else ""
    for name in ("depth", "error", "limit"):
        if name in words:
            words[name] = reader.length(words[name])
    if "progress" in words:
        words["progress"] = f"{100.0 * words['progress']:.0f} %"
    for name in ("angle_rad", "limit_rad"):
        if name in words:
            words[name.removesuffix("_rad")] = f"{math.degrees(words[name]):.4g}°"
    if "frame" in words:
        words["frame"] = reader.frame(words["frame"])
    if "friction" in words:
        words["friction"] = friction_text(words["friction"], clamped=words["clamped"])
    if "modules" in words:
        words["modules"] = _modules(words["modules"], reader.first)
    if "shape" in words:
        count, *hinges = words["expected"]
        what = f"frames of {hinges[0]} joint angles" if hinges else "angles of the hinges in motion"
        words |= {"shape": tuple(words["shape"]), "expected": f"{count} {what}"}
    return words


def _modules(modules: list[int] | None, first: int) -> str:
    if modules is None:
        return "modules"
    return f"modules {' and '.join(str(module + first) for module in modules)}"


def friction_text(friction: float, *, clamped: bool) -> str:
    """Return the friction with a table, and the base that a torque assumes, as text."""
    if friction == 0.0:
        return "without friction"
    base = "a clamped first module" if clamped else "no clamped module"
    return f"with friction μ = {friction:g} and {base}"


TEXTS: Final = {
    ReasonCode.CANCELLED: "the check was cancelled",
    ReasonCode.NO_PLAYBACK: "there is no playback",
    ReasonCode.EXPLOSION_FAILED: "the explosion {status}",
    ReasonCode.PLAYBACK_FAILED: "the playback {status}",
    ReasonCode.OVERLAP: (
        "in the {motion}, {modules} overlap by {depth} at module size {module_size:g}, "
        "{progress} through the motion{at}"
    ),
    ReasonCode.TOUCH: "in the {motion}, {modules} touch{at}",
    ReasonCode.CLEARANCE_UNPROVED: (
        "in the {motion}, it could not be proved that the modules stay apart between one frame "
        "and the next{at}"
    ),
    ReasonCode.JOINT_BEYOND_RANGE: (
        "the {motion} bends {joint} to {angle}, beyond its range of ±{limit}{at}"
    ),
    ReasonCode.PLAN_END: "the plan does not end in the folded shape",
    ReasonCode.PLAYBACK_END: (
        "the playback ends {error} on average (root mean square) from the folded shape"
    ),
    ReasonCode.OTHER_ROBOT_END: (
        "the playback of another simulated robot ends {error} on average (root mean square) from "
        "the folded shape"
    ),
    ReasonCode.PHASE_ORDER: "in the playback, unfolding and folding are in the wrong order",
    ReasonCode.NEVER_STRAIGHT: "the plan does not become straight",
    ReasonCode.STARTS_BENT: "the plan does not start straight",
    ReasonCode.WINDOWED_START: (
        "a playback in which only the moving hinges are stored does not start in the folded shape "
        "of {start}"
    ),
    ReasonCode.PLAN_START: "the plan does not start in the folded shape of {start}",
    ReasonCode.PLAYBACK_START: "the playback does not start in the folded shape of {start}",
    ReasonCode.STRAIGHT_ERROR: (
        "at the straight shape, the modules are {error} on average (root mean square) from their "
        "places"
    ),
    ReasonCode.DIFFERENT_MODULES: (
        "{start} and {chain} differ in the type or the number of their modules"
    ),
    ReasonCode.NO_FRAMES: "the {motion} has no frames",
    ReasonCode.NO_PLAN: "there is no plan for these frames",
    ReasonCode.UNREADABLE_MOTION: "the {motion} cannot be checked: {detail}",
    ReasonCode.ANGLE_COUNT: "the {motion} does not have {joints} joint angles in each frame",
    ReasonCode.PLAN_SHAPE: "the plan has the shape {shape}, expected {expected}",
    ReasonCode.NOT_FINITE: "the {motion} contains infinite or undefined numbers",
    ReasonCode.TIME_ORDER: (
        "in the {motion}, a frame has an earlier time than the frame before it"
    ),
    ReasonCode.OTHER_ROBOTS: (
        "the playbacks of the other simulated robots do not match the plan, or contain infinite "
        "or undefined joint angles"
    ),
    ReasonCode.TIPS_OVER: (
        "the chain would tip over in {count} of {frames} frames, first in frame {frame} "
        "({friction})"
    ),
    ReasonCode.NO_TABLE: (
        "the chain floats, so a table does not support it. If the chain rested on a table in each "
        "frame, the largest torque of a hinge would be {torque:.3g} w·p in frame {frame} "
        "({friction})"
    ),
    ReasonCode.SINKS_INTO_TABLE: (
        "modules sink {depth} into the table in frame {frame}, but at most {limit} is allowed"
    ),
    ReasonCode.TORQUE_LIMIT: (
        "a hinge needs a torque of {torque:.3g} w·p in frame {frame} ({friction}), but the limit "
        "is {limit_torque:g} w·p"
    ),
}
"""Text of each reason."""
