"""Repeated computations: the simulated robots, the curves of the plots and the moments of a fold.

Each takes a few seconds for folds of ordinary size; for larger ones they are left out, and a note
says so.
"""

from __future__ import annotations

from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from foldback.planner.certificate.figures_store import Curves
from foldback.planner.certificate.frame_figures import write_figures
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.errors import UNREADABLE, InputError, PlannerError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.explosion import MUJOCO
from foldback.planner.pipeline.derived_files import write_verdict
from foldback.planner.pipeline.fold_layout import judged_module
from foldback.planner.pipeline.playing_back import play_back
from foldback.planner.pipeline.search import Watch, is_smoothing
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.moment_search import moments_of
from foldback.planner.plan.plan import Plan, versions
from foldback.planner.plan.steps import find_steps
from foldback.planner.plan.value_differences import (
    RECOMPUTED_RTOL,
    Differences,
    array_difference,
    figure_differences,
    value_differences,
)
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.robot_runs import mujoco_seconds
from foldback.planner.smoothing.smoothed_plan import before_and_after
from foldback.planner.storage.file_names import (
    FIGURES,
    FORCES,
    MOMENTS,
    PLAYBACK,
    RECORD,
    RECORDED_PLAN,
    REQUEST,
    TIMELINE,
    VERDICT_FILES,
)
from foldback.planner.storage.files import json_of
from foldback.planner.verification.origin import own_attempt
from foldback.planner.verification.plan_parameters import plan_parameters

SAME_SIMULATION_RAD: Final = 2e-5
"""Maximum difference between the angles of a simulated robot and those of its repetition, rad. On
another processor, an encoder may round the other way; the robots' errors are ten times larger."""
MAX_REPEATED_S: Final = 5.0
"""Maximum estimated time of the processor, s, of robots in MuJoCo that are simulated again."""
RECOMPUTED_CURVES: Final = ("min_clearance", "peak_torque_nm", "max_error_rad", "hinges_moving")
"""Curves of the plots that are computed again. Which of several modules is the nearest depends on
rounding."""


def why_not_repeated(directory: FilePath, plan: Plan, playback: Playback) -> str | None:
    """Return the reason why the simulation of a playback is not repeated; None if it is."""
    for name in (REQUEST, PLAYBACK, *([] if plan.explosion is None else [RECORD])):
        if not (directory / name).exists():
            return f"there is no {name}"
    robots = playback.robots or 1
    size = len(plan.chain) * playback.steps * robots
    if not 0 <= size <= 4_000_000:  # 160 modules take 0.8 million, and 2 s
        return "it would take too long"
    is_by_mujoco = plan.parameters["playback"].get("robot", {}).get("engine") == MUJOCO
    hinges = len(plan.chain.folded_rad)
    if is_by_mujoco and robots * mujoco_seconds(hinges, playback.steps) > MAX_REPEATED_S:
        return "it would take too long"
    for name in ("foldback", "mujoco"):
        installed, plan_version = versions().get(name), plan.versions.get(name)
        if installed != plan_version:
            return f"the plan was made with {name} {plan_version}, and this is {name} {installed}"
    return None


def robots_differ(directory: FilePath, plan: Plan, playback: Playback) -> Differences:
    """Yield the differences of the simulated robots from those of a repeated simulation."""
    workspace = Workspace(directory)
    try:
        request, record = workspace.read_request(), workspace.read_record()
        number = own_attempt(plan)
        attempt = {} if number is None else plan.attempts[number]
        repeated = play_back(
            plan.chain,
            record,
            request.parameters(plan.chain.module, smoothed=is_smoothing(record)),
            Watch(),
            seed=plan.seed,
            finer=int(attempt.get("finer", 1)),
            patience=int(attempt.get("patience", 0)),
            unfolding=workspace.read_unfolding(request),
        )
    except (*UNREADABLE, PlannerError) as error:
        yield f"{PLAYBACK}: the simulation cannot be repeated ({error})"
        return
    if repeated is None:
        yield f"{PLAYBACK}: got a playback, expected none after this explosion"
        return
    message = f"{PLAYBACK} and a repeated simulation differ in"
    stated, recomputed = playback.summary(), repeated.summary()
    for name in ("status", "steps", "kind", "robots"):
        yield from value_differences(stated[name], recomputed[name], f"{message} {name}")
    for name in ("rms_position_error", "max_angle_error_rad", "peak_torque", "rms_torque"):
        yield from value_differences(
            stated[name],
            recomputed[name],
            f"{message} {name}",
            rtol=0.05,
            atol=SAME_SIMULATION_RAD,
        )
    for name in ("angles_rad", "reference_rad", "others_rad", "mujoco_rad"):
        of = [
            result.frames.angles_rad if name == "angles_rad" else getattr(result, name)
            for result in (playback, repeated)
        ]
        if of[0] is None or of[1] is None:
            if of[0] is not of[1]:
                yield f"{message} {name}: only one of them has this array"
            continue
        yield from array_difference(of[0], of[1], f"{message} {name}", atol=SAME_SIMULATION_RAD)


