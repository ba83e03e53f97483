"""Reasons: why a plan is not verified, as a code with values, and its text."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Literal, TypedDict, cast

import msgspec

MotionName = Literal[
    "plan", "record", "playback", "simulated playback", "simulated playback in MuJoCo"
]


class ReasonCode(StrEnum):
    """Code of a reason."""

    CANCELLED = "cancelled"
    NO_PLAYBACK = "no-playback"
    EXPLOSION_FAILED = "explosion-failed"
    EXPLOSION_CANCELLED = "explosion-cancelled"
    TURNS_CANCELLED = "turns-cancelled"
    SMOOTHING_CANCELLED = "smoothing-cancelled"
    PLAYBACK_CANCELLED = "playback-cancelled"
    SIMULATION_FAILED = "simulation-failed"
    MAX_STEPS = "max-steps"
    MAX_SNAPSHOTS = "max-snapshots"
    MAX_TURNS = "max-turns"
    AT_REST = "at-rest"
    STUCK = "stuck"
    STUCK_PEELING = "stuck-peeling"
    STUCK_ON_TABLE = "stuck-on-table"
    NO_QUARTER_TURN = "no-quarter-turn"
    NO_TURNS = "no-turns"
    NOT_STRAIGHT = "not-straight"
    PLAYBACK_FAILED = "playback-failed"
    MISSED = "missed"
    NOT_AT_REST = "not-at-rest"
    LOST_TARGET = "lost-target"
    WEAK_MOTOR = "weak-motor"
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
        status: Status of a motion that failed.
        detail: Error message of the program.
        steps, max_steps: Number of steps, and its limit.
        snapshots: Number of recorded snapshots.
        pushes: Number of random pushes in a row without progress.
        module: A module, counted from 0.
        folded: Last module of the part that is still folded; None if all modules are released.
        bend_rad: Angle by which a joint is still bent.
        turns: Number of turns that were tested.
        bent: Number of hinges whose angle is wrong.
        states: Number of states whose turns were tried.
        error_rad: Error of a joint angle.
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
    steps: int
    max_steps: int
    snapshots: int
    pushes: int
    module: int
    folded: int | None
    bend_rad: float
    turns: int
    bent: int
    states: int
    error_rad: float


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
        unfolding, folding: Names of the two phases: the motion from the folded shape to the
            straight chain, and the motion back.
    """

    first: int
    length: Callable[[float], str]
    frame: Callable[[float], str]
    place: Callable[[float, str], str]
    unfolding: str
    folding: str


