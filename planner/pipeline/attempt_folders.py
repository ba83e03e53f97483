"""Attempt folders: what an attempt makes is in a folder of its own until the fold is over.

``attempts/2`` in a fold's directory holds the chain, timeline, record, playback and certificate of
the explosion that is entry 2 of ``attempts.json``. Of attempts that are over the one that came
farthest stays, of verified plans the one that serves the fold's wish best. When the fold is over,
its files go to the fold's directory itself.

``plans/2`` holds what a page needs to play the verified plan of entry 2, which was not chosen.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final

import numpy as np

from planner.certificate.table_forces import FILE as FORCES
from planner.chain.chain import Chain
from planner.errors import TimelineError
from planner.motion.frames import PHASES, Frames
from planner.motion.timeline import Timeline
from planner.pipeline.preference import COMPUTING, PlanFigures, Preference
from planner.robot import RECORDED_PLAN

ATTEMPTS: Final = "attempts.json"
CANDIDATES: Final = "candidates.json"
FOLDER: Final = "attempts"
CERTIFICATE: Final = "certificate.json"
TIMELINE: Final = "timeline.zarr"
CHAIN: Final = "chain.json"
CLEARANCES: Final = "clearances.npy"
"""What the certificate of a peeled chain found at each frame, until its curves are written."""
PLANS: Final = "plans"
PLAYABLE: Final = (CHAIN, TIMELINE, CERTIFICATE)
"""Files of a plan that was not chosen, in its folder in ``PLANS``."""
MAX_PLANS_BYTES: Final = 64 * 2**20
"""Maximum size of a fold's ``PLANS``; plans beyond it are removed and cannot be played. Chosen."""
RESULTS: Final = (
    CHAIN,
    TIMELINE,
    "record.npz",
    "playback.npz",
    CERTIFICATE,
    CLEARANCES,
    FORCES,
)
"""What an attempt makes; one that smooths another's plan holds that as well, ``RECORDED_PLAN``."""
_EXPLOSION: Final = PHASES.index("explosion")
_UNWANTED: Final = "unwanted-"
"""A folder is renamed so before its files are removed: half of one would pass for an attempt."""


def numbers(directory: FilePath) -> list[int]:
    """Of the attempts that have a folder, in order."""
    try:
        found = [path.name for path in (directory / FOLDER).iterdir()]
    except OSError:
        return []
    return sorted(int(name) for name in found if name.isdecimal())


def folder(directory: FilePath) -> FilePath:
    """Where the latest attempt's files are written; the fold's directory when there is none."""
    known = numbers(directory)
    return place_of(directory, known[-1]) if known else directory


def place_of(directory: FilePath, number: int) -> FilePath:
    """The folder of an attempt."""
    return directory / FOLDER / str(number)


def result(directory: FilePath, name: str) -> FilePath:
    """Where a file of ``RESULTS`` is, also while the fold is computed; it need not be there."""
    path = folder(directory) / name
    return path if path.exists() else directory / name


def begin(directory: FilePath, number: int) -> FilePath:
    """Makes the folder of an attempt, without those that an earlier run made from there on."""
    _remove(directory, [known for known in numbers(directory) if known >= number])
    place = directory / FOLDER / str(number)
    place.mkdir(parents=True)
    return place


def clear(directory: FilePath) -> None:
    """Removes what earlier attempts have made: a fold begins anew."""
    rmtree(directory / FOLDER, ignore_errors=True)
    rmtree(directory / PLANS, ignore_errors=True)
    (directory / ATTEMPTS).unlink(missing_ok=True)
    for name in RESULTS[1:]:  # the chain is the first candidate's
        path = directory / name
        if path.is_dir():
            rmtree(path)
        else:
            path.unlink(missing_ok=True)


def keep_best_explosion(directory: FilePath) -> None:
    """Of explosions that no certificate has judged keeps the one that came farthest."""
    place = directory / FOLDER
    among = [n for n in numbers(directory) if not (place / str(n) / CERTIFICATE).exists()]
    _keep_best(directory, among)


def keep_best(directory: FilePath, prefer: Preference = COMPUTING) -> int | None:
    """Keeps the best attempt: a verified plan, the clearest one, or the straightest explosion.

    Args:
        directory: Of the fold.
        prefer: Which of several verified plans is the best; the earliest of equal ones is.

    Returns:
        Its number; None when there is none.
    """
    _keep_best(directory, numbers(directory), prefer)
    return next(iter(numbers(directory)), None)


