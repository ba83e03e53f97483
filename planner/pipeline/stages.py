"""Stages of a fold, each restartable, over one directory.

A stage reads the files of earlier stages and writes its own aside before renaming them, so that a
file that is there is whole. The service runs each stage in a process of its own; the command line
and the library run them one after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from planner.certificate.certificate import Certificate, certify
from planner.certificate.measure import write_figures
from planner.certificate.table import table_certificate
from planner.chain.chain import Chain
from planner.explosion.strategies import on_lattice, strategies_for
from planner.exports import mjcf
from planner.files import write_whole
from planner.motion.frames import PHASES
from planner.motion.record import Record
from planner.motion.timeline import TimelineWriter
from planner.motion.windows import Windows
from planner.pipeline import attempts, manifest
from planner.pipeline.attempt import Candidates
from planner.pipeline.explode_stage import choice_of, explode_stage
from planner.pipeline.fold_layout import (
    CLEARANCES,
    DESCRIBED,
    EXPORTED,
    FIGURES,
    MODEL,
    PLAN,
    PLAN_TEXT,
    TIMELINE,
    result,
)
from planner.pipeline.parallel import Tries
from planner.pipeline.preference import COMPUTING
from planner.pipeline.prepare import prepare
from planner.pipeline.request import SHORT_SEED
from planner.pipeline.workspace import Workspace, is_smoothing
from planner.playback.playback import Playback, play_back
from planner.playback.table_playback import play_on_table
from planner.playback.unfolding import check_fits
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.robot.smoothed import before_and_after, check_smoothable
from planner.simulation.parameters import BASELINE, ExplosionParameters, TableParameters

STRONGER_MOTORS: Final = 1.5
"""Limit of the motors on a table, as a multiple of what standing asks in the record …"""
LEAST_TORQUE_WP: Final = 1.0
"""… or of so much, where that is hardly anything: something must speed the chain up."""
JUDGING: Final = ("play_back", "certify")
"""Stages that go on with the last attempt of ``explode``."""
STAGES: Final = ("read", "explode", "play_back", "certify", "export")


def run_stage(
    stage: str,
    directory: FilePath,
    *,
    progress: Report = silent,
    cancelled: Cancelled = never,
    tries: Tries | None = None,
) -> dict[str, Any]:
    """Runs one stage of the fold in a directory.

    Args:
        stage: One of ``STAGES``; the earlier ones must have run.
        directory: Holds ``request.json`` and ``input``, and the files of the stages so far.
        progress: Told how far it is.
        cancelled: Asked now and then whether to stop.
        tries: Makes what may be tried next beside; it must outlast all stages of the fold. None for
            one explosion after the other.

    Returns:
        The stage's figures, as plain JSON values.

    Raises:
        InputError: From ``read``, when the input cannot be used.
    """
    (directory / manifest.FILE).unlink(missing_ok=True)  # of what is written now
    if stage == "export" and tries is not None:
        tries.rest()  # what is written now is the end
    workspace = Workspace(directory)
    if stage in JUDGING:
        progress = _counting(workspace, progress)
    if stage == "explode":
        result = explode_stage(workspace, progress, cancelled, tries or Tries(directory))
    else:
        result = _STAGES[stage](workspace, progress, cancelled)
    progress(Progress(stage=stage, fraction=1.0, message="done"))
    return result


def _counting(workspace: Workspace, progress: Report) -> Report:
    """Return a report that tells which of about how many plans the fold's last attempt is."""
    request = workspace.read_request()
    tried = workspace.read_history()
    if request.prefer == COMPUTING or not tried:
        return progress
    return attempts.with_count(progress, tried, choice_of(request, workspace.read_candidates()))


def next_stage(stage: str, result: dict[str, Any]) -> str | None:
    """The stage after one that gave a result: an earlier one again, or None after the last."""
    if result.get("again"):
        return str(result["again"])
    place = STAGES.index(stage) + 1
    return STAGES[place] if place < len(STAGES) else None


def run_stages(
    directory: FilePath,
    *,
    progress: Report = silent,
    cancelled: Cancelled = never,
    workers: int = 1,
) -> dict[str, Any]:
    """Runs all stages, those again that a refused plan makes necessary; the last one's result.

    Args:
        directory: As for ``run_stage``.
        progress, cancelled: As for ``run_stage``.
        workers: Explosions that are made at once at most. The plan is the same for any number.

    Raises:
        InputError: When the input cannot be used.
    """
    stage: str | None = STAGES[0]
    result: dict[str, Any] = {}
    with Tries(directory, workers) as tries:
        while stage is not None:
            result = run_stage(
                stage, directory, progress=progress, cancelled=cancelled, tries=tries
            )
            stage = next_stage(stage, result)
    return result


