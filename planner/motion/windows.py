"""Windows: snapshots of a long chain of which one stretch is neither folded nor straight.

Below its window a chain is folded, above it straight: a snapshot holds the angles in between. So
the memory of a long fold grows with the number of moving hinges, and not with that of all hinges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.rotations import wxyz_from_matrix
from planner.motion.frames import PHASES, Frames

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
EXPLOSION: Final = PHASES.index("explosion")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Windows:
    """F snapshots in the order of time; (V,) angles of all their windows together.

    Angles are single precision, and it is these very numbers that are verified.

    Attributes:
        time_s: (F,) time, rising.
        phase: (F,) uint8 index into ``PHASES``.
        first: (F,) hinge at which the window begins; all before it are folded.
        offsets: (F + 1,) start of each window in ``angles_rad``; all hinges after it are 0.
        angles_rad: (V,) float32 hinge angles.
        base_position: (F, 3) centre of module 0 in pitches.
        base_wxyz: (F, 4) orientation of module 0.
        errors_rad: (V,) float32 joint errors, those of the other hinges being 0; None if no error
            is recorded.
    """

    time_s: Array
    phase: NDArray[np.uint8]
    first: Ints
    offsets: Ints
    angles_rad: NDArray[np.float32]
    base_position: Array
    base_wxyz: Array
    errors_rad: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, index: slice | NDArray[np.integer[Any]]) -> Windows:
        """Return some of the snapshots."""
        numbers = np.arange(len(self))[index]
        errors = self.errors_rad
        return Windows(
            errors_rad=None if errors is None else self._of_frames(errors, numbers),
            time_s=self.time_s[numbers],
            phase=self.phase[numbers],
            first=self.first[numbers],
            offsets=np.concatenate([[0], np.cumsum(np.diff(self.offsets)[numbers])]),
            angles_rad=self._of_frames(self.angles_rad, numbers),
            base_position=self.base_position[numbers],
            base_wxyz=self.base_wxyz[numbers],
        )

    def _of_frames(
        self, values: NDArray[np.float32], numbers: NDArray[np.integer[Any]]
    ) -> NDArray[np.float32]:
        """Return those of (V,) values that belong to the given snapshots."""
        parts = [values[self.offsets[k] : self.offsets[k + 1]] for k in numbers]
        return np.concatenate([np.zeros(0, np.float32), *parts])

    @property
    def last(self) -> Ints:
        """(F,) hinge behind each window: it and all that follow are straight."""
        return self.first + np.diff(self.offsets)

    @classmethod
    def joined(cls, parts: Sequence[Windows]) -> Windows:
        """Concatenate windows."""
        lengths = np.concatenate([np.diff(part.offsets) for part in parts])
        plain = ("time_s", "phase", "first", "angles_rad", "base_position", "base_wxyz")
        known = any(part.errors_rad is not None for part in parts)
        return cls(
            offsets=np.concatenate([[0], np.cumsum(lengths)]),
            errors_rad=np.concatenate([part.errors for part in parts]) if known else None,
            **{name: np.concatenate([getattr(p, name) for p in parts]) for name in plain},
        )

    @property
    def errors(self) -> NDArray[np.float32]:
        """(V,) joint errors of the windows, NaN if none is recorded."""
        if self.errors_rad is None:
            return np.full(len(self.angles_rad), np.nan, dtype=np.float32)
        return self.errors_rad

    @property
    def recorded(self) -> NDArray[np.bool_]:
        """(F,) True if joint errors are recorded; an empty window counts, except in explosions."""
        found = np.zeros(len(self), dtype=bool)
        if self.errors_rad is not None:
            known = np.isfinite(self.errors_rad)
            some = np.diff(self.offsets) > 0
            found[some] = np.logical_and.reduceat(known, self.offsets[:-1][some])
            found[~some] = self.phase[~some] != EXPLOSION
        return found

    @property
    def largest_errors(self) -> Array:
        """(F,) largest joint error of each snapshot, NaN if none is recorded."""
        found = np.where(self.recorded, 0.0, np.nan)
        some = np.flatnonzero(np.diff(self.offsets))
        if self.errors_rad is not None and len(some):
            found[some] = np.maximum.reduceat(self.errors_rad, self.offsets[some])
        return found

    @classmethod
    def of(cls, chain: Chain, frames: Frames) -> Windows:
        """Convert frames of all angles to the shortest windows, in single precision.

        Angles count as folded or straight when they are so in single precision.
        """
        angles = frames.joint_angles_rad.astype(np.float32)
        moved = angles != chain.folded_rad.astype(np.float32)
        first = np.where(moved.any(axis=1), moved.argmax(axis=1), angles.shape[1])
        bent = angles != 0.0
        last = np.where(bent.any(axis=1), angles.shape[1] - bent[:, ::-1].argmax(axis=1), 0)
        last = np.maximum(last, first)
        poses = chain.poses(angles.astype(np.float64), frames.root_position, frames.root_wxyz)
        return cls(
            time_s=frames.time_s,
            phase=frames.phase,
            first=first.astype(np.int64),
            offsets=np.concatenate([[0], np.cumsum(last - first)]).astype(np.int64),
            angles_rad=np.concatenate(
                [np.zeros(0, np.float32)]
                + [row[a:b] for row, a, b in zip(angles, first, last, strict=True)]
            ),
            base_position=poses.positions[:, 0],
            base_wxyz=poses.wxyzs[:, 0],
        )

    def angles(self, chain: Chain, start: int = 0, stop: int | None = None) -> Array:
        """Return all (f, J) angles of the snapshots ``start`` to ``stop``, rad."""
        numbers = range(len(self))[start:stop]
        found = np.zeros((len(numbers), len(chain.folded_rad)))
        for row, k in zip(found, numbers, strict=True):
            a, b = int(self.first[k]), int(self.offsets[k + 1] - self.offsets[k])
            row[:a] = chain.folded_rad[:a]
            row[a : a + b] = self.angles_rad[self.offsets[k] : self.offsets[k + 1]]
        return found

    def joint_errors(self, chain: Chain, start: int = 0, stop: int | None = None) -> Array:
        """Return (f, J) joint errors of the snapshots ``start`` to ``stop``, NaN if not recorded.

        If those of a window are recorded, the errors of the other hinges are 0.
        """
        some = self[start:stop]
        found = np.full((len(some), len(chain.folded_rad)), np.nan)
        for k in np.flatnonzero(some.recorded):
            part = some.errors[some.offsets[k] : some.offsets[k + 1]]
            found[k] = 0.0
            found[k, some.first[k] : some.first[k] + len(part)] = part
        return found

    def passes_as(self, other: Windows) -> bool:
        """Return True if both pass exactly the same angles, at any times and poses."""
        return all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("first", "offsets", "angles_rad")
        )

    def steps(self, chain: Chain, *, fraction: float = 0.0) -> tuple[Array, Ints]:
        """Return the largest step, and the number of moving hinges, from snapshot to snapshot.

        Args:
            chain: The chain.
            fraction: Minimum step of a moving hinge as a fraction of the largest one.

        Returns:
            (F − 1,) largest steps, rad, and (F − 1,) numbers of moving hinges.
        """
        from planner.kernels.windows import window_steps  # a compiler: only for who computes

        count = max(0, len(self) - 1)
        largest, moving = np.zeros(count), np.zeros(count, dtype=np.int64)
        window_steps(
            self.first,
            self.offsets,
            self.angles_rad,
            chain.folded_rad,
            fraction,
            largest,
            moving,
        )
        return largest, moving

    def dense(self, chain: Chain, start: int = 0, stop: int | None = None) -> Frames:
        """Return the snapshots ``start`` to ``stop`` with all their angles and errors."""
        part = slice(start, stop)
        angles = self.angles(chain, start, stop)
        poses = forward_kinematics(
            chain.module,
            angles,
            root=0,
            root_position=self.base_position[part],
            root_wxyz=self.base_wxyz[part],
        )
        return Frames(
            time_s=self.time_s[part],
            phase=self.phase[part],
            joint_angles_rad=angles,
            root_position=poses.positions[:, chain.root],
            root_wxyz=wxyz_from_matrix(poses.rotations[:, chain.root]),
            joint_error_rad=self.joint_errors(chain, start, stop),
        )
