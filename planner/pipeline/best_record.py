"""The best record: of several explosions that failed, the one that came farthest is shown."""

from __future__ import annotations

from pathlib import Path as FilePath
from shutil import copyfile, rmtree
from typing import Final

import numpy as np

from planner.chain.chain import Chain
from planner.errors import PlannerError
from planner.motion.frames import Frames
from planner.motion.record import Record
from planner.pipeline.fold_directory import write_chain_folded

ASIDE: Final = "best.zarr"
HALF: Final = "best.part"


class BestRecord:
    """Looks at one record after the other, whose timeline is in a fold's directory."""

    def __init__(self, directory: FilePath) -> None:
        self._directory = directory
        self._best: tuple[float, Chain, Record] | None = None
        self._last: Record | None = None
        rmtree(directory / ASIDE, ignore_errors=True)

    def look_at(self, chain: Chain, record: Record) -> None:
        """Takes a record as the last one; keeps its timeline if it came farther than all before."""
        left = bent(chain, record)
        self._last = record
        if record.status == "straight":
            self._best = (left, chain, record)
        elif self._best is None or left < self._best[0]:
            self._best = (left, chain, record)
            self._copy()

    def _copy(self) -> None:
        """Keeps a copy of the timeline; half of one would pass for a chain that is straight."""
        aside = self._directory / ASIDE
        half = self._directory / HALF
        for old in (aside, half):
            rmtree(old, ignore_errors=True)
        # Without rights and times, which a computing process may not set.
        timeline = self._directory / "timeline.zarr"
        half.mkdir()
        for path in sorted(timeline.rglob("*")):  # directories come before what they hold
            to = half / path.relative_to(timeline)
            to.mkdir() if path.is_dir() else copyfile(path, to)
        half.rename(aside)

    def keep(self) -> Record:
        """Puts the best one's timeline and chain where they are looked for.

        Raises:
            PlannerError: When there was no record.
        """
        if self._best is None:
            raise PlannerError("no explosion was made; start the fold anew.")
        _, chain, record = self._best
        if record is not self._last:
            bring_back(self._directory, chain)
        rmtree(self._directory / ASIDE, ignore_errors=True)
        return record


def bring_back(directory: FilePath, chain: Chain) -> None:
    """Puts the timeline that was kept aside, and its chain, where they are looked for."""
    timeline = directory / "timeline.zarr"
    rmtree(timeline, ignore_errors=True)
    (directory / ASIDE).rename(timeline)
    write_chain_folded(directory, chain)


def bent(chain: Chain, record: Record) -> float:
    """What is left of the folded chain's bends at a record's end: 1 nothing done, 0 straight."""
    return share_bent(chain, record.frames[-1:].dense(chain))


def share_bent(chain: Chain, last: Frames) -> float:
    """The bends in one frame, as a share of those of the folded chain."""
    left = np.abs(last.joint_angles_rad).sum()
    return float(left / max(np.abs(chain.folded_rad).sum(), 1e-9))
