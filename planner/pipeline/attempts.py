"""Attempts: what was tried of a fold so far, and what comes next when its certificate fails.

An overlap between two frames of the playback may be one of the frames alone, which are joined by
straight lines: the same playback is then recorded with more of them. Everything else is tried with
another path, seed or strategy: ``planner.pipeline.portfolio``.

``attempts.json`` in a fold's directory is a list with an entry for each explosion, and one for each
playback with finer frames. An entry has no verdict until its certificate is there; a stage that is
run again drops what it had added and comes to the same.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path as FilePath
from typing import Any, Final

from planner.certificate.certificate import Certificate
from planner.chain.chain import Chain
from planner.explosion.diagnosis import diagnose
from planner.files import write_json
from planner.motion.record import Record
from planner.pipeline.portfolio import Choice, Try

FILE: Final = "attempts.json"
MOST_JUDGED: Final = 6
"""Playbacks of a fold that are judged."""
MOST_REFUSED: Final = 4
"""Explosions of a fold that may be refused."""
FINER: Final = 4

Attempt = dict[str, Any]


def load(directory: FilePath) -> list[Attempt]:
    """The attempts so far."""
    path = directory / FILE
    return json.loads(path.read_bytes()) if path.exists() else []


def save(directory: FilePath, attempts: list[Attempt]) -> None:
    """Keeps them."""
    write_json(directory / FILE, attempts)


def begun(todo: Try) -> Attempt:
    """One that is under way: what is known of it if a limit ends it."""
    return {**asdict(todo), "status": "begun"}


def made(todo: Try, chain: Chain, record: Record) -> Attempt:
    """One that came to an end of its own."""
    found = diagnose(chain, record)
    return {**asdict(todo), **record.summary(), "diagnosis": found and found.as_dict()}


def before_explosion(directory: FilePath, choice: Choice) -> list[Attempt]:
    """Attempts that another explosion follows; none when everything begins anew."""
    kept = load(directory)
    while kept and "verdict" not in kept[-1]:
        kept.pop()
    goes_on = bool(kept) and following(kept, choice) == "explode"
    return kept if goes_on else []


def before_playback(directory: FilePath, choice: Choice) -> list[Attempt]:
    """Attempts with the one that is to be played back last."""
    attempts = load(directory)
    if attempts and "verdict" in attempts[-1]:
        again = {
            key: value for key, value in attempts[-1].items() if key not in ("verdict", "between")
        }
        if following(attempts, choice) == "play_back":
            again["finer"] = FINER
            return [*attempts, again]
        return [*attempts[:-1], again]
    return attempts


def judged(attempts: list[Attempt], certificate: Certificate) -> list[Attempt]:
    """With the verdict on the last one."""
    place = certificate.min_clearance_playback_at
    between = (
        certificate.min_clearance is not None
        and certificate.min_clearance >= 0.0
        and certificate.min_clearance_playback is not None
        and certificate.min_clearance_playback < 0.0
        and place is not None
        and not float(place.frame).is_integer()
    )
    last = {**attempts[-1], "verdict": certificate.verdict, "between": between}
    return [*attempts[:-1], last]


def following(attempts: list[Attempt], choice: Choice) -> str | None:
    """The stage that goes on after the verdict on the last attempt; None when that is the end."""
    last = attempts[-1]
    if last["verdict"].startswith("verified") or last["status"] != "straight":
        return None
    verdicts = [attempt for attempt in attempts if "verdict" in attempt]
    refused = sum("finer" not in attempt for attempt in verdicts)
    if len(verdicts) >= MOST_JUDGED:
        return None
    if last["between"] and "finer" not in last:
        return "play_back"
    if refused >= MOST_REFUSED:
        return None
    return "explode" if choice.after(attempts) is not None else None
