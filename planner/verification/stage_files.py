"""Files of the stages: a comparison of the files beside a plan with the plan."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from foldback.planner.chain.chain_attributes import chain_attributes
from foldback.planner.errors import UNREADABLE, PlannerError
from foldback.planner.explosion.published_explosion import FRAME_SPACING_RAD
from foldback.planner.motion.angle_encoding import PLAN_STEP_RAD
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import (
    SINGLE_PRECISION_ATOL_RAD,
    Differences,
    array_difference,
    value_differences,
    versus_plan,
)
from foldback.planner.storage import file_names as names

Check = Callable[[], Differences]


def stage_files_differ(
    directory: FilePath,
    plan: Plan,
    npz: dict[str, Any],
    record: Record | None,
    notes: list[str],
) -> Differences:
    """Yield the differences of the stages' files from the plan."""
    checks = _text_checks(directory, plan, npz) | {
        names.PLAYBACK: lambda: _same_playback(directory, plan),
        names.RECORD: lambda: _same_record(directory, plan, record),
    }
    for name in checks:
        if not (directory / name).exists() and not (
            name in _RESULT_FILES and getattr(plan, _RESULT_FILES[name]) is None
        ):
            notes.append(f"There is no {name}, so it was not compared with the plan.")
    yield from _found_differences(directory, checks)


def stage_texts_differ(directory: FilePath, plan: Plan, npz: dict[str, Any]) -> Differences:
    """Yield the differences of the stages' files from the plan, as far as no motion is compared.

    The wall times in the records tell apart two runs of the same fold.
    """

    def same_time(name: str, figures: dict[str, Any]) -> Check:
        message = versus_plan(name, "seconds")
        return lambda: value_differences(
            _seconds(directory / name), figures.get("seconds"), message
        )

    checks = _text_checks(directory, plan, npz) | {
        names.PLAYBACK: same_time(names.PLAYBACK, plan.playback or {}),
        names.RECORD: same_time(names.RECORD, plan.explosion or {}),
    }
    yield from _found_differences(directory, checks)


def _text_checks(directory: FilePath, plan: Plan, npz: dict[str, Any]) -> dict[str, Check]:
    """Return the comparisons of files without motions, by the file's name."""

    def states(name: str, field: str, expected: Any) -> Check:
        message = versus_plan(name, field)
        return lambda: value_differences(_stated(directory / name), expected, message)

    chain = chain_attributes(plan.chain)
    checks = {
        names.CHAIN: states(names.CHAIN, "chain", chain),
        names.CANDIDATES: lambda: _among(directory, plan),
        names.ATTEMPTS: states(names.ATTEMPTS, "attempts", list(plan.attempts)),
        names.CERTIFICATE: states(names.CERTIFICATE, "certificate", npz["certificate"]),
    }
    if plan.start is not None:
        for name in (names.START_CHAIN, names.START_PLAN):
            checks[name] = states(name, "start", chain_attributes(plan.start))
    if plan.smoothing is not None:
        checks[names.RECORDED_PLAN] = states(names.RECORDED_PLAN, "chain", chain)
    return checks


def _found_differences(directory: FilePath, checks: Mapping[str, Check]) -> Differences:
    """Yield the differences of those files that are there."""
    for name, differences in checks.items():
        try:
            if (directory / name).exists():
                yield from differences()
        except (*UNREADABLE, PlannerError) as error:
            yield f"{name} cannot be read ({error})"


def _seconds(path: FilePath) -> float:
    """Return the wall time of a stage, s, without its frames."""
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return float(file["seconds"].item())


_RESULT_FILES: Final = {names.PLAYBACK: "playback", names.RECORD: "explosion"}


def _among(directory: FilePath, plan: Plan) -> Differences:
    """Yield a difference if the plan's chain is none of the candidates."""
    candidates = Workspace(directory).read_candidates()
    chain = chain_attributes(plan.chain)
    for candidate in candidates.chains:
        if chain_attributes(candidate) == chain:
            return
        if candidates.two_ended and chain_attributes(candidate.from_other_end()) == chain:
            return
    yield f"{names.CANDIDATES}: none of the candidate chains is the chain of plan.npz"


def _same_playback(directory: FilePath, plan: Plan) -> Differences:
    stored = Workspace(directory).read_playback()
    assert stored is not None
    stated = {
        name: value for name, value in stored.summary().items() if name in (plan.playback or {})
    }
    yield from value_differences(
        stated, plan.playback or {}, versus_plan(names.PLAYBACK, "playback")
    )


def _same_record(directory: FilePath, plan: Plan, record: Record | None) -> Differences:
    stored = Workspace(directory).read_record()
    assert stored is not None
    yield from value_differences(
        stored.summary(), plan.explosion or {}, versus_plan(names.RECORD, "explosion")
    )
    if record is not None:
        # A timeline holds one layout: that of a fold on a table is dense once it is played back.
        frames = stored.frames.in_layout_of(record.frames, plan.chain)
        yield from _same_motion(frames, record.frames, names.RECORD)
    yield from _snapshots(stored, plan)


def _snapshots(record: Record, plan: Plan) -> Differences:
    """Yield the differences of the snapshots of a published playback from its frames."""
    limits: Any = plan.parameters.get("explosion") or {}
    every, name = limits.get("snapshot_interval"), "record.npz snapshots_rad"
    angles, frames = record.snapshots_rad, record.frames
    if every is None or frames.is_windowed:
        if angles is not None:
            yield f"{name}: got snapshots, expected none with these parameters"
        return
    shape = (record.steps // every + 2, len(plan.chain.folded_rad))
    if angles is None or (record.status == "straight" and angles.shape != shape):
        shape_found = None if angles is None else angles.shape
        yield f"{name}: got the shape {shape_found}, expected {shape}"
        return
    numbers = np.rint(frames.time_s / (every * limits["step_s"])).astype(np.int64)
    numbers[-1] = len(angles) - 1
    if (np.diff(numbers) < 0).any() or numbers[0] < 0 or numbers.max() >= len(angles):
        yield f"{name}: the times of the snapshots are not those of the frames"
        return
    yield from array_difference(angles[numbers], frames.joint_angles_rad, name, atol=PLAN_STEP_RAD)
    snapshot = np.searchsorted(numbers, np.arange(len(angles)), side="right") - 1
    far = np.abs(angles - frames.joint_angles_rad[snapshot]).max(axis=1)
    near = far <= FRAME_SPACING_RAD + PLAN_STEP_RAD
    if not near.all():
        yield f"{name}[{int(np.argmax(~near))}] differs too much from the last frame before it"


def _same_motion(actual: Motion, expected: Motion, name: str) -> Differences:
    if actual.layout != expected.layout:
        yield f"{name}: its frames and those of the timeline have different layouts"
        return
    expected_columns = expected.columns()
    message = f"{name} and the timeline differ in"
    for column, values in actual.columns().items():
        single = SINGLE_PRECISION_ATOL_RAD if column == "joint_error_rad" else 0.0
        if column not in expected_columns:
            yield f"{message} {column}: only {name} has this array"
            continue
        yield from array_difference(
            values, expected_columns[column], f"{message} {column}", atol=single
        )


def _stated(path: FilePath) -> Any:
    """Return the values of a JSON file, or the chain of another plan."""
    if path.suffix == ".npz":
        return chain_attributes(Plan.load(path).chain)
    return json.loads(path.read_bytes())
