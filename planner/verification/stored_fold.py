"""Stored fold: reads the plan in a fold's directory if all files there are of the same fold."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np

from foldback.planner.chain.chain_attributes import chain_attributes
from foldback.planner.chain.display_names import escaped
from foldback.planner.errors import UNREADABLE, InputError, TimelineError
from foldback.planner.motion.motion import PHASES
from foldback.planner.motion.timeline import EARLIER, Timeline, is_earlier
from foldback.planner.pipeline import manifest
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.plan.plan import Plan, read_values
from foldback.planner.plan.value_differences import Differences, array_difference, value_differences
from foldback.planner.storage import file_names as names
from foldback.planner.storage.output_directory import finish_replacement
from foldback.planner.verification.plan_consistency import contradictions, formats_differ
from foldback.planner.verification.plan_parameters import request_differs
from foldback.planner.verification.stage_files import stage_texts_differ
from foldback.planner.verification.timelines import chain_differs

COMPARED: Final = (
    *(names.INPUT, names.REQUEST, names.START_CHAIN, names.CANDIDATES, names.CHAIN),
    *(names.ATTEMPTS, names.CERTIFICATE, names.TIMELINE, names.MODEL, names.MOMENTS),
)
"""Files whose digests are compared with the manifest each time that a fold is read; others take
longer."""
CONTROL_CHARACTERS: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Matches characters that steer a terminal; no text of a plan has any."""
REMEDY: Final = (
    "Copy all files of one fold into the folder, or fold the shape again; `foldback verify` lists "
    "all differences."
)


def read_fold(directory: FilePath) -> Plan:
    """Return the plan in a fold's directory.

    Raises:
        InputError: ``no-plan`` without a plan, or as ``check_fold``.
    """
    plan = check_fold(directory)
    if plan is None:
        raise InputError(
            "no-plan",
            "got a folder without plan.npz, expected a folder that `foldback fold` wrote.",
            where=str(directory),
        )
    return plan


def check_fold(directory: FilePath) -> Plan | None:
    """Check that the files in a fold's directory are of the same fold; missing ones may be missing.

    Returns:
        The plan; None if there is none, as where a fold was cancelled.

    Raises:
        InputError: ``mixed-fold`` if files differ, ``not-a-plan`` or ``damaged-fold`` if one cannot
            be read, ``earlier-version`` for a fold of an earlier version of foldback.
    """
    finish_replacement(directory)
    if is_earlier(directory):
        raise InputError("earlier-version", EARLIER, where=str(directory))
    try:
        with np.errstate(all="ignore"):
            stored = _read_plan(directory)
            difference = next(_differences(directory, stored), None)
    except (TimelineError, *UNREADABLE) as error:
        raise InputError("damaged-fold", f"{error} {REMEDY}", where=str(directory)) from error
    if difference is not None:
        raise InputError(
            "mixed-fold",
            f"the files in this folder are not of one fold, or one was changed: {difference}. "
            f"{REMEDY}",
            where=str(directory),
        )
    return None if stored is None else stored[0]


def _read_plan(directory: FilePath) -> tuple[Plan, dict[str, Any]] | None:
    """Return the plan in a directory and the values in its file; None if there is none."""
    for name in (names.PLAN, names.PLAN_TEXT):
        if (directory / name).exists():
            values = read_values(directory / name)
            return Plan.of_values(values, name), values
    return None


def _differences(directory: FilePath, stored: tuple[Plan, dict[str, Any]] | None) -> Differences:
    """Yield the differences of a fold's files."""
    if stored is not None:
        plan, values = stored
        yield from (
            f"a text of the plan has control characters ({escaped(text)})"
            for text in _texts(plan.rest())
            if CONTROL_CHARACTERS.search(text)
        )
        yield from contradictions(plan, values)
        if all((directory / name).exists() for name in (names.PLAN, names.PLAN_TEXT)):
            yield from formats_differ(plan, values, read_values(directory / names.PLAN_TEXT))
        yield from stage_texts_differ(directory, plan, values)
        if (directory / names.REQUEST).exists():
            yield from request_differs(directory, plan, [])
        if (directory / names.TIMELINE).exists():
            yield from _timeline_differs(Timeline.open(directory / names.TIMELINE), plan)
    else:
        yield from _chains_differ(directory)
    for field in manifest.changed_fields(directory, COMPARED, arrays=False) or ():
        if not field.endswith(manifest.MISSING):
            yield f"{field} was changed"


def _texts(values: Any) -> Iterator[str]:
    """Yield all texts among plain values, keys included."""
    if isinstance(values, str):
        yield values
    elif isinstance(values, Mapping):
        for key, value in cast("Mapping[str, Any]", values).items():
            yield key
            yield from _texts(value)
    elif isinstance(values, list | tuple):
        for value in cast("list[Any]", values):
            yield from _texts(value)


def _timeline_differs(timeline: Timeline, plan: Plan) -> Differences:
    """Yield the differences of a timeline from a plan, as far as no angles are compared."""
    yield from chain_differs(timeline, plan)
    if plan.playback is not None:
        times_s, phases = timeline.clock()
        played_s = times_s[phases != PHASES.index("explosion")]
        yield from array_difference(
            played_s - played_s[:1], plan.time_s, "the timeline and plan.npz differ in time_s"
        )


def _chains_differ(directory: FilePath) -> Differences:
    """Yield the differences of the chain in the timeline of a fold without a plan."""
    chain, timeline = (result_path(directory, name) for name in (names.CHAIN, names.TIMELINE))
    if chain.exists() and timeline.exists():
        stated = json.loads(chain.read_bytes())
        attributes = chain_attributes(Timeline.open(timeline).chain)
        yield from value_differences(
            attributes, stated, f"the timeline and {names.CHAIN} differ in chain"
        )
