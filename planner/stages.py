"""Stages of a fold, each restartable, over one directory.

A stage reads the files of earlier stages and writes its own aside before renaming them, so that a
file that is there is whole. The service runs each stage in a process of its own; the command line
and the library run them one after the other.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final

from planner import attempts
from planner.best_record import BestRecord
from planner.candidates import Candidates
from planner.certificate import Certificate, certify
from planner.chain import Chain
from planner.exports import mjcf
from planner.files import write_whole
from planner.frames import PHASES
from planner.measuring import write_figures
from planner.parameters import ExplosionParameters
from planner.plan import Plan
from planner.playback import Playback, play_back
from planner.portfolio import Choice, Try
from planner.preparation import prepare
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.record import Record
from planner.request import SHORT_SEED, Request
from planner.smoothed import before_and_after, check_smoothable, smoothed_record
from planner.smoothing_ways import RECORDED_PLAN, WAYS
from planner.strategies import BASELINE, on_lattice, strategies_for
from planner.timeline import TimelineWriter, chain_attributes, chain_from_attributes
from planner.tries import Tries, make_try
from planner.unfolding import START_CHAIN, START_PLAN, Unfolding, check_fits

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
    if stage == "explode":
        result = _explode(directory, progress, cancelled, tries or Tries(directory))
    else:
        result = _STAGES[stage](directory, progress, cancelled)
    progress(Progress(stage=stage, fraction=1.0, message="done"))
    return result


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


def write_request(directory: FilePath, request: Request, data: bytes) -> None:
    """Puts a request and its input into a fold's directory."""
    values = {name: getattr(request, name) for name in Request.__dataclass_fields__}
    write_whole(directory / "input", data)
    write_whole(directory / "request.json", json.dumps(values).encode())


def _request(directory: FilePath) -> Request:
    values = json.loads((directory / "request.json").read_bytes())
    if values.get("start") is not None:
        x, y, z = values["start"]
        values["start"] = (int(x), int(y), int(z))
    return Request(**values)


def _chain(directory: FilePath) -> Chain:
    return chain_from_attributes(json.loads((directory / "chain.json").read_bytes()))


def _record(directory: FilePath) -> Record | None:
    path = directory / "record.npz"
    return Record.load(path) if path.exists() else None


def _playback(directory: FilePath) -> Playback | None:
    path = directory / "playback.npz"
    return Playback.load(path) if path.exists() else None


def _start(directory: FilePath, request: Request) -> Chain | None:
    """The chain as it is folded at the beginning of a refold."""
    if not request.refold:
        return None
    return chain_from_attributes(json.loads((directory / START_CHAIN).read_bytes()))


def _unfolding(directory: FilePath, request: Request) -> Unfolding | None:
    if not request.refold:
        return None
    return Unfolding.of_plan(Plan.load(directory / START_PLAN))


def _recorded(directory: FilePath) -> Plan:
    """The plan that is smoothed."""
    return Plan.load(directory / RECORDED_PLAN)


