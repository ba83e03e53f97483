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
from planner.certificate import Certificate, certify
from planner.chain import Chain
from planner.diagnosis import diagnose
from planner.exports import mjcf
from planner.files import write_whole
from planner.frames import PHASES
from planner.measuring import write_figures
from planner.parameters import ExplosionParameters, Parameters
from planner.plan import Plan
from planner.playback import Playback, play_back
from planner.portfolio import Choice, Try
from planner.preparation import prepare
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.record import Record
from planner.request import SHORT_SEED, Request
from planner.strategies import BASELINE, let_go, strategies_for, windowed
from planner.timeline import TimelineWriter, chain_attributes, chain_from_attributes
from planner.unfolding import START_CHAIN, START_PLAN, Unfolding, check_fits

STAGES: Final = ("read", "explode", "play_back", "certify", "export")


def run_stage(
    stage: str,
    directory: FilePath,
    *,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> dict[str, Any]:
    """Runs one stage of the fold in a directory.

    Args:
        stage: One of ``STAGES``; the earlier ones must have run.
        directory: Holds ``request.json`` and ``input``, and the files of the stages so far.
        progress: Told how far it is.
        cancelled: Asked now and then whether to stop.

    Returns:
        The stage's figures, as plain JSON values.

    Raises:
        InputError: From ``read``, when the input cannot be used.
    """
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
    directory: FilePath, *, progress: Report = silent, cancelled: Cancelled = never
) -> dict[str, Any]:
    """Runs all stages, those again that a refused plan makes necessary; the last one's result.

    Raises:
        InputError: When the input cannot be used.
    """
    stage: str | None = STAGES[0]
    result: dict[str, Any] = {}
    while stage is not None:
        result = run_stage(stage, directory, progress=progress, cancelled=cancelled)
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


def _candidates(directory: FilePath) -> list[Chain]:
    found = json.loads((directory / "candidates.json").read_bytes())
    return [chain_from_attributes(attributes) for attributes in found]


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


def _read(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    del progress, cancelled
    request = _request(directory)
    request.check()
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
    (directory / attempts.FILE).unlink(missing_ok=True)
    _write_json(directory / "candidates.json", [chain_attributes(c) for c in chains])
    _write_json(directory / "chain.json", chain_attributes(chain))
    return {
        "kind": prepared.kind,
        "method": prepared.method,
        "candidates": len(chains),
        "notes": list(prepared.notes),
        "knot": None if prepared.knot is None else prepared.knot.verdict,
        "name": chain.name,
        "module": chain.module.name,
        "modules": len(chain),
        "joints": chain.joint_count,
        "hinges": len(chain.folded_rad),
        "pitch_m": chain.pitch_m,
    }


def _explode(directory: FilePath, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
    request = _request(directory)
    # What an earlier fold left in this directory must not pass for a result of this one.
    for name in ("record.npz", "playback.npz", "picture.png"):
        (directory / name).unlink(missing_ok=True)
    rmtree(directory / "figures.zarr", ignore_errors=True)
    candidates = _candidates(directory)
    if request.parameters().explosion is None:
        TimelineWriter.create(directory / "timeline.zarr", candidates[0])
        attempts.save(directory, [])
        return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
    choice = _choice(directory)
    tried = attempts.before_explosion(directory, choice)
    best = BestRecord(directory)
    while (todo := choice.after(tried)) is not None:
        chain = candidates[todo.candidate]
        _write_json(directory / "chain.json", chain_attributes(chain))
        record = _exploded(directory, request.parameters(), chain, todo, progress, cancelled)
        found = diagnose(chain, record)
        tried.append(
            {
                "candidate": todo.candidate,
                "seed": todo.seed,
                **record.summary(),
                "diagnosis": found and found.as_dict(),
            }
        )
        best.look_at(chain, record)
        if record.status in ("straight", "cancelled"):
            break
    record = best.keep()
    attempts.save(directory, tried)
    record.save(directory / "record.npz")
    return {**record.summary(), "attempts": len(tried)}


def _choice(directory: FilePath) -> Choice:
    """What may be tried of a fold."""
    request = _request(directory)
    parameters = request.parameters()
    return Choice(
        strategies=tuple(
            strategies_for(chain, parameters, refolds=request.refold)
            for chain in _candidates(directory)
        ),
        seed=request.seed,
    )


def _exploded(
    directory: FilePath,
    parameters: Parameters,
    chain: Chain,
    todo: Try,
    progress: Report,
    cancelled: Cancelled,
) -> Record:
    """One explosion, on a timeline of its own."""
    writer = TimelineWriter.create(
        directory / "timeline.zarr", chain, windowed=windowed(todo.strategy)
    )
    record = let_go(
        chain,
        todo.strategy,
        parameters,
        seed=todo.seed,
        sink=writer.append,
        progress=progress,
        cancelled=cancelled,
    )
    writer.flush()
    if record.status != "straight":
        writer.close("failed")
    return record


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
    if record is not None and unfolding is None:
        start_s, frames = float(record.frames.time_s[-1]), len(record.frames)
    tried = attempts.before_playback(directory, _choice(directory))
    attempts.save(directory, tried)
    timeline = directory / "timeline.zarr"
    if unfolding is not None:  # a refold's timeline goes from one shape to the other
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
    "explode": _explode,
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
