"""Verification: a fold's directory checked anew, from its files alone.

All that is said of the plan is either worked out anew or compared with what says the same, and the
rest with the digests in the manifest. What is not as it should be is told by file and field.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from planner.certificate.certificate import Certificate, certify
from planner.clearance.linked import Place
from planner.clearance.sweep import clearance_at
from planner.errors import UNREADABLE, InputError, PlannerError, TimelineError, named
from planner.explosion.paper import KEPT_RAD
from planner.exports import mjcf
from planner.motion.angle_steps import STEP_RAD
from planner.motion.frames import PHASES, Frames
from planner.motion.inverse import inverse_dynamics
from planner.motion.motion import Motion, motion_arrays
from planner.motion.record import Record
from planner.motion.timeline import Timeline, chain_attributes
from planner.motion.windows import Windows
from planner.pipeline import manifest
from planner.pipeline.attempts import CANDIDATES, Candidates
from planner.pipeline.fold_directory import read_playback, read_record, read_request
from planner.plan.differences import array_difference, value_differences
from planner.plan.model_differences import model_differences
from planner.plan.plan import EARLIER, Plan, read_values, versions
from planner.plan.replay import Replay, replay
from planner.playback.playback import Playback, simulates
from planner.playback.unfolding import START_CHAIN, START_PLAN
from planner.progress import Report, silent
from planner.robot import RECORDED_PLAN
from planner.simulation.parameters import Parameters, preset

ROUNDED_WITHIN: Final = 1e-9
"""Numbers in the JSON form of earlier formats have twelve decimals."""
SINGLE_WITHIN: Final = 1e-6
"""Joint errors below 16 rad in single precision, as timelines have them."""
FIGURES_RTOL: Final = 1e-7
FIGURES_ATOL: Final = 1e-9
"""Sums over a thousand modules and positions of a thousand pitches in double precision lose 1e-12;
another processor's sines change the last digit of what goes in."""
PLACE_WITHIN: Final = 1e-7
"""Clearance in pitches by which a place may differ from the closest one and still be it."""
BOUND_RTOL: Final = 1e-3
IN_BETWEENS_RTOL: Final = 1e-2
"""Where a tie is broken otherwise, some intervals are halved once more or less."""
STEPS_WITHIN: Final = 1e-3
"""Steps by which the time of the frames may differ from that of a simulation's steps."""
POSES_WITHIN: Final = 1e-6
OVERLAP_WITHIN: Final = 1e-9
MOST_REPLAYED: Final = 5_000_000
"""Frames times modules that are replayed; of a longer plan every second frame, every third, …"""
MOST_TOLD: Final = 8
"""Differences of one kind that are told one by one."""
NEIGHBOURS: Final = re.compile(r'<exclude body1="module_(\d+)" body2="module_(\d+)"/>')
Differences = Iterator[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What a second look at a plan's files says.

    Attributes:
        certificate: Made anew from the files.
        replay: What plain MuJoCo says of the exported model with the plan's angles.
        checked: What was looked at, in plain words.
        problems: Everything that speaks against the plan, in plain words; empty when verified.
        notes: What could not be checked, and why.
    """

    certificate: Certificate
    replay: Replay | None
    checked: tuple[str, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def verified(self) -> bool:
        """Whether nothing speaks against the plan."""
        return not self.problems

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "status": "verified" if self.verified else "failed",
            "problems": list(self.problems),
            "notes": list(self.notes),
            "checked": list(self.checked),
            "replay": None if self.replay is None else asdict(self.replay),
            "certificate": self.certificate.as_dict(),
        }


def verify(
    directory: FilePath, *, module_size: float | None = None, progress: Report = silent
) -> Verification:
    """Checks the plan in a directory by exact kinematics and by a replay in plain MuJoCo.

    Args:
        directory: Holds ``plan.json``, ``plan.npz``, ``model.xml`` and ``timeline.zarr``, and what
            else the stages of the fold have left.
        module_size: Another size than the plan's own.
        progress: Told what is being checked.

    Raises:
        InputError: When a file is missing or cannot be read.
        TimelineError: When the timeline is missing or damaged.
    """
    try:
        try:
            # What damaged numbers come out as, infinite or none, is told as any other difference.
            with np.errstate(all="ignore"):
                return _verified(directory, module_size, progress)
        except UNREADABLE as error:
            raise InputError(
                "not-a-plan", f"plan.npz: what it says cannot be worked out ({error})."
            ) from error
    except (InputError, TimelineError) as error:
        changed = manifest.changed_fields(directory)
        if not changed:
            raise
        more = "" if len(changed) <= MOST_TOLD else f", and {len(changed) - MOST_TOLD} more"
        told = f"{error} Not as it was written: {'; '.join(changed[:MOST_TOLD])}{more}."
        if isinstance(error, InputError):
            raise InputError(error.code, told) from error
        raise TimelineError(told) from error


def _verified(directory: FilePath, module_size: float | None, progress: Report) -> Verification:
    found = _Findings()
    npz = read_values(directory / "plan.npz")
    text = read_values(directory / "plan.json")
    plan = Plan.of_values(npz, "plan.npz")
    found.look("plan.json and plan.npz say the same", _forms(plan, npz, text))
    earlier = npz["format"] in EARLIER
    timeline, frames = _timeline(directory / "timeline.zarr")
    found.look("timeline.zarr is of this chain", _of_chain(timeline, plan))
    try:
        record, playback = _results(plan, frames)
        if record is None and plan.explosion is not None:
            record = _kept_record(directory, plan)
    except (TypeError, AttributeError) as error:
        raise InputError(
            "not-a-plan", f"the results in plan.npz cannot be read ({error}); plan the fold again."
        ) from error
    if not earlier:
        found.look("plan.npz holds all that a plan has", _complete(plan, npz, record, playback))
    if playback is not None:
        found.look("timeline.zarr shows the plan's playback", _played(plan, playback))
        found.look(
            "the playback was simulated, or was not, as it says",
            _of_its_kind(plan, playback, earlier=earlier),
        )
    found.look(
        "the files of the stages say the same as the plan",
        _stages(directory, plan, npz, record, playback, found.notes),
    )
    parameters = _parameters(plan, module_size)
    found.look("parameters are those of the request", _asked(directory, plan, found.notes))
    certificate = certify(
        plan.chain, record, playback, parameters, start=plan.start, progress=progress
    )
    if not certificate.verified:
        found.problems.append(certificate.verdict)
    if module_size is None:
        simulated = playback is not None and playback.simulated
        alone = ", but for what only the simulation knew: torques, largest error between frames"
        told = _Told(plan, npz["certificate"], record, playback, earlier=earlier)
        found.look(
            f"the certificate's figures come out again{alone if simulated else ''}",
            told.differences(certificate, found.notes),
        )
    model = _text(directory / "model.xml")
    found.look("model.xml is the plan's model", _model(model, plan, found.notes, earlier=earlier))
    replayed = None
    if len(plan.time_s):
        stride = -(-len(plan.motion) * len(plan.chain) // MOST_REPLAYED)
        try:
            replayed = replay(plan, model, stride=stride)
        except InputError as error:
            found.problems.append(f"failed: model.xml: {error.detail}")
        else:
            where = "" if stride == 1 else f" at one frame in {stride}"
            found.look(
                f"plain MuJoCo has the same poses and finds no overlap{where}", _replayed(replayed)
            )
    changed = manifest.changed_fields(directory)
    if changed is None and not earlier:
        found.problems.append(
            f"failed: {manifest.FILE}: it is not there, expected the digests of all fields; copy "
            "it with the fold's other files."
        )
    elif changed is None:
        found.notes.append(
            f"There is no {manifest.FILE}, as earlier versions wrote none: what can't be worked "
            "out anew (seed, versions, wall times, figures.zarr, input) was not checked."
        )
    else:
        found.look(
            "every field of every file has the digest in manifest.json, figures.zarr (what plots "
            "show) by that alone",
            (f"{field}: it is not what was written" for field in changed),
        )
    return Verification(
        certificate=certificate,
        replay=replayed,
        checked=tuple(found.checked),
        problems=tuple(found.problems),
        notes=tuple(found.notes),
    )


class _Findings:
    """What was looked at, and what of it speaks against the plan."""

    def __init__(self) -> None:
        self.checked: list[str] = []
        self.problems: list[str] = []
        self.notes: list[str] = []

    def look(self, at: str, differences: Differences) -> None:
        self.checked.append(at)
        told = list(dict.fromkeys(differences))
        self.problems += [f"failed: {difference}" for difference in told[:MOST_TOLD]]
        if len(told) > MOST_TOLD:
            self.problems.append(f"failed: … and {len(told) - MOST_TOLD} more where {at}")


def _forms(plan: Plan, npz: dict[str, Any], text: dict[str, Any]) -> Differences:
    """Where the two forms of a plan differ, and where one of them contradicts itself."""
    other = Plan.of_values(text, "plan.json")
    earlier = npz["format"] in EARLIER
    arrays = {**motion_arrays(plan.motion), "max_error_rad": plan.max_error_rad}
    theirs = {**motion_arrays(other.motion), "max_error_rad": other.max_error_rad}
    if type(plan.motion) is not type(other.motion):
        yield "plan.json and plan.npz differ in what they hold of a frame"
        return
    for name, mine in arrays.items():
        if name != "joint_error_rad":  # which a plan has not
            both = f"plan.json and plan.npz differ in {name}"
            yield from array_difference(theirs[name], mine, both, atol=ROUNDED_WITHIN * earlier)
    columns = {*arrays, "plan", "angle_planes", "joint_error_rad"}
    mine, said = (
        {k: _plain(v) for k, v in values.items() if k not in columns} for values in (npz, text)
    )
    if isinstance(said.get("angles"), dict):
        said["angles"].pop("data", None)
    yield from value_differences(said, mine, _versus_plan("plan.json", "plan"))
    rest = plan.rest()
    derived = {name: rest[name] for name in ("chain", "start", "root_module")}
    derived["joint_names"] = list(plan.chain.joint_names)
    yield from value_differences({name: mine.get(name) for name in derived}, derived, "plan.npz")


def _complete(
    plan: Plan, npz: dict[str, Any], record: Record | None, playback: Playback | None
) -> Differences:
    """Where a plan of today lacks a field, or has one that there is not.

    What is left out would be read as an earlier version left it, and not be checked.
    """
    expected = {**plan.rest(), "joint_names": list(plan.chain.joint_names)}
    if playback is not None:
        expected["playback"] = playback.summary()
    if record is not None:
        expected["explosion"] = record.summary()
    columns = {*motion_arrays(plan.motion), "max_error_rad", "angle_planes"}
    mine = {name: _plain(value) for name, value in npz.items() if name not in columns}
    yield from value_differences(mine, json.loads(json.dumps(expected)), "plan.npz")
    if record is None and plan.explosion is not None:
        yield "record.npz: it is not there, so what plan.npz tells of it can't be worked out anew"


def _versus_plan(name: str, field: str) -> str:
    return f"{name} and plan.npz differ in {field}"


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return dict(cast("dict[str, Any]", value)) if isinstance(value, dict) else value


def _of_chain(timeline: Timeline, plan: Plan) -> Differences:
    if timeline.status != "complete":
        yield f"timeline.zarr: got the status {timeline.status}, expected complete"
    expected = chain_attributes(plan.chain)
    if timeline.windowed:
        del expected["joint_names"]  # which those of long chains leave out
    yield from value_differences(
        timeline.told_chain, expected, _versus_plan("timeline.zarr", "chain")
    )


def _timeline(path: FilePath) -> tuple[Timeline, Motion]:
    """A timeline and all of its frames.

    Raises:
        TimelineError: When it is missing or damaged.
    """
    try:
        timeline = Timeline.open(path)
        return timeline, timeline.motion()
    except UNREADABLE as error:
        raise TimelineError(f"{path.name} is damaged: {error}") from error


def _results(plan: Plan, frames: Motion) -> tuple[Record | None, Playback | None]:
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
                f"got {len(played)} frames of playback in timeline.zarr, expected "
                f"{len(plan.time_s)} as in plan.npz.",
            )
        if not np.array_equal(played.phase, plan.phase):
            raise InputError(
                "wrong-timeline", "the phases in timeline.zarr are not those of plan.npz."
            )
        if isinstance(plan.motion, Windows):
            if not isinstance(played, Windows) or not played.passes_as(plan.motion):
                raise InputError(
                    "wrong-timeline", "the playback in timeline.zarr is not the motion of plan.npz."
                )
            reference = None
        else:
            reference = plan.joint_angles_rad
        playback = Playback(frames=played, reference_rad=reference, **plan.playback)
    return record, playback


def _kept_record(directory: FilePath, plan: Plan) -> Record | None:
    """The record of a refold or a smoothed plan, whose timeline does not show it."""
    try:
        record = read_record(directory)
    except UNREADABLE as error:
        raise InputError("not-a-record", f"record.npz cannot be read: {error}") from error
    if record is None:
        return None
    figures = {k: v for k, v in (plan.explosion or {}).items() if k != "frames"}
    return Record(frames=record.frames, **figures)


def _played(plan: Plan, playback: Playback) -> Differences:
    """Where the frames of the playback in the timeline are not those of the plan."""
    played, motion = playback.frames, plan.motion
    columns = {"time_s": played.time_s - played.time_s[0] if len(played) else played.time_s}
    names = ("base_position", "base_wxyz") if isinstance(played, Windows) else _ROOT
    columns |= {name: getattr(played, name) for name in names}
    if isinstance(played, Frames) and not playback.simulated:
        columns["joint_angles_rad"] = played.joint_angles_rad
    both = "timeline.zarr and plan.npz differ in"
    for name, values in columns.items():
        yield from array_difference(values, getattr(motion, name), f"{both} {name}")
    if isinstance(played, Frames):
        largest = played.joint_error_rad.max(axis=1)
        yield from array_difference(
            largest, plan.max_error_rad, f"{both} max_error_rad", atol=SINGLE_WITHIN
        )
        if playback.simulated:
            yield from array_difference(
                played.joint_error_rad,
                np.abs(played.joint_angles_rad - plan.joint_angles_rad),
                "timeline.zarr joint_error_rad",
                atol=SINGLE_WITHIN,
            )


_ROOT: Final = ("root_position", "root_wxyz")


def _of_its_kind(plan: Plan, playback: Playback, *, earlier: bool) -> Differences:
    """Where a playback is not of the kind that it says, or has not the figures of that kind.

    Which kind it must be follows from the chain, what was recorded of it, and the parameters.
    """
    wanted = _preset(plan).explosion is not None
    if wanted != (plan.explosion is not None):
        need = "what came of it" if wanted else "null"
        yield f"plan.npz explosion: expected {need}, as of the preset {plan.preset}"
    direct = plan.explosion is None and isinstance(plan.motion, Frames)
    limit = int(_playback_number(plan, "dynamic_up_to"))
    simulated = direct or simulates(plan.chain, plan.motion, limit)
    kind = "dynamic" if simulated else "kinematic"
    yield from value_differences(playback.kind, kind, "plan.npz playback.kind")
    if simulated:
        yield from _simulated_figures(plan, playback, earlier=earlier)
    else:
        yield from _kinematic_figures(plan, playback, earlier=earlier)


def _simulated_figures(plan: Plan, playback: Playback, *, earlier: bool) -> Differences:
    """Where the figures of a simulation are not borne out by its frames."""
    yield from value_differences(playback.torque_frames, None, "plan.npz playback.torque_frames")
    if playback.status not in ("folded", "missed"):  # it broke off between two frames
        return
    most = float(np.nanmax(plan.max_error_rad, initial=0.0))
    if playback.status == "folded" and not most <= (playback.max_angle_error_rad or 0.0) * (
        1 + SINGLE_WITHIN
    ):
        yield f"plan.npz playback.max_angle_error_rad: got less than {most}, as a frame has"
    told = playback.summary()
    for name in ("rms_position_error", "max_angle_error_rad", "peak_torque", "rms_torque"):
        if told[name] is None:
            yield f"plan.npz playback.{name}: got null, expected a number, as it was simulated"
    if not earlier:
        steps = float(np.diff(plan.time_s).sum()) / _playback_number(plan, "step_s")
        if not abs(playback.steps - steps) <= STEPS_WITHIN:
            yield f"plan.npz playback.steps: got {playback.steps}, expected {steps:.9g}"
    played, reference = playback.frames, playback.reference_rad
    if not isinstance(played, Frames) or reference is None:
        return
    if not np.isfinite(played.joint_error_rad).all():
        yield "timeline.zarr joint_error_rad: got no numbers, expected those of a simulation"
    if np.diff(reference, axis=0).any() and np.array_equal(played.joint_angles_rad, reference):
        yield (
            "timeline.zarr joint_angles_rad: got those of plan.npz to the last digit, expected "
            "those of a simulation, which never are"
        )


def _kinematic_figures(plan: Plan, playback: Playback, *, earlier: bool) -> Differences:
    """Where the figures of a kinematic playback are not those of its frames."""
    torques = inverse_dynamics(plan.chain, playback.frames)
    looked = len(torques.frames)
    again: dict[str, Any] = {
        "peak_torque": torques.peak if looked else None,
        "rms_torque": torques.rms if looked else None,
    }
    if playback.torque_frames is not None or not earlier:
        again["torque_frames"] = looked
    if not earlier:  # earlier versions told errors of 0
        again |= {"status": "folded", "reason": "", "steps": 0}
        again |= {"rms_position_error": None, "max_angle_error_rad": None}
        none = np.full(len(plan.max_error_rad), np.nan)
        yield from array_difference(plan.max_error_rad, none, "plan.npz max_error_rad")
    told = playback.summary()
    yield from value_differences(
        {name: told[name] for name in again},
        again,
        "plan.npz playback",
        rtol=FIGURES_RTOL,
        atol=FIGURES_ATOL,
    )


def _playback_number(plan: Plan, name: str) -> float:
    """One of the plan's own parameters of playback.

    Raises:
        InputError: ``not-a-plan`` when it is no number above 0, ``unknown-preset``.
    """
    value = plan.parameters["playback"].get(name, getattr(_preset(plan).playback, name))
    return _checked_number(value, f"playback.{name}")


def _stages(
    directory: FilePath,
    plan: Plan,
    npz: dict[str, Any],
    record: Record | None,
    playback: Playback | None,
    notes: list[str],
) -> Differences:
    """Where what the stages left beside the plan does not say the same."""
    chain = chain_attributes(plan.chain)
    checks: dict[str, Callable[[], Differences]] = {
        "chain.json": lambda: value_differences(
            _json(directory / "chain.json"), chain, _versus_plan("chain.json", "chain")
        ),
        CANDIDATES: lambda: _among(directory, plan),
        "attempts.json": lambda: value_differences(
            _json(directory / "attempts.json"),
            list(plan.attempts),
            _versus_plan("attempts.json", "attempts"),
        ),
        "certificate.json": lambda: value_differences(
            _json(directory / "certificate.json"),
            npz["certificate"],
            _versus_plan("certificate.json", "certificate"),
        ),
        "playback.npz": lambda: _same_playback(directory, plan, playback),
        "record.npz": lambda: _same_record(directory, plan, record),
    }
    if plan.start is not None:
        start = chain_attributes(plan.start)
        checks[START_CHAIN] = lambda: value_differences(
            _json(directory / START_CHAIN), start, _versus_plan(START_CHAIN, "start")
        )
        checks[START_PLAN] = lambda: value_differences(
            chain_attributes(Plan.load(directory / START_PLAN).chain),
            start,
            _versus_plan(START_PLAN, "start"),
        )
    if plan.smoothing is not None:
        checks[RECORDED_PLAN] = lambda: value_differences(
            chain_attributes(Plan.load(directory / RECORDED_PLAN).chain),
            chain,
            _versus_plan(RECORDED_PLAN, "chain"),
        )
    for name, differences in checks.items():
        if not (directory / name).exists():
            if not (name in _RESULTS and getattr(plan, _RESULTS[name]) is None):
                notes.append(f"There is no {name}, so it was not compared with the plan.")
            continue
        try:
            yield from differences()
        except (*UNREADABLE, PlannerError) as error:
            yield f"{name}: it cannot be read ({error})"


_RESULTS: Final = {"playback.npz": "playback", "record.npz": "explosion"}


def _among(directory: FilePath, plan: Plan) -> Differences:
    """Whether the plan's chain is one of those that could be folded."""
    candidates = Candidates.load(directory)
    chain = chain_attributes(plan.chain)
    for candidate in candidates.chains:
        if chain_attributes(candidate) == chain:
            return
        if candidates.two_ended and chain_attributes(candidate.from_other_end()) == chain:
            return
    yield f"{CANDIDATES}: none of them is the chain of plan.npz"


def _same_playback(directory: FilePath, plan: Plan, playback: Playback | None) -> Differences:
    found = read_playback(directory)
    assert found is not None
    told = {name: value for name, value in found.summary().items() if name in (plan.playback or {})}
    yield from value_differences(
        told, plan.playback or {}, _versus_plan("playback.npz", "playback")
    )
    if playback is not None:
        yield from _same_motion(found.frames, playback.frames, "playback.npz")
        if found.reference_rad is not None:
            yield from array_difference(
                found.reference_rad,
                playback.reference,
                _versus_plan("playback.npz", "joint_angles_rad"),
            )


def _same_record(directory: FilePath, plan: Plan, record: Record | None) -> Differences:
    found = read_record(directory)
    assert found is not None
    yield from value_differences(
        found.summary(), plan.explosion or {}, _versus_plan("record.npz", "explosion")
    )
    if record is not None:
        yield from _same_motion(found.frames, record.frames, "record.npz")
    yield from _snapshots(found, plan)


def _snapshots(record: Record, plan: Plan) -> Differences:
    """Where the snapshots that a published playback follows are not those its frames are of."""
    told: Any = plan.parameters.get("explosion") or {}
    every, name = told.get("snapshot_interval"), "record.npz snapshots_rad"
    angles, frames = record.snapshots_rad, record.frames
    if every is None or isinstance(frames, Windows):
        if angles is not None:
            yield f"{name}: got some, expected none with these parameters"
        return
    shape = (record.steps // every + 2, len(plan.chain.folded_rad))
    if angles is None or (record.status == "straight" and angles.shape != shape):
        got = None if angles is None else angles.shape
        yield f"{name}: got the shape {got}, expected {shape}"
        return
    numbers = np.rint(frames.time_s / (every * told["step_s"])).astype(np.int64)
    numbers[-1] = len(angles) - 1
    if (np.diff(numbers) < 0).any() or numbers[0] < 0 or numbers.max() >= len(angles):
        yield f"{name}: the frames are not at its times"
        return
    yield from array_difference(angles[numbers], frames.joint_angles_rad, name, atol=STEP_RAD)
    held = np.searchsorted(numbers, np.arange(len(angles)), side="right") - 1
    far = np.abs(angles - frames.joint_angles_rad[held]).max(axis=1)
    if not (far <= KEPT_RAD + STEP_RAD).all():
        yield f"{name}[{int(np.argmax(~(far <= KEPT_RAD + STEP_RAD)))}]: it is far from its frame"


def _same_motion(got: Motion, expected: Motion, name: str) -> Differences:
    if type(got) is not type(expected):
        yield f"{name}: it holds frames of another kind than timeline.zarr"
        return
    theirs = motion_arrays(expected)
    both = f"{name} and timeline.zarr differ in"
    for column, values in motion_arrays(got).items():
        single = SINGLE_WITHIN if column == "joint_error_rad" else 0.0
        yield from array_difference(values, theirs[column], f"{both} {column}", atol=single)


def _parameters(plan: Plan, module_size: float | None) -> Parameters:
    """The plan's own parameters, as far as a certificate depends on them.

    Raises:
        InputError: ``not-a-plan`` when they are none, ``unknown-preset``.
    """
    names = ("module_size", "density_kg_m3", "joint_speed_limit_rad_s")
    plain = {
        name: _checked_number(plan.parameters[name], name)
        for name in names
        if name in plan.parameters
    }
    found = replace(_preset(plan), **plain)
    return found if module_size is None else replace(found, module_size=module_size)


def _preset(plan: Plan) -> Parameters:
    try:
        return preset(plan.preset)
    except InputError as error:
        raise named(error, "plan.npz") from None


def _checked_number(value: Any, name: str) -> float:
    """A parameter.

    Raises:
        InputError: ``not-a-plan`` when it is no number above 0.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and 0.0 < value < float("inf")):
        raise InputError(
            "not-a-plan",
            f"got {value!r} in parameters.{name} of plan.npz, expected a number above 0.",
        )
    return value


def _asked(directory: FilePath, plan: Plan, notes: list[str]) -> Differences:
    """Where the plan's parameters are not those that were asked for."""
    if not (directory / "request.json").exists():
        notes.append(
            "There is no request.json, so the plan's parameters were not compared with it."
        )
        return
    try:
        request = read_request(directory)
        request.check()
        parameters = request.parameters()
    except (*UNREADABLE, PlannerError) as error:
        yield f"request.json: it cannot be read ({error})"
        return
    told = {"seed": plan.seed, "preset": plan.preset}
    told |= {"refold": plan.start is not None, "smooth": plan.smoothing is not None}
    yield from value_differences(
        {n: getattr(request, n) for n in told}, told, _versus_plan("request.json", "request")
    )
    wanted = json.loads(json.dumps(parameters.as_dict()))
    here, made = versions().get("foldback"), plan.versions.get("foldback")
    different = value_differences(plan.parameters, wanted, "plan.npz parameters")
    if here == made:
        yield from different
    else:
        notes += [f"{each} of foldback {here}; the plan is of {made}." for each in different]


@dataclass(frozen=True, slots=True)
class _Told:
    """What a plan's certificate tells, and the motions that it tells of.

    Attributes:
        plan: The plan.
        certificate: Plain values of its certificate, as they were written.
        record, playback: What was looked at.
        earlier: Whether the plan is of an earlier format.
    """

    plan: Plan
    certificate: dict[str, Any]
    record: Record | None
    playback: Playback | None
    earlier: bool

    def differences(self, again: Certificate, notes: list[str]) -> Differences:
        """Where it is not what comes out anew; wall time aside."""
        mine, theirs = self.plan.certificate.as_dict(), again.as_dict()
        aside = {"seconds", *_LOOSE}
        loose = [*_LOOSE]
        if self.record is None and self.plan.explosion is not None:
            aside |= {"min_clearance_record", "max_angle_record_rad"}
            loose = [n for n in _LOOSE if n not in ("in_betweens", "min_clearance_record_at")]
            notes.append("There is no record.npz, so figures of the record were not compared.")
        if self.earlier and "simulated" not in self.certificate:
            # Earlier versions told the bound of the plan alone, told less of the rest,
            # and looked at other places in between.
            loose = [n for n in loose if n not in ("clearance_bound", "in_betweens")]
            loose = [name for name in loose if name in self.certificate]
            aside |= {f.name for f in fields(Certificate)} - set(self.certificate)
            notes.append(
                "The certificate is of an earlier version: it was compared in what it tells, but "
                "for clearance_bound and in_betweens."
            )
        names = [f.name for f in fields(Certificate) if f.name not in aside]
        yield from value_differences(
            {name: mine[name] for name in names},
            {name: theirs[name] for name in names},
            "plan.npz certificate",
            rtol=FIGURES_RTOL,
            atol=FIGURES_ATOL,
        )
        for name in loose:
            if not self._passes(name, again):
                yield from value_differences(
                    mine[name], theirs[name], f"plan.npz certificate.{name}"
                )
        yield from self._end(again)

    def _passes(self, name: str, again: Certificate) -> bool:
        """Whether a figure that another processor may find otherwise is as good as the new one."""
        mine, theirs = getattr(self.plan.certificate, name), getattr(again, name)
        if mine is None or theirs is None:
            return mine is theirs
        if name == "in_betweens":
            return abs(mine - theirs) <= 16 + IN_BETWEENS_RTOL * theirs
        if name == "clearance_bound":
            told = self.plan.certificate
            seen = [c for c in (told.min_clearance, told.min_clearance_playback) if c is not None]
            return mine <= min(seen, default=0.0) and mine <= theirs + BOUND_RTOL * abs(theirs)
        return mine == theirs or self._as_near(name, mine)

    def _as_near(self, name: str, place: Place) -> bool:
        """Whether the clearance at a place is the least one that is told of its motion."""
        told = getattr(self.plan.certificate, name.removesuffix("_at"))
        motion = self._motion(name)
        if motion is None or place.modules is None or told is None:
            return False
        i, j = sorted(place.modules)
        chain = self.plan.chain
        if not (0.0 <= place.frame <= len(motion) - 1 and i >= 0 and j < len(chain)):
            return False
        if j - i < chain.module.apart:
            return False
        size = self.plan.certificate.module_size
        found = clearance_at(chain, motion, place.frame, (i, j), size=size)
        return abs(found - told) <= PLACE_WITHIN

    def _motion(self, name: str) -> NDArray[np.float64] | Windows | None:
        if name == "min_clearance_at":
            return self.playback and self.playback.reference
        held = self.record if name == "min_clearance_record_at" else self.playback
        if held is None:
            return None
        return held.frames if isinstance(held.frames, Windows) else held.frames.joint_angles_rad

    def _end(self, again: Certificate) -> Differences:
        """Where the end of a simulation is not what the playback says of it."""
        playback = self.playback
        if playback is None or not playback.simulated or again.rms_position_error is None:
            return
        if playback.status in ("folded", "missed"):  # else it broke off between two frames
            yield from value_differences(
                playback.rms_position_error,
                again.rms_position_error,
                "plan.npz playback.rms_position_error",
                rtol=FIGURES_RTOL,
                atol=FIGURES_ATOL,
            )


_LOOSE: Final = (
    "in_betweens",
    "clearance_bound",
    "min_clearance_at",
    "min_clearance_playback_at",
    "min_clearance_record_at",
)
"""Figures that depend on the last digits: which of two like places is found, where to halve."""


def _model(text: str, plan: Plan, notes: list[str], *, earlier: bool) -> Differences:
    """Where the model is not the plan's; those of earlier versions excluded all neighbours."""
    exempt = set(plan.chain.module.exempt_pairs(len(plan.chain)))

    def needed(pair: re.Match[str]) -> str:
        i, j = sorted((int(pair[1]), int(pair[2])))
        return "" if j == i + 1 and (i, j) not in exempt else pair[0]

    if earlier and (fewer := NEIGHBOURS.sub(needed, text)) != text:
        text = fewer
        notes.append(
            "model.xml exempts neighbours from collision, as earlier versions did; the replay "
            "looked at them all the same."
        )
    try:
        size = _parameters(plan, None).module_size
        again = mjcf.mjcf(plan.chain, module_size=size, keys=mjcf.keys_of(plan))
        for difference in model_differences(text, again):
            yield f"model.xml: {difference}"
    except InputError as error:
        raise named(error, "model.xml") from None


def _replayed(found: Replay) -> Differences:
    if not found.pose_difference <= POSES_WITHIN:
        yield f"model.xml: poses differ from the plan's by {found.pose_difference:.2g} pitch"
    if not found.overlap <= OVERLAP_WITHIN:
        yield (
            f"plan.npz: MuJoCo finds an overlap of {found.overlap:.2g} pitch at frame "
            f"{found.overlap_frame:g}"
        )


def _json(path: FilePath) -> Any:
    return json.loads(path.read_bytes())


def _text(path: FilePath) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("not-a-model", f"{path.name} cannot be read: {error}") from error