def _read(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    del progress, cancelled
    request = _request(directory)
    request.check()
    if request.smooth:
        plan = _recorded(directory)
        check_smoothable(plan)
        only = Candidates((plan.chain,), two_ended=False)
        return _noted(directory, only, kind="plan", method=None, notes=[], knot=None)
    prepared = prepare(
        (directory / "input").read_bytes(),
        request.filename,
        request.wishes(),
        seed=request.seed % SHORT_SEED,
    )
    chain, chains = prepared.chain, prepared.chains
    start = _start(directory, request)
    if start is not None:
        check_fits(start, chain.module.name, len(chain))
        # It is the same chain, whatever size the other shape was drawn in.
        chains = tuple(replace(c, pitch_m=start.pitch_m) for c in chains if len(c) == len(start))
        chain = chains[0]
    strategies_for(chain, request.parameters(), refolds=request.refold)  # or it is refused
    # A chain comes as it is wanted; what only shows cells may as well begin at their other end.
    told = prepared.kind == "chain" or request.start is not None or request.refold
    return _noted(
        directory,
        Candidates(chains, two_ended=not told and on_lattice(chain)),
        kind=prepared.kind,
        method=prepared.method,
        notes=list(prepared.notes),
        knot=None if prepared.knot is None else prepared.knot.verdict,
    )


def _noted(directory: FilePath, candidates: Candidates, **how: Any) -> dict[str, Any]:
    """Keeps the chains that may be folded; what is said of how they were found."""
    chain = candidates.chains[0]
    (directory / attempts.FILE).unlink(missing_ok=True)
    candidates.save(directory)
    _write_json(directory / "chain.json", chain_attributes(chain))
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


def _explode(
    directory: FilePath, progress: Report, cancelled: Cancelled, tries: Tries
) -> dict[str, Any]:
    request = _request(directory)
    # What an earlier fold left in this directory must not pass for a result of this one.
    for name in ("record.npz", "playback.npz", "picture.png"):
        (directory / name).unlink(missing_ok=True)
    rmtree(directory / "figures.zarr", ignore_errors=True)
    candidates = Candidates.load(directory)
    if request.parameters().explosion is None:
        TimelineWriter.create(directory / "timeline.zarr", candidates.chains[0])
        attempts.save(directory, [])
        return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
    choice = _choice(directory)
    tried = attempts.before_explosion(directory, choice)
    best = BestRecord(directory)
    while (todo := choice.after(tried)) is not None:
        chain = candidates.chain_of(todo)
        _write_json(directory / "chain.json", chain_attributes(chain))
        attempts.save(directory, [*tried, attempts.begun(todo)])
        if request.smooth:
            record = _smoothed(directory, request, todo, progress, cancelled)
            attempt = attempts.made(todo, chain, record)
        else:
            tries.come_to(choice, tried, todo)
            record, attempt = tries.take(progress, cancelled) or make_try(
                directory, request.parameters(), chain, todo, tries.watched(progress), cancelled
            )
        tried.append(attempt)
        best.look_at(chain, record)
        if record.status in ("straight", "cancelled"):
            break
    record = best.keep()
    if record.status != "straight" or len(tried) == 1:
        tries.rest()  # what comes out at once is rarely refused
    attempts.save(directory, tried)
    record.save(directory / "record.npz")
    return {**record.summary(), "attempts": len(tried)}


def _choice(directory: FilePath) -> Choice:
    """What may be tried of a fold."""
    request = _request(directory)
    if request.smooth:
        return Choice(strategies=(WAYS,), seed=request.seed, seeds=1)
    parameters = request.parameters()
    candidates = Candidates.load(directory)
    return Choice(
        strategies=tuple(
            strategies_for(chain, parameters, refolds=request.refold) for chain in candidates.chains
        ),
        seed=request.seed,
        two_ended=candidates.two_ended,
        forces=isinstance(parameters.explosion, ExplosionParameters),
    )


def _smoothed(
    directory: FilePath, request: Request, todo: Try, progress: Report, cancelled: Cancelled
) -> Record:
    """One smoothing, of which there is nothing to see before it is played back."""
    recorded = _recorded(directory)
    TimelineWriter.create(directory / "timeline.zarr", recorded.chain)
    progress(Progress(stage="explode", fraction=0.1, message="smoothing"))
    return smoothed_record(
        recorded,
        todo.strategy,
        size=request.parameters().module_size,
        seed=todo.seed,
        cancelled=cancelled,
    )


def _play_back(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request, chain, record = _request(directory), _chain(directory), _record(directory)
    (directory / "playback.npz").unlink(missing_ok=True)
    parameters = request.parameters()
    if record is not None and record.status != "straight":
        return {
            "status": "skipped",
            "reason": "the explosion did not end straight",
            "steps": 0,
            "seconds": 0.0,
            "rms_position_error": None,
            "max_angle_error_rad": None,
        }
    unfolding = _unfolding(directory, request)
    start_s, frames = 0.0, 0
    whole = unfolding is not None or request.smooth
    if record is not None and not whole:
        start_s, frames = float(record.frames.time_s[-1]), len(record.frames)
    tried = attempts.before_playback(directory, _choice(directory))
    attempts.save(directory, tried)
    timeline = directory / "timeline.zarr"
    if whole:  # a refold's timeline goes from one shape to the other; a smoothed one only folds
        TimelineWriter.create(timeline, chain)
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
            finer=int(tried[-1].get("finer", 1)) if tried else 1,
            unfolding=unfolding,
        )
    playback.save(directory / "playback.npz")
    return playback.summary()


def _certify(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request, playback = _request(directory), _playback(directory)
    parameters = request.parameters()
    certificate = certify(
        _chain(directory),
        _record(directory),
        playback,
        parameters,
        start=_start(directory, request),
        progress=progress,
        cancelled=cancelled,
    )
    again = None
    tried = attempts.load(directory)
    if tried:
        tried = attempts.judged(tried, certificate)
        attempts.save(directory, tried)
        # What was published, or is a baseline, is shown as it is, with what is wrong with it.
        ours = isinstance(parameters.explosion, ExplosionParameters)
        if ours and parameters.strategy != BASELINE and not cancelled():
            again = attempts.following(tried, _choice(directory))
        if again == "explode" and _overlaps_unfolding(certificate, playback):
            again = None  # which is the same whatever the other shape's path
    values = certificate.as_dict()
    _write_json(directory / "certificate.json", values)
    return {**values, "again": again}


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
    request, chain = _request(directory), _chain(directory)
    parameters = request.parameters()
    certificate = Certificate.from_dict(json.loads((directory / "certificate.json").read_bytes()))
    plan = Plan.assembled(
        chain,
        parameters,
        request.seed,
        _record(directory),
        _playback(directory),
        certificate,
        tuple(attempts.load(directory)),
        _start(directory, request),
    )
    if request.smooth:
        plan = replace(plan, smoothing=before_and_after(_recorded(directory), plan))
    write_whole(directory / "model.xml", mjcf.write(plan))
    plan.save_npz(directory / "plan.npz")
    plan.save_json(directory / "plan.json")
    work_out_figures(directory)
    return plan.summary()


def work_out_figures(directory: FilePath) -> FilePath:
    """Writes the figures of a fold's timeline, as far as it goes; where they are.

    ``export`` does so for every fold that gets there, verified or not. Of a fold that was
    cancelled, or is older than the figures, whoever wants them asks for them.

    Raises:
        TimelineError: When the fold has no timeline.
    """
    certificate = directory / "certificate.json"
    known = json.loads(certificate.read_bytes()) if certificate.exists() else None
    path = directory / "figures.zarr"
    write_figures(
        directory / "timeline.zarr",
        path,
        _request(directory).parameters(),
        certificate=known and Certificate.from_dict(known),
    )
    return path


def _write_json(path: FilePath, values: object) -> None:
    write_whole(path, json.dumps(values).encode())


_Stage = Callable[[FilePath, Report, Cancelled], dict[str, Any]]
_STAGES: Final[dict[str, _Stage]] = {
    "read": _read,
    "play_back": _play_back,
    "certify": _certify,
    "export": _export,
}
__all__ = [
    "STAGES",
    "Request",
    "next_stage",
    "run_stage",
    "run_stages",
    "work_out_figures",
    "write_request",
]
