"""Stages of a fold, each restartable, over one directory.

A stage reads the files of earlier stages and writes its own aside before renaming them, so that a
file that is there is whole. The service runs each stage in a process of its own; the command line
and the library run them one after the other.
"""

from __future__ import annotations

import json
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
from planner.certificate.table_forces import FILE as FORCES
from planner.chain.chain import Chain
from planner.explosion.strategies import on_lattice, strategies_for
from planner.exports import mjcf
from planner.files import write_json, write_whole
from planner.motion.frames import PHASES
from planner.motion.record import Record
from planner.motion.timeline import TimelineWriter
from planner.motion.windows import Windows
from planner.parameters.explosion import ExplosionParameters, TableParameters
from planner.parameters.parameters import BASELINE
from planner.pipeline import attempts, manifest
from planner.pipeline.attempt_folders import (
    CERTIFICATE,
    CLEARANCES,
    TIMELINE,
    clear,
    folder,
    keep_best,
    numbers,
    publish,
    result,
)
from planner.pipeline.attempts import Candidates
from planner.pipeline.explode_stage import choice_of, explode_stage
from planner.pipeline.fold_directory import (
    is_smoothing,
    read_attempt,
    read_certificate,
    read_chain,
    read_playback,
    read_record,
    read_recorded,
    read_request,
    read_start,
    read_unfolding,
    write_chain_folded,
)
from planner.pipeline.parallel import Tries
from planner.pipeline.preference import COMPUTING
from planner.pipeline.prepare import prepare
from planner.pipeline.request import SHORT_SEED, Request
from planner.plan.prepared import FILE as PREPARED
from planner.plan.prepared import PreparedChains, key_of
from planner.playback.playback import Playback, play_back
from planner.playback.table_playback import play_on_table
from planner.playback.unfolding import check_fits
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.robot import RECORDED_PLAN
from planner.robot.smoothed import before_and_after, check_smoothable

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
    if stage in JUDGING:
        progress = _counting(directory, progress)
    if stage == "explode":
        result = explode_stage(directory, progress, cancelled, tries or Tries(directory))
    else:
        result = _STAGES[stage](directory, progress, cancelled)
    progress(Progress(stage=stage, fraction=1.0, message="done"))
    return result


def _counting(directory: FilePath, progress: Report) -> Report:
    """Return a report that tells which of about how many plans the fold's last attempt is."""
    request = read_request(directory)
    tried = attempts.load(directory)
    if request.prefer == COMPUTING or not tried:
        return progress
    return attempts.with_count(progress, tried, choice_of(request, Candidates.load(directory)))


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


