"""Consistency of a plan's file: it is complete, and a ``plan.json`` beside it is equal."""

from __future__ import annotations

import json
from typing import Any, cast

import numpy as np

from foldback.planner.motion.record import Record
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import (
    Differences,
    array_difference,
    value_differences,
    versus_plan,
)
from foldback.planner.playback.playback import Playback
from foldback.planner.storage.file_names import PLAN, PLAN_TEXT


def formats_differ(plan: Plan, npz: dict[str, Any], text: dict[str, Any]) -> Differences:
    """Yield the differences of the two forms of a plan."""
    text_plan = Plan.of_values(text, PLAN_TEXT)
    arrays = {**plan.motion.columns(), "max_error_rad": plan.max_error_rad}
    text_columns = {**text_plan.motion.columns(), "max_error_rad": text_plan.max_error_rad}
    if plan.motion.layout != text_plan.motion.layout:
        yield "plan.json and plan.npz store their frames in different layouts"
        return
    for name, values in arrays.items():
        if name != "joint_error_rad":  # which a plan has not
            message = f"plan.json and plan.npz differ in {name}"
            yield from array_difference(text_columns[name], values, message)
    columns = {*arrays, "plan", "angle_planes", "joint_error_rad"}
    values, text_values = (
        {k: _plain(v) for k, v in values.items() if k not in columns} for values in (npz, text)
    )
    if isinstance(text_values.get("angles"), dict):
        text_values["angles"].pop("data", None)
    yield from value_differences(text_values, values, versus_plan(PLAN_TEXT, "plan"))


def contradictions(plan: Plan, npz: dict[str, Any]) -> Differences:
    """Yield the differences of values in a plan's file from those that follow from its chain."""
    remainder = plan.rest()
    derived = {name: remainder[name] for name in ("chain", "start", "root_module")}
    derived["joint_names"] = list(plan.chain.joint_names)
    stated = {name: _plain(npz.get(name)) for name in derived}
    yield from value_differences(stated, derived, PLAN)


def lacking(
    plan: Plan, npz: dict[str, Any], record: Record | None, playback: Playback | None
) -> Differences:
    """Yield the fields that a plan lacks, and those that it should not have."""
    expected = {**plan.rest(), "joint_names": list(plan.chain.joint_names)}
    if playback is not None:
        expected["playback"] = playback.summary()
    if record is not None:
        expected["explosion"] = record.summary()
    columns = {*plan.motion.columns(), "max_error_rad", "angle_planes"}
    actual = {name: _plain(value) for name, value in npz.items() if name not in columns}
    yield from value_differences(actual, json.loads(json.dumps(expected)), PLAN)
    if record is None and plan.explosion is not None:
        yield "record.npz is missing, so the figures of the explosion in plan.npz cannot be checked"


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return dict(cast("dict[str, Any]", value)) if isinstance(value, dict) else value
