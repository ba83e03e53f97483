"""Refused: of several plans that the certificate refused, the one that came closest is shown.

When another way is tried, the plan at hand goes aside with its record, playback and timeline. It
comes back when nothing that is tried later is verified, or comes closer. Each step is a rename, and
one that was cut off goes on where it was.
"""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from shutil import copyfile, rmtree
from typing import Any, Final

from planner.certificate.certificate import Certificate

ASIDE: Final = "refused"
_COMING: Final = "refused.part"
_GOING: Final = "refused.back"
_MOVED: Final = ("certificate.json", "playback.npz", "timeline.zarr", "record.npz")
_COPIED: Final = "chain.json"
"""Readers want it all the time."""


def put_aside(directory: FilePath) -> None:
    """Puts a plan aside that was refused, unless one that came closer is there already."""
    coming, aside = directory / _COMING, directory / ASIDE
    if not coming.exists():
        if not ((directory / "record.npz").exists() and (directory / "playback.npz").exists()):
            return
        begun = directory / f"{_COMING}.new"
        rmtree(begun, ignore_errors=True)
        begun.mkdir()
        copyfile(directory / _COPIED, begun / _COPIED)
        begun.rename(coming)
    for name in _MOVED:
        if (directory / name).exists() and not (coming / name).exists():
            (directory / name).rename(coming / name)
    if aside.exists() and _clearance(aside) >= _clearance(coming):
        rmtree(coming)
        return
    rmtree(aside, ignore_errors=True)
    coming.rename(aside)


def bring_back(directory: FilePath, than: Certificate | None = None) -> bool:
    """Brings the plan back that was put aside, if there is one.

    Args:
        directory: Of the fold.
        than: Of the plan at hand; that stays if it came as close. None for a fold without one.
    """
    aside, going = directory / ASIDE, directory / _GOING
    if (directory / _COMING).exists():
        put_aside(directory)
    if aside.exists() and not going.exists():
        if than is not None and closest(than.as_dict()) >= _clearance(aside):
            drop(directory)
            return False
        aside.rename(going)
    return finish(directory)


def finish(directory: FilePath) -> bool:
    """Goes on with what ``bring_back`` has begun; whether it had, until ``drop`` is called."""
    going = directory / _GOING
    if not going.exists():
        return False
    for name in (_COPIED, *_MOVED):
        there = going / name
        if there.exists():
            if there.is_dir():
                rmtree(directory / name, ignore_errors=True)
            there.replace(directory / name)
    return True


def drop(directory: FilePath) -> None:
    """Forgets what was put aside."""
    for name in (ASIDE, _COMING, _GOING):
        rmtree(directory / name, ignore_errors=True)


def closest(certificate: dict[str, Any]) -> float:
    """The least clearance of a plan and its simulated playback; −∞ where it is not known."""
    plan, playback = (certificate.get(name) for name in ("min_clearance", "min_clearance_playback"))
    if plan is None:
        return float("-inf")
    return float(plan) if playback is None else min(float(plan), float(playback))


def _clearance(place: FilePath) -> float:
    path = place / "certificate.json"
    return closest(json.loads(path.read_bytes())) if path.exists() else float("-inf")