def forces_differ(directory: FilePath, recomputed: TableForces) -> Differences:
    """Yield the differences of the torques on a table from those of a certificate computed again.

    Several equilibria may have the same largest torque, so only that is compared.
    """
    try:
        stored = TableForces.load(directory / FORCES)
    except InputError as error:
        yield error.detail
        return
    if stored.torque.shape != recomputed.torque.shape or not np.allclose(
        stored.torque,
        recomputed.torque,
        rtol=RECOMPUTED_RTOL,
        atol=RECOMPUTED_RTOL,
        equal_nan=True,
    ):
        yield f"{FORCES} torque: these are not the largest torques of the frames"


def smoothing_differs(directory: FilePath, plan: Plan) -> Differences:
    """Yield the differences of the figures before and after smoothing from those computed again."""
    try:
        recomputed = before_and_after(Plan.load(directory / RECORDED_PLAN), plan)
    except (*UNREADABLE, PlannerError) as error:
        yield f"plan.npz smoothing: its figures cannot be computed again ({error})"
        return
    yield from figure_differences(plan.smoothing, recomputed, "plan.npz smoothing")


def plots_differ(directory: FilePath, plan: Plan, notes: list[str]) -> Differences:
    """Yield the differences of moments and plots from those computed again from the timeline.

    Args:
        directory: Directory of the fold.
        plan: The plan.
        notes: Receives a note if the fold is too long.
    """
    stored = [name for name in (MOMENTS, FIGURES) if (directory / name).exists()]
    if not stored:
        return
    timeline = Timeline.open(directory / TIMELINE)
    # 160 modules have 0.16 million, which take 0.5 s
    if len(timeline) * len(plan.chain) > 2_000_000:
        notes.append(
            f"{' and '.join(stored)} were compared only with their digests, because the fold is "
            "long."
        )
        return
    try:
        with TemporaryDirectory(prefix="foldback-verify-") as place:
            recomputed_path = FilePath(place) / FIGURES
            write_figures(
                directory / TIMELINE,
                recomputed_path,
                plan_parameters(plan, None),
                certificate=plan.certificate,
                plan=plan.motion,
            )
            if FIGURES in stored:
                yield from _curves_differ(directory / FIGURES, recomputed_path)
            if MOMENTS in stored:
                yield from _moments_differ(directory, timeline, plan, recomputed_path)
    except (*UNREADABLE, PlannerError) as error:
        yield f"{' and '.join(stored)} cannot be computed again ({error})"


def verdict_differs(directory: FilePath) -> Differences:
    """Yield the differences of the verdict on the figure of a fold from one computed again."""
    names = " and ".join(VERDICT_FILES)
    if judged_module(directory) is None:
        yield f"{names}: the figure of this fold is not one that gets a verdict"
        return
    try:
        with TemporaryDirectory(prefix="foldback-verify-") as place:
            write_verdict(directory, FilePath(place))
            for name in VERDICT_FILES:
                expected = json_of(FilePath(place) / name)
                yield from value_differences(json_of(directory / name), expected, name)
    except (*UNREADABLE, PlannerError) as error:
        yield f"{names} cannot be computed again ({error})"


def _curves_differ(stored: FilePath, recomputed: FilePath) -> Differences:
    """Yield the differences of the curves of the plots."""
    stored_curves, recomputed_curves = Curves.load(stored), Curves.load(recomputed)
    for name in RECOMPUTED_CURVES:
        actual, expected = (
            np.asarray(getattr(curves, name), dtype=np.float64)
            for curves in (stored_curves, recomputed_curves)
        )
        if actual.shape != expected.shape or not np.allclose(
            actual,
            expected,
            rtol=1e-4,
            atol=1e-6,
            equal_nan=True,  # they are in single precision
        ):
            yield f"{FIGURES} {name}: the curve is not that of the timeline"


def _moments_differ(
    directory: FilePath, timeline: Timeline, plan: Plan, figures: FilePath
) -> Differences:
    """Yield the differences of the moments."""
    recomputed = moments_of(
        timeline,
        module_size=plan.certificate.module_size,
        figures=figures,
        forces=directory / FORCES,
        direct=(directory / RECORD).exists(),
        steps=find_steps(plan),
    )
    stated: dict[str, Any] = json_of(directory / MOMENTS)
    expected = {} if recomputed is None else recomputed.as_dict()
    yield from value_differences(stated, expected, MOMENTS)
