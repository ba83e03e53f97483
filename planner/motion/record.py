"""Record: the result of an explosion, the paper's list of angle snapshots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path as FilePath
from typing import Any, Final, Literal

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.motion.angle_encoding import packed_frames, unpacked_frames
from foldback.planner.motion.failure_schemas import SpentKind
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.timeline import Timeline
from foldback.planner.reasons import Reason
from foldback.planner.storage.array_files import save_npz
from foldback.planner.storage.file_names import TIMELINE

RecordStatus = Literal["straight", "stalled", "diverged", "cancelled", "timeout"]


@dataclass(frozen=True, slots=True)
class Spent:
    """Limit that ended an explosion.

    Attributes:
        kind: Name of the limit.
        allowed, used: Number of what it counts. ``used`` is one more than ``allowed`` where the run
            goes on until the limit is exceeded.
    """

    kind: SpentKind
    allowed: int
    used: int

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of an ``.npz`` file."""
        return {f"spent_{name}": np.array(value) for name, value in asdict(self).items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> Spent | None:
        """Return the inverse of ``arrays``; None if there is none."""
        if "spent_kind" not in arrays:
            return None
        return cls(**{f.name: arrays[f"spent_{f.name}"].item() for f in fields(cls)})


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRecord:
    """Refusals of an explosion on a table, and the bound of the static torque that it kept.

    Attributes:
        bound: Upper bound of the static torque of all frames, w·p.
        taken_back: Number of times that frames were taken back.
        raised: Times at which the bound was raised, s, and the new bounds, w·p.
        friction: μ between modules and floor.
    """

    bound: float
    taken_back: int
    raised: tuple[tuple[float, float], ...]
    friction: float

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of an ``.npz`` file."""
        return {
            "table_bound": np.array(self.bound),
            "table_taken_back": np.array(self.taken_back),
            "table_raised": np.array(self.raised, dtype=np.float64).reshape(-1, 2),
            "table_friction": np.array(self.friction),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, Any]) -> TableRecord | None:
        """Return the inverse of ``arrays``; None if there is none."""
        if "table_bound" not in arrays:
            return None
        return cls(
            bound=float(arrays["table_bound"]),
            taken_back=int(arrays["table_taken_back"]),
            raised=tuple((float(frame), float(bound)) for frame, bound in arrays["table_raised"]),
            friction=float(arrays["table_friction"]),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """Outcome of an explosion. A failed one is data too.

    Attributes:
        status: ``straight`` if the chain became straight, else the kind of failure.
        reason: Reason why it is not straight; None if it is.
        frames: Snapshots from folded on; the last one is straight if the status says so.
        steps: Number of simulation steps; of states whose turns were tried, if no turns were found.
        seconds: Wall time, s.
        strategy: Name of the strategy, see ``planner.explosion.strategies``.
        pushes: Number of pulses in a row without progress at the end.
        retries: Number of returns to the last checkpoint at the end.
        snapshots_rad: (S, J) hinge angles of all snapshots, in whole steps, where these are more
            than the frames: as published, which keeps one every few steps. Playback follows them.
        table: Refusals and bound of an explosion on a table; None for one that floats.
        rest_frames: Frames at which the chain rests between two turns, and the first and last one;
            between them hinges turn evenly. None if it does not rest.
        spent: Limit that ended the explosion; None if it ended straight or was cancelled.
    """

    status: RecordStatus
    reason: Reason | None
    frames: Motion
    steps: int
    seconds: float
    strategy: str = "simultaneous"
    pushes: int = 0
    retries: int = 0
    snapshots_rad: Array | None = None
    table: TableRecord | None = None
    rest_frames: Ints | None = None
    spent: Spent | None = None

    def summary(self) -> dict[str, Any]:
        """Return the figures without the frames."""
        return {
            "status": self.status,
            "reason": self.reason and self.reason.as_dict(),
            "steps": self.steps,
            "frames": len(self.frames),
            "seconds": self.seconds,
            "strategy": self.strategy,
        }

    def save(self, path: FilePath, *, frames: bool = True) -> None:
        """Write an ``.npz`` that is either complete or absent.

        Args:
            path: Path of the file.
            frames: False if the timeline beside it holds the frames.
        """
        save_npz(
            path,
            {
                "status": np.array(self.status),
                "reason": np.array("" if self.reason is None else self.reason.as_text()),
                **{name: np.array(getattr(self, name)) for name in _SCALARS},
                **({} if self.table is None else self.table.arrays()),
                **({} if self.spent is None else self.spent.arrays()),
                **({} if self.rest_frames is None else {"rest_frames": self.rest_frames}),
                **(self.frames.columns() if frames else {}),
                **(
                    {}
                    if self.snapshots_rad is None
                    else packed_frames("snapshots_rad", self.snapshots_rad)
                ),
            },
        )

    @classmethod
    def load(cls, path: FilePath, timeline: FilePath | None = None) -> Record:
        """Read a file that ``save`` wrote.

        Args:
            path: Path of the file.
            timeline: Path of the timeline; the one beside it if None.
        """
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = dict(file)
            packed = any(name.startswith("snapshots_rad") for name in arrays)
            if "time_s" in arrays:
                frames = Motion.from_columns(arrays)
            else:
                frames = Timeline.open(timeline or path.with_name(TIMELINE)).explosion()
            return cls(
                frames=frames,
                snapshots_rad=unpacked_frames(arrays, "snapshots_rad") if packed else None,
                table=TableRecord.of(arrays),
                spent=Spent.from_arrays(arrays),
                rest_frames=arrays.get("rest_frames"),
                status=arrays["status"].item(),
                reason=Reason.from_text(arrays["reason"].item()),
                **{name: arrays[name].item() for name in _SCALARS},
            )


_SCALARS: Final = ("steps", "seconds", "strategy", "pushes", "retries")
"""Figures of a record that its file holds by name."""
