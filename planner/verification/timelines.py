"""Timelines of plans: a comparison of the timeline with the plan, and its results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from foldback.planner.chain.chain_attributes import chain_attributes
from foldback.planner.errors import UNREADABLE, InputError, TimelineError
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import (
    SINGLE_PRECISION_ATOL_RAD,
    Differences,
    array_difference,
    value_differences,
    versus_plan,
)
from foldback.planner.playback.playback import Playback
from foldback.planner.reasons import Reason
from foldback.planner.storage.file_names import PLAN, TIMELINE
from foldback.planner.verification.plan_parameters import is_on_table, plan_parameters


def chain_differs(timeline: Timeline, plan: Plan) -> Differences:
    """Yield the differences of a timeline from a closed one of the plan's chain."""
    stuck = plan.explosion is not None and plan.explosion["status"] != "straight"
    status = "failed" if stuck else "complete"
    if timeline.status != status:
        yield f"the timeline: got the status {timeline.status}, expected {status}"
    expected = chain_attributes(plan.chain)
    if timeline.windowed:
        del expected["joint_names"]  # which those of long chains leave out
    yield from value_differences(timeline.chain_data, expected, versus_plan(TIMELINE, "chain"))


def opened(path: FilePath) -> tuple[Timeline, Motion]:
    """Open a timeline and read all of its frames.

    Raises:
        TimelineError: It is missing or damaged.
    """
    try:
        timeline = Timeline.open(path)
        return timeline, timeline.motion()
    except UNREADABLE as error:
        raise TimelineError(f"{path.name} is damaged: {error}") from error


def results(plan: Plan, frames: Motion) -> tuple[Record | None, Playback | None]:
    """Build record and playback from a plan's figures and its timeline's frames.

    Raises:
        InputError: ``wrong-timeline`` if the frames are not those of the plan.
    """
    record = playback = None
    # The timeline of a refold, and of a smoothed plan, shows only what was made of the record.
    is_from_plan = plan.start is not None or plan.smoothing is not None
    exploded = frames[np.flatnonzero(frames.phase == PHASES.index("explosion"))]
    if plan.explosion is not None and (not is_from_plan or len(exploded)):
        record = Record(frames=exploded, **_arguments(plan.explosion))
    if plan.playback is not None:
        played = frames[np.flatnonzero(frames.phase != PHASES.index("explosion"))]
        if len(played) != len(plan.time_s):
            raise InputError(
                "wrong-timeline",
                f"got {len(played)} frames of playback in the timeline, expected "
                f"{len(plan.time_s)} as in plan.npz.",
            )
        if not np.array_equal(played.phase, plan.phase):
            raise InputError(
                "wrong-timeline", "the phases in the timeline are not those of plan.npz."
            )
        simulated = plan.playback.get("kind") == "dynamic"
        if plan.motion.is_windowed:
            agrees = played.has_windows_of if simulated else played.passes_as
            if not agrees(plan.motion):
                raise InputError(
                    "wrong-timeline", "the playback in the timeline is not the motion of plan.npz."
                )
        kinematic = plan.motion.is_windowed and not simulated
        reference = None if kinematic else plan.motion.stored_angles_rad
        playback = Playback(frames=played, reference_rad=reference, **_arguments(plan.playback))
    return record, playback


def with_other_robots(
    directory: FilePath, playback: Playback | None, notes: list[str]
) -> Playback | None:
    """Return the playback with those of other robots, which only ``playback.npz`` holds.

    Raises:
        InputError: ``not-a-playback``.
    """
    if playback is None or not playback.simulated:
        return playback
    try:
        stored = Workspace(directory).read_playback()
    except UNREADABLE as error:
        raise InputError("not-a-playback", f"playback.npz cannot be read: {error}") from error
    if stored is None:
        notes.append(
            "There is no playback.npz, so only the playback of the robot with the largest joint "
            "error was checked."
        )
        return playback
    return replace(
        playback,
        others_rad=stored.others_rad,
        mujoco_rad=stored.mujoco_rad,
        mujoco_robot=stored.mujoco_robot,
    )


def kept_record(directory: FilePath, plan: Plan) -> Record | None:
    """Read the record of a refold or a smoothed plan, whose timeline does not show it."""
    try:
        record = Workspace(directory).read_record()
    except UNREADABLE as error:
        raise InputError("not-a-record", f"record.npz cannot be read: {error}") from error
    if record is None:
        return None
    return Record(frames=record.frames, **_arguments(plan.explosion or {}))


def _arguments(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return figures of a record or a playback as arguments of its constructor.

    Raises:
        TypeError: The reason is none.
    """
    arguments = {name: value for name, value in figures.items() if name != "frames"}
    if "reason" in arguments:
        arguments["reason"] = Reason.from_dict(arguments["reason"])
    return arguments


def playback_differs(plan: Plan, playback: Playback) -> Differences:
    """Yield the differences of the playback in the timeline from that of the plan."""
    played, motion = playback.frames, plan.motion
    message = "the timeline and plan.npz differ in"
    columns = played.columns() | {"time_s": played.time_s - played.time_s[:1]}
    planned = motion.columns()
    names = [name for name in ("time_s", *_ROOT, "base_position", "base_wxyz") if name in columns]
    if is_on_table(plan) and not played.is_windowed:
        yield from _root_differs(plan, motion, played)
        names = ["time_s"]
    if not played.is_windowed and not playback.simulated:
        names.append("joint_angles_rad")
    for name in names:
        yield from array_difference(columns[name], planned[name], f"{message} {name}")
    yield from array_difference(
        played.largest_errors,
        plan.max_error_rad,
        f"{message} max_error_rad",
        atol=SINGLE_PRECISION_ATOL_RAD,
    )
    if not playback.simulated:
        return
    name, errors = "errors_rad", played.errors
    if not played.is_windowed:
        name, errors = "joint_error_rad", played.joint_error_rad
    expected = np.abs(played.angles_rad - motion.angles_rad).reshape(errors.shape)
    yield from array_difference(
        errors, expected, f"the timeline's {name}", atol=SINGLE_PRECISION_ATOL_RAD
    )


def _root_differs(plan: Plan, motion: Motion, played: Motion) -> Differences:
    """Yield the differences of the root of a chain on a table from the pose by its base.

    The first module of a clamped chain has its folded pose, in the plan and in the playback. The
    drift of a chain that lies free is known from the simulation alone: the plan follows it.
    """
    is_clamped = plan_parameters(plan, None).table.held
    followed = played.planned(plan.chain, motion, clamped=is_clamped)
    meant = [(PLAN, motion, followed)]
    drift = "a chain that drifts like the playback"
    if is_clamped:
        meant.append((TIMELINE, played, played.clamped(plan.chain)))
        drift = "a chain whose first module is clamped"
    for file, frames, expected in meant:
        for name in _ROOT:
            yield from array_difference(
                getattr(frames, name),
                getattr(expected, name),
                f"for {drift}: {file} {name}",
                atol=1e-6,  # rounding
            )


_ROOT: Final = ("root_position", "root_wxyz")