def _read(workspace: Workspace, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    del progress, cancelled
    request = workspace.read_request()
    request.check()
    if request.smooth:
        plan = workspace.read_recorded()
        check_smoothable(plan)
        only = Candidates((plan.chain,), two_ended=False)
        return _noted(workspace, only, kind="plan", method=None, notes=[], knot=None)
    workspace.drop_recorded()  # of an earlier fold with a preference
    prepared = prepare(
        workspace.read_input(),
        request.filename,
        request.path_options(),
        seed=request.seed % SHORT_SEED,
    )
    chain, chains = prepared.chain, prepared.chains
    start = workspace.read_start(request)
    if start is not None:
        check_fits(start, chain.module.name, len(chain))
        # It is the same chain, whatever size the other shape was drawn in.
        chains = tuple(replace(c, pitch_m=start.pitch_m) for c in chains if len(c) == len(start))
        chain = chains[0]
    strategies_for(chain, request.parameters(), refolds=request.refold)  # or it is refused
    # A chain comes as it is wanted; what only shows cells may as well begin at their other end.
    told = prepared.kind == "chain" or request.start is not None or request.refold
    told = told or request.world == "table"  # whose path begins on it
    return _noted(
        workspace,
        Candidates(chains, two_ended=not told and on_lattice(chain)),
        kind=prepared.kind,
        method=prepared.method,
        notes=list(prepared.notes),
        knot=None if prepared.knot is None else prepared.knot.verdict,
    )


def _noted(workspace: Workspace, candidates: Candidates, **how: Any) -> dict[str, Any]:
    """Keeps the chains that may be folded; what is said of how they were found."""
    chain = candidates.chains[0]
    workspace.clear()
    workspace.write_candidates(candidates)
    return {
        **how,
        "candidates": len(candidates.chains),
        "name": chain.name,
        "module": chain.module.name,
        "modules": len(chain),
        "joints": chain.joint_count,
        "hinges": len(chain.folded_rad),
        "pitch_m": chain.pitch_m,
    }


def _play_back(workspace: Workspace, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request, chain = workspace.read_request(), workspace.read_chain()
    record, place = workspace.read_record(), workspace.attempt
    place.drop_playback()
    smoothed = is_smoothing(record)
    parameters = request.parameters(smoothed=smoothed)
    if record is not None and record.status != "straight":
        return {
            "status": "skipped",
            "reason": "the chain was not straight after the explosion",
            "steps": 0,
            "seconds": 0.0,
            "rms_position_error": None,
            "max_angle_error_rad": None,
        }
    unfolding = workspace.read_unfolding(request)
    start_s, frames = 0.0, 0
    whole = unfolding is not None or smoothed
    if record is not None and not whole:
        start_s, frames = float(record.frames.time_s[-1]), len(record.frames)
    choice = choice_of(request, workspace.read_candidates())
    tried = attempts.before_playback(workspace.read_history(), choice)
    workspace.write_history(tried)
    timeline = place.timeline
    if whole:  # a refold's timeline goes from one shape to the other; a smoothed one only folds
        TimelineWriter.create(timeline, chain)
    if record is not None and record.table is not None:
        return _play_on_table(place, chain, record, parameters.table, progress, cancelled)
    with TimelineWriter.reopen(timeline, frames=frames) as writer:
        playback = play_back(
            chain,
            record,
            parameters.playback,
            module_size=parameters.module_size,
            sink=writer.append,
            progress=progress,
            cancelled=cancelled,
            start_s=start_s,
            finer=tried[-1].finer if tried else 1,
            unfolding=unfolding,
            seed=request.seed,
        )
    place.write_playback(playback)
    return playback.summary()


def _play_on_table(
    place: Workspace,
    chain: Chain,
    record: Record,
    table: TableParameters,
    progress: Report,
    cancelled: Cancelled,
) -> dict[str, Any]:
    """Folds the chain on the table, with motors that give a little more than standing asks."""
    assert isinstance(record.frames, Windows)
    assert record.table is not None
    # Its frames are of all angles, the record's of windows: one timeline holds frames of one kind.
    exploded = record.frames.dense(chain)
    progress(
        Progress(stage="play_back", fraction=0.0, message="computing the balance of each frame")
    )
    standing = table_certificate(
        chain,
        record.frames[::-1],
        friction=table.friction,
        base=table.base,
        on_table=True,
        height=chain.table_height,
    )
    asked = record.table.bound if standing.torque is None else standing.torque
    with TimelineWriter.create(place.timeline, chain) as writer:
        writer.append(exploded)
        playback = play_on_table(
            chain,
            record.frames,
            torque_limit_wp=STRONGER_MOTORS * max(asked, LEAST_TORQUE_WP),
            friction=table.friction,
            clamped=table.held,
            start_s=float(exploded.time_s[-1]),
            progress=progress,
            cancelled=cancelled,
        ).as_playback(chain.pitch_m)
        writer.append(playback.frames)
    place.write_playback(playback)
    return playback.summary()


def _certify(workspace: Workspace, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request, playback = workspace.read_request(), workspace.read_playback()
    record, place = workspace.read_record(), workspace.attempt
    parameters = request.parameters(smoothed=is_smoothing(record))
    for path in (place.clearances, place.forces):
        path.unlink(missing_ok=True)
    peeled = playback is not None and isinstance(playback.frames, Windows)
    certificate = certify(
        workspace.read_chain(),
        record,
        playback,
        parameters,
        start=workspace.read_start(request),
        progress=progress,
        cancelled=cancelled,
        sink=partial(np.save, place.clearances) if peeled else None,
        forces=lambda found: found.save(place.forces),
    )
    again = None
    tried = workspace.read_history()
    if tried:
        tried = attempts.judged(tried, certificate, workspace.number, playback)
        workspace.write_history(tried)
        # What was published, or is a baseline, is shown as it is, with what is wrong with it.
        ours = isinstance(parameters.explosion, ExplosionParameters)
        if ours and parameters.strategy != BASELINE and not cancelled():
            again = attempts.following(tried, choice_of(request, workspace.read_candidates()))
        if again == "explode" and _overlaps_unfolding(certificate, playback):
            again = None  # which is the same whatever the other shape's path
    place.write_certificate(certificate)
    if again is None and not cancelled():
        workspace.keep_best(request.prefer)
        certificate = workspace.read_certificate() or certificate
    return {**certificate.as_dict(), "again": again}


def _overlaps_unfolding(certificate: Certificate, playback: Playback | None) -> bool:
    """Whether a refold's closest place comes before it is straight."""
    if playback is None:
        return False
    straight = int((playback.frames.phase == PHASES.index("unfolding")).sum())
    return any(
        clearance is not None and clearance < 0.0 and place is not None and place.frame < straight
        for clearance, place in (
            (certificate.min_clearance, certificate.min_clearance_at),
            (certificate.min_clearance_playback, certificate.min_clearance_playback_at),
        )
    )


def _export(workspace: Workspace, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    del progress, cancelled
    directory, request, tried = (
        workspace.directory,
        workspace.read_request(),
        workspace.read_history(),
    )
    best = workspace.keep_best(request.prefer)
    if best is not None and request.prefer != COMPUTING:
        tried = attempts.marked(tried, best)
        workspace.write_history(tried)
    workspace.publish(request.prefer)
    plan = replace(
        workspace.read_attempt(request),
        attempts=tuple(attempt.as_dict() for attempt in tried),
        start=workspace.read_start(request),
    )
    if is_smoothing(workspace.read_record()):
        plan = replace(plan, smoothing=before_and_after(workspace.read_recorded(), plan))
    before = [name for name in DESCRIBED if name not in EXPORTED]
    with ThreadPoolExecutor(2) as beside:
        figures = beside.submit(work_out_figures, directory)
        digests = beside.submit(manifest.digests_of, directory, before)
        write_whole(directory / MODEL, mjcf.write(plan))
        plan.save_npz(directory / PLAN)
        texts = plan.save_json(directory / PLAN_TEXT)
        figures.result()
    # Of a thousand numbers that were just written as text, it is not asked for once more.
    written = {PLAN_TEXT: manifest.digests_of_texts(texts)}
    manifest.write_manifest(directory, digests.result() | written)
    return plan.summary()


def work_out_figures(directory: FilePath) -> FilePath:
    """Writes the figures of a fold's timeline, as far as it goes; where they are.

    ``export`` does so for every fold that gets there, verified or not. Of a fold that was
    cancelled, or is older than the figures, whoever wants them asks for them.

    Raises:
        TimelineError: When the fold has no timeline.
    """
    workspace = Workspace(directory)
    path = directory / FIGURES
    clearances = result(directory, CLEARANCES)
    write_figures(
        result(directory, TIMELINE),
        path,
        workspace.read_request().parameters(),
        certificate=workspace.read_certificate(),
        clearances=np.load(clearances) if clearances.exists() else None,
    )
    clearances.unlink(missing_ok=True)
    return path


_Stage = Callable[[Workspace, Report, Cancelled], dict[str, Any]]
_STAGES: Final[dict[str, _Stage]] = {
    "read": _read,
    "play_back": _play_back,
    "certify": _certify,
    "export": _export,
}