def publish(directory: FilePath, prefer: Preference = COMPUTING) -> None:
    """Moves the best attempt's files to the fold's directory; one that was cut off goes on."""
    keep_best(directory, prefer)
    place = folder(directory)
    if place == directory:
        return
    for name in (*RESULTS, RECORDED_PLAN):
        there = place / name
        if there.is_dir():
            rmtree(directory / name, ignore_errors=True)
        if there.exists():
            there.replace(directory / name)
    rmtree(directory / FOLDER)


def last_frame(timeline: FilePath) -> tuple[Chain, Frames] | None:
    """A timeline's chain and last frame; None when it has none."""
    try:
        opened = Timeline.open(timeline)
        return (opened.chain, opened.frames(len(opened) - 1)) if len(opened) else None
    except (TimelineError, OSError, ValueError, KeyError):
        return None


def any_verified(directory: FilePath) -> bool:
    """Whether an attempt of a fold that is not over has a plan that is verified."""
    return any(
        judgement(place_of(directory, number) / CERTIFICATE)[0] for number in numbers(directory)
    )


def judgement(certificate: FilePath) -> tuple[bool, float]:
    """Whether a plan is verified, and its least clearance; −∞ where that is not known."""
    if not certificate.exists():
        return False, float("-inf")
    values: dict[str, Any] = json.loads(certificate.read_bytes())
    plan, playback = (values.get(name) for name in ("min_clearance", "min_clearance_playback"))
    known = [float(value) for value in (plan, playback) if value is not None]
    verified = str(values["verdict"]).startswith("verified")
    return verified, float("-inf") if plan is None else min(known)


def _keep_best(directory: FilePath, among: Sequence[int], prefer: Preference = COMPUTING) -> None:
    if len(among) > 1:
        best = max(among, key=lambda number: _progress(directory, number, prefer))
        unwanted = [number for number in among if number != best]
        if prefer != COMPUTING:
            unwanted = [number for number in unwanted if not _moved_to_plans(directory, number)]
        _remove(directory, unwanted)


def _moved_to_plans(directory: FilePath, number: int) -> bool:
    """Move a verified plan to ``PLANS`` if there is room; return True if it was moved."""
    place = directory / FOLDER / str(number)
    if not judgement(place / CERTIFICATE)[0]:
        return False
    for path in place.iterdir():
        if path.name not in PLAYABLE:
            path.unlink()
    plans = directory / PLANS
    files = [path for root in (plans, place) for path in root.rglob("*") if path.is_file()]
    if sum(path.stat().st_size for path in files) > MAX_PLANS_BYTES:
        return False
    plans.mkdir(exist_ok=True)
    place.rename(plans / str(number))
    return True


def _progress(
    directory: FilePath, number: int, prefer: Preference
) -> tuple[bool, float, bool, float, int]:
    """How far an attempt came: verified, how good it is then, straight, bends removed, and when.

    Of equal plans that are verified the earlier one is better: it was there for less computing. Of
    equal failures it is the later one, which was tried for what the earlier one lacked.
    """
    place = directory / FOLDER / str(number)
    if (verified := judgement(place / CERTIFICATE))[0] and prefer != COMPUTING:
        figures = PlanFigures.of(json.loads((place / CERTIFICATE).read_bytes()))
        return True, figures.score(prefer), True, 0.0, -number
    attempts: list[dict[str, Any]] = json.loads((directory / ATTEMPTS).read_bytes())
    straight = number < len(attempts) and attempts[number]["status"] == "straight"
    last = last_frame(place / TIMELINE)
    bent = float("inf") if last is None else _share_bent(*last)
    return (*verified, straight, -bent, number)


def _share_bent(chain: Chain, last: Frames) -> float:
    """The bends that an explosion has left, as a share of the folded chain's; 0 when it is over."""
    if last.phase[-1] != _EXPLOSION:
        return 0.0
    left = np.abs(last.joint_angles_rad[-1]).sum()
    return float(left / max(np.abs(chain.folded_rad).sum(), 1e-9))


def _remove(directory: FilePath, unwanted: Sequence[int]) -> None:
    for number in unwanted:
        (directory / FOLDER / str(number)).rename(directory / FOLDER / f"{_UNWANTED}{number}")
    for path in (directory / FOLDER).glob(f"{_UNWANTED}*"):
        rmtree(path)