def _read(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    del progress, cancelled
    request = read_request(directory)
    request.check()
    if request.smooth:
        plan = read_recorded(directory)
        check_smoothable(plan)
        only = Candidates((plan.chain,), two_ended=False)
        return _noted(directory, only, kind="plan", method=None, notes=[], knot=None)
    (directory / RECORDED_PLAN).unlink(missing_ok=True)  # of an earlier fold with a wish
    prepared = _prepared(directory, request)
    chains = prepared.chains
    chain = chains[0]
    start = read_start(directory, request)
    if start is not None:
        check_fits(start, chain.module.name, len(chain))
        # It is the same chain, whatever size the other shape was drawn in.
        chains = tuple(replace(c, pitch_m=start.pitch_m) for c in chains if len(c) == len(start))
        chain = chains[0]
    strategies_for(chain, request.parameters(), refolds=request.refold)  # or it is refused
    # A chain comes as it is wanted; what only shows cells may as well begin at their other end.
    told = prepared.kind == "chain" or request.start is not None or request.refold
    told = told or request.world == "table"  # whose path begins on it
    result = _noted(
        directory,
        Candidates(chains, two_ended=not told and on_lattice(chain)),
        kind=prepared.kind,
        method=prepared.method,
        notes=list(prepared.notes),
        knot=prepared.knot,
    )
    (directory / PREPARED).unlink(missing_ok=True)
    return result


def _prepared(directory: FilePath, request: Request) -> PreparedChains:
    """Return the chains that the preview has stored, or else search for them."""
    data, options = (directory / "input").read_bytes(), request.path_options()
    seed = request.seed % SHORT_SEED
    stored = PreparedChains.load(directory, key_of(data, request.filename, options, seed))
    return stored or prepare(data, request.filename, options, seed=seed).prepared()


def _noted(directory: FilePath, candidates: Candidates, **how: Any) -> dict[str, Any]:
    """Keeps the chains that may be folded; what is said of how they were found."""
    chain = candidates.chains[0]
    clear(directory)
    candidates.save(directory)
    write_chain_folded(directory, chain)
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


def _play_back(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request, chain, record = read_request(directory), read_chain(directory), read_record(directory)
    place = folder(directory)
    (place / "playback.npz").unlink(missing_ok=True)
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
    unfolding = read_unfolding(directory, request)
    start_s, frames = 0.0, 0
    whole = unfolding is not None or smoothed
    if record is not None and not whole:
        start_s, frames = float(record.frames.time_s[-1]), len(record.frames)
    tried = attempts.before_playback(directory, choice_of(request, Candidates.load(directory)))
    attempts.save(directory, tried)
    timeline = place / TIMELINE
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
    playback.save(place / "playback.npz")
    return playback.summary()


def _play_on_table(
    place: FilePath,
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
    timeline = place / TIMELINE
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
    with TimelineWriter.create(timeline, chain) as writer:
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
    playback.save(place / "playback.npz")
    return playback.summary()


def _certify(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request, playback = read_request(directory), read_playback(directory)
    record = read_record(directory)
    parameters = request.parameters(smoothed=is_smoothing(record))
    known_at, forces_at = (folder(directory) / name for name in (CLEARANCES, FORCES))
    for path in (known_at, forces_at):
        path.unlink(missing_ok=True)
    peeled = playback is not None and isinstance(playback.frames, Windows)
    certificate = certify(
        read_chain(directory),
        record,
        playback,
        parameters,
        start=read_start(directory, request),
        progress=progress,
        cancelled=cancelled,
        sink=partial(np.save, known_at) if peeled else None,
        forces=lambda found: found.save(forces_at),
    )
    again = None
    tried = attempts.load(directory)
    if tried:
        known = numbers(directory)
        tried = attempts.judged(tried, certificate, known[-1] if known else None, playback)
        attempts.save(directory, tried)
        # What was published, or is a baseline, is shown as it is, with what is wrong with it.
        ours = isinstance(parameters.explosion, ExplosionParameters)
        if ours and parameters.strategy != BASELINE and not cancelled():
            again = attempts.following(tried, choice_of(request, Candidates.load(directory)))
        if again == "explode" and _overlaps_unfolding(certificate, playback):
            again = None  # which is the same whatever the other shape's path
    write_json(folder(directory) / CERTIFICATE, certificate.as_dict())
    if again is None and not cancelled():
        keep_best(directory, request.prefer)
        certificate = read_certificate(directory)
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


def _export(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    del progress, cancelled
    request, tried = read_request(directory), attempts.load(directory)
    best = keep_best(directory, request.prefer)
    if best is not None and request.prefer != COMPUTING:
        tried = attempts.marked(tried, best)
        attempts.save(directory, tried)
    publish(directory, request.prefer)
    plan = replace(
        read_attempt(directory, request),
        attempts=tuple(attempt.as_dict() for attempt in tried),
        start=read_start(directory, request),
    )
    if is_smoothing(read_record(directory)):
        plan = replace(plan, smoothing=before_and_after(read_recorded(directory), plan))
    before = [name for name in manifest.FILES if name not in manifest.EXPORTED]
    with ThreadPoolExecutor(2) as beside:
        figures = beside.submit(work_out_figures, directory)
        digests = beside.submit(manifest.digests_of, directory, before)
        write_whole(directory / "model.xml", mjcf.write(plan))
        plan.save_npz(directory / "plan.npz")
        texts = plan.save_json(directory / "plan.json")
        figures.result()
    # Of a thousand numbers that were just written as text, it is not asked for once more.
    written = {"plan.json": manifest.digests_of_texts(texts)}
    manifest.write_manifest(directory, digests.result() | written)
    return plan.summary()


def work_out_figures(directory: FilePath) -> FilePath:
    """Writes the figures of a fold's timeline, as far as it goes; where they are.

    ``export`` does so for every fold that gets there, verified or not. Of a fold that was
    cancelled, or is older than the figures, whoever wants them asks for them.

    Raises:
        TimelineError: When the fold has no timeline.
    """
    certificate = result(directory, CERTIFICATE)
    known = json.loads(certificate.read_bytes()) if certificate.exists() else None
    path = directory / "figures.zarr"
    clearances = result(directory, CLEARANCES)
    write_figures(
        result(directory, TIMELINE),
        path,
        read_request(directory).parameters(),
        certificate=known and Certificate.from_dict(known),
        clearances=np.load(clearances) if clearances.exists() else None,
    )
    clearances.unlink(missing_ok=True)
    return path


_Stage = Callable[[FilePath, Report, Cancelled], dict[str, Any]]
_STAGES: Final[dict[str, _Stage]] = {
    "read": _read,
    "play_back": _play_back,
    "certify": _certify,
    "export": _export,
}
