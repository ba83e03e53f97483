"""Ended: what is shown of a fold that somebody or some limit has ended before its own end."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any

from planner.chain.chain import Chain
from planner.errors import TimelineError
from planner.explosion.diagnosis import stopped
from planner.motion.frames import PHASES, Frames
from planner.motion.timeline import Timeline
from planner.pipeline import refused
from planner.pipeline.best_record import ASIDE, HALF, bring_back, share_bent
from planner.pipeline.fold_directory import read_record

EXPLOSION = PHASES.index("explosion")


def look_back(directory: FilePath) -> dict[str, Any]:
    """Of several explosions keeps the one that came farthest, and tells where it was.

    Args:
        directory: Of a fold that nothing computes any more.

    Returns:
        ``stuck``, as of ``Plan.summary``; of a plan that was refused before, which came farther,
        ``explosion`` and ``certificate``. Empty when nothing was recorded.
    """
    rmtree(directory / HALF, ignore_errors=True)
    if refused.bring_back(directory):
        refused.drop(directory)
        rmtree(directory / ASIDE, ignore_errors=True)
        record = read_record(directory)
        certificate = json.loads((directory / "certificate.json").read_bytes())
        return {"explosion": record and record.summary(), "certificate": certificate}
    return _told(_keep_best(directory))


def where(directory: FilePath) -> dict[str, Any]:
    """Where a fold ends that came to no plan, as ``look_back`` tells it; touches nothing."""
    return _told(_last(directory / "timeline.zarr"))


def _told(last: tuple[Chain, Frames] | None) -> dict[str, Any]:
    return {} if last is None else {"stuck": stopped(*last).as_dict()}


def _keep_best(directory: FilePath) -> tuple[Chain, Frames] | None:
    """The chain and the last frame of the timeline that stays."""
    timeline, aside = directory / "timeline.zarr", directory / ASIDE
    here, other = _last(timeline), _last(aside)
    if other is not None and (here is None or _left(*other) < _left(*here)):
        bring_back(directory, other[0])
        here = other
    rmtree(aside, ignore_errors=True)
    return here


def _last(path: FilePath) -> tuple[Chain, Frames] | None:
    try:
        timeline = Timeline.open(path)
        if not len(timeline):
            return None
        return timeline.chain, timeline.frames(len(timeline) - 1)
    except (TimelineError, OSError, ValueError, KeyError):
        return None


def _left(chain: Chain, last: Frames) -> float:
    """What is left of the folded chain's bends; nothing once it was straight and folds again."""
    if last.phase[-1] != EXPLOSION:
        return 0.0
    return share_bent(chain, last)
