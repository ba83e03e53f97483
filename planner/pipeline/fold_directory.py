"""What a fold's directory holds, as values: the request, the chain, what the stages have made."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path as FilePath

from planner.certificate.certificate import Certificate
from planner.chain.chain import Chain
from planner.files import write_json, write_whole
from planner.motion.frames import Frames
from planner.motion.record import Record
from planner.motion.timeline import chain_attributes, chain_from_attributes
from planner.motion.windows import Windows
from planner.pipeline.attempt_folders import CERTIFICATE, CHAIN, result
from planner.pipeline.request import Request
from planner.plan.plan import Plan
from planner.playback.playback import Playback
from planner.playback.unfolding import START_CHAIN, START_PLAN, Unfolding
from planner.robot import RECORDED_PLAN, SMOOTHING_WAYS


def write_request(directory: FilePath, request: Request, data: bytes) -> None:
    """Puts a request and its input into a fold's directory."""
    values = {name: getattr(request, name) for name in Request.__dataclass_fields__}
    write_whole(directory / "input", data)
    write_json(directory / "request.json", values)


def read_request(directory: FilePath) -> Request:
    """What was asked for."""
    values = json.loads((directory / "request.json").read_bytes())
    if values.get("start") is not None:
        x, y, z = values["start"]
        values["start"] = (int(x), int(y), int(z))
    return Request(**values)


def write_chain_folded(directory: FilePath, chain: Chain) -> None:
    """Keeps the chain that is being folded."""
    write_json(directory / CHAIN, chain_attributes(chain))


def read_chain(directory: FilePath) -> Chain:
    """The chain that is being folded: of the attempts, that of the last."""
    return chain_from_attributes(json.loads(result(directory, CHAIN).read_bytes()))


def read_record(directory: FilePath) -> Record | None:
    """How it exploded, if it did."""
    path = result(directory, "record.npz")
    return Record.load(path) if path.exists() else None


def is_smoothing(record: Record | None) -> bool:
    """Whether a record is a smoothed motion, in place of an explosion."""
    return record is not None and record.strategy in SMOOTHING_WAYS


def read_playback(directory: FilePath) -> Playback | None:
    """How it was played back, if it was."""
    path = result(directory, "playback.npz")
    return Playback.load(path) if path.exists() else None


def read_start(directory: FilePath, request: Request) -> Chain | None:
    """The chain as it is folded at the beginning of a refold; None for any other fold."""
    if not request.refold:
        return None
    return chain_from_attributes(json.loads((directory / START_CHAIN).read_bytes()))


def read_unfolding(directory: FilePath, request: Request) -> Unfolding | None:
    """How a refold gets straight; None for any other fold."""
    if not request.refold:
        return None
    return Plan.load(directory / START_PLAN).unfolding()


def read_recorded(directory: FilePath) -> Plan:
    """The plan that is smoothed: the fold's input, or one of its own attempts."""
    return Plan.load(result(directory, RECORDED_PLAN))


def read_attempt(place: FilePath, request: Request) -> Plan:
    """The plan of an attempt that is judged.

    Args:
        place: The attempt's folder, or that of a fold that is over.
        request: What was asked for.
    """
    record = read_record(place)
    return Plan.assembled(
        read_chain(place),
        request.parameters(smoothed=is_smoothing(record)),
        request.seed,
        record,
        read_playback(place),
        read_certificate(place),
    )


def read_plan(directory: FilePath) -> Plan:
    """The plan of a fold that is over, with the joint errors that its file leaves out."""
    plan, playback = Plan.load(directory / "plan.npz"), read_playback(directory)
    if playback is None:
        return plan
    motion, simulated = plan.motion, playback.frames
    if isinstance(motion, Windows) and isinstance(simulated, Windows):
        motion = replace(motion, errors_rad=simulated.errors_rad)
    elif isinstance(motion, Frames) and isinstance(simulated, Frames):
        motion = replace(motion, joint_error_rad=simulated.joint_error_rad)
    return replace(plan, motion=motion)


def read_certificate(directory: FilePath) -> Certificate:
    """What was verified: of the attempts, of the last."""
    return Certificate.from_dict(json.loads(result(directory, CERTIFICATE).read_bytes()))