PROGRAMS: Final = Reader(
    first=0,
    length="{:.3g} pitch".format,
    frame="{:g}".format,
    place=lambda frame, motion: f" (frame {frame:g} of the {motion})",
    unfolding="explosion",
    folding="playback",
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

    def as_text(self) -> str:
        """Return JSON, for files that hold only arrays."""
        return json.dumps(self.as_dict())

    @classmethod
    def from_dict(cls, values: ReasonFigures | None) -> Reason | None:
        """Build a reason from ``as_dict``; None for None.

        Raises:
            ValueError: The code is unknown, or a value is missing or of another type.
        """
        if values is None:
            return None
        try:
            reason = msgspec.convert(values, cls)
            reason.text()
        except (msgspec.ValidationError, KeyError, ValueError) as error:
            raise ValueError(f"got a reason whose values do not fit its code: {error}") from error
        return reason

    @classmethod
    def from_text(cls, text: str) -> Reason | None:
        """Build a reason from ``as_text``; None for an empty text.

        Raises:
            TypeError: As ``from_dict``.
            ValueError: The text is not JSON.
        """
        return cls.from_dict(json.loads(text)) if text else None

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the reason as a phrase in plain English."""
        return TEXTS[self.code].format(**_words(self.values, reader))

    def __str__(self) -> str:
        """Return the text with numbers from 0."""
        return self.text()


def _words(values: ReasonValues, reader: Reader) -> dict[str, Any]:
    """Return the values as texts, by name."""
    words: dict[str, Any] = {
        **values,
        "unfolding": reader.unfolding,
        "folding": reader.folding,
    }
    if motion := words.get("motion"):
        motion = words["motion"] = motion.replace("playback", reader.folding)
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
    if "bend_rad" in words:
        words["bend"] = f"{math.degrees(words['bend_rad']):.0f}°"
    if "module" in words:
        words["module"] += reader.first
    if "folded" in words:
        words["folded"] = (
            "with all modules released"
            if words["folded"] is None
            else f"with modules {reader.first} to {words['folded'] + reader.first} still folded"
        )
    if "states" in words:
        words["states"] = f"{words['states']} state{'' if words['states'] == 1 else 's'}"
    if "frame" in words:
        words["frame"] = reader.frame(words["frame"])
    if "friction" in words:
        words["friction"] = friction_text(words["friction"], clamped=words["clamped"])
    if "modules" in words:
        words["modules"] = _modules(words["modules"], reader.first)
    if "shape" in words:
        count, *hinges = words["expected"]
        elements = "angles of the hinges in motion"
        if hinges:
            elements = f"frames of {hinges[0]} joint angles"
        words |= {"shape": tuple(words["shape"]), "expected": f"{count} {elements}"}
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
    ReasonCode.NO_PLAYBACK: "there is no {folding}",
    ReasonCode.EXPLOSION_FAILED: "the {unfolding} {status}",
    ReasonCode.EXPLOSION_CANCELLED: "the {unfolding} was cancelled",
    ReasonCode.TURNS_CANCELLED: "the search for turns was cancelled",
    ReasonCode.SMOOTHING_CANCELLED: "smoothing was cancelled",
    ReasonCode.PLAYBACK_CANCELLED: "the {folding} was cancelled",
    ReasonCode.SIMULATION_FAILED: "the simulation failed: {detail}",
    ReasonCode.MAX_STEPS: (
        "the chain was not straight after {steps} steps; try another seed, or another path through "
        "the same cells"
    ),
    ReasonCode.MAX_SNAPSHOTS: (
        "after {snapshots} snapshots, the maximum for a chain of this length, the chain was still "
        "not straight; set a longer snapshot_interval"
    ),
    ReasonCode.MAX_TURNS: "turns were found in {steps} steps, more than {max_steps}",
    ReasonCode.AT_REST: "nothing moved any more after {steps} steps",
    ReasonCode.STUCK: (
        "the chain is stuck: {pushes} random pushes in a row made no progress. The joint of module "
        "{module} is still bent by {bend}. Try another seed, or another path through the same cells"
    ),
    ReasonCode.STUCK_PEELING: (
        "the chain is stuck {folded}: {pushes} random pushes in a row made no progress. The joint "
        "of module {module} is still bent by {bend}. Start the chain at its other end, or try "
        "another path"
    ),
    ReasonCode.STUCK_ON_TABLE: (
        "the chain is stuck {folded}: a hinge would need a torque of more than {limit_torque:.2f} "
        "w·p (module weight × spacing), which is the torque limit. Try another path, or stronger "
        "motors"
    ),
    ReasonCode.NO_QUARTER_TURN: (
        "none of the {turns} quarter turns of the {joints} hinges is free in the folded state"
    ),
    ReasonCode.NO_TURNS: (
        "the search for turns ended with {bent} hinges still bent, after it had tried the turns of "
        "{states}"
    ),
    ReasonCode.NOT_STRAIGHT: "the chain was not straight after the {unfolding}",
    ReasonCode.PLAYBACK_FAILED: "the {folding} {status}",
    ReasonCode.MISSED: (
        "the modules ended {error} from their targets on average (root mean square)"
    ),
    ReasonCode.NOT_AT_REST: (
        "the chain was not at rest in its folded shape after {steps} steps: the modules are "
        "{error} from their targets on average (root mean square), and {bent} of {joints} hinges "
        "are off by more than 0.1 rad"
    ),
    ReasonCode.LOST_TARGET: (
        "a robot could not follow the motion: after {progress} of the motion, the angle of {joint} "
        "was off by {error_rad:.2g} rad, more than its motor could correct"
    ),
    ReasonCode.WEAK_MOTOR: (
        "the motor of {joint} is too weak: it supplies at most {limit_torque:.3g} w·p (module "
        "weight × spacing). After {progress} of the motion, the angle of this joint was off by "
        "{error_rad:.2g} rad"
    ),
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
        "the {motion} bends {joint} to {angle}, beyond its range, which ends at {limit}{at}"
    ),
    ReasonCode.PLAN_END: "the plan does not end in the folded shape",
    ReasonCode.PLAYBACK_END: (
        "the {folding} ends {error} on average (root mean square) from the folded shape"
    ),
    ReasonCode.OTHER_ROBOT_END: (
        "the {folding} of another simulated robot ends {error} on average (root mean square) "
        "from the folded shape"
    ),
    ReasonCode.PHASE_ORDER: "in the {folding}, unfolding and folding are in the wrong order",
    ReasonCode.NEVER_STRAIGHT: "the plan does not become straight",
    ReasonCode.STARTS_BENT: "the plan does not start straight",
    ReasonCode.WINDOWED_START: (
        "a {folding} in which only the moving hinges are stored does not start in the folded "
        "shape of {start}"
    ),
    ReasonCode.PLAN_START: "the plan does not start in the folded shape of {start}",
    ReasonCode.PLAYBACK_START: "the {folding} does not start in the folded shape of {start}",
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
        "the {folding}s of the other simulated robots do not match the plan, or contain infinite "
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
