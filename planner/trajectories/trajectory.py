"""Trajectory: a plan's path with time stamps, and the way along straight lines that it follows.

``planner.trajectories.retiming`` makes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array

FRAMES_FILE: Final = "frames.npy"
REST_FILE: Final = "rest.npz"
Indices = NDArray[np.int64]
CORNERS_AT_ONCE: Final = 256
"""Number of corners of a path that are blended in one NumPy call. Larger values take more memory
(all of a long chain's would take a gibibyte); the result is the same."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Path of a plan with times, at rest at both ends.

    Attributes:
        joint_names: (J,) names of the hinges.
        time_s: (F,) time at each frame of the plan.
        max_speed_rad_s, max_acceleration_rad_s2: Bounds of every hinge.
        deviation_rad: Largest distance of any hinge from the plan's own motion.
        path: Path with its corners cut.
        knot_times_s: (N + 1,) times at the path's knots; s̈ is constant between two.
        knot_rates: (N + 1,) ṡ at the knots.
        frame_numbers: (2 K,) first and last frame of the plan at each of the K corners of the path.
    """

    joint_names: tuple[str, ...]
    time_s: Array
    max_speed_rad_s: float
    max_acceleration_rad_s2: float
    deviation_rad: float
    path: CutPath
    knot_times_s: Array
    knot_rates: Array
    frame_numbers: Array

    @property
    def duration_s(self) -> float:
        """Time from straight to folded."""
        return float(self.knot_times_s[-1])

    @property
    def joint_angles_rad(self) -> Array:
        """(F, J) hinge angles at each frame of the plan; computed at every call."""
        return self._at_frames()[0]

    @property
    def joint_speeds_rad_s(self) -> Array:
        """(F, J) hinge speeds at each frame of the plan; computed at every call."""
        return self._at_frames()[1]

    def _at_frames(self) -> tuple[Array, Array]:
        path = self.path
        cell = np.clip(np.searchsorted(path.knots, path.places) - 1, 0, len(path.knots) - 2)
        angles, slopes, _ = path.at(cell, path.places)
        speeds = slopes * np.interp(path.places, path.knots, self.knot_rates)[:, None]
        counts = np.diff(self.frame_numbers.reshape(-1, 2), axis=1).ravel().astype(int) + 1
        return np.repeat(angles, counts, axis=0), np.repeat(speeds, counts, axis=0)

    @property
    def nbytes(self) -> int:
        """Size of its arrays and those of the path, bytes."""
        arrays = (getattr(self, name) for name in _TRAJECTORY_ARRAYS)
        return sum(a.nbytes for a in arrays) + sum(
            getattr(self.path, n).nbytes for n in _PATH_ARRAYS
        )

    def save(self, directory: FilePath) -> None:
        """Write the trajectory to an existing directory."""
        np.save(directory / FRAMES_FILE, self.path.frames)
        np.savez(
            directory / REST_FILE,
            joint_names=np.array(self.joint_names),
            numbers=np.array(
                [self.max_speed_rad_s, self.max_acceleration_rad_s2, self.deviation_rad]
            ),
            cells=self.path.cells,
            **{name: getattr(self, name) for name in _TRAJECTORY_ARRAYS},
            **{name: getattr(self.path, name) for name in _PATH_ARRAYS if name != "frames"},
        )

    @classmethod
    def load(cls, directory: FilePath) -> Trajectory:
        """Read files that ``save`` wrote. The corners of the path stay in their file until used."""
        frames = np.load(directory / FRAMES_FILE, mmap_mode="r", allow_pickle=False)
        with np.load(directory / REST_FILE, allow_pickle=False) as numbers:
            speed, acceleration, deviation = numbers["numbers"].tolist()
            of_path = {name: numbers[name] for name in _PATH_ARRAYS if name != "frames"}
            return cls(
                joint_names=tuple(numbers["joint_names"].tolist()),
                max_speed_rad_s=speed,
                max_acceleration_rad_s2=acceleration,
                deviation_rad=deviation,
                path=CutPath(frames=np.asarray(frames), cells=int(numbers["cells"]), **of_path),
                **{name: numbers[name] for name in _TRAJECTORY_ARRAYS},
            )

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Return angles, speeds and accelerations at (T,) times, each (T, J).

        Before the beginning and after the end the chain rests. At a knot, where accelerations may
        jump, that of the following cell is given.
        """
        times = np.asarray(time_s, dtype=np.float64)
        cell, s, rate, change = self._along(times)
        moving = (times >= 0.0) & (times <= self.duration_s)
        rate, change = np.where(moving, rate, 0.0)[:, None], np.where(moving, change, 0.0)[:, None]
        angles, slope, bend = self.path.at(cell, s)
        return angles, slope * rate, slope * change + bend * rate**2

    def frame_at(self, time_s: Array) -> Array:
        """Return the (T,) frame numbers of the plan at (T,) times; 0.5 is between two.

        Among frames in which nothing moves it is the last one, but 0 at the beginning.
        """
        _, s, _, _ = self._along(np.asarray(time_s, dtype=np.float64))
        frame_numbers = np.interp(s, np.repeat(self.path.places, 2), self.frame_numbers)
        return np.where(s > 0.0, frame_numbers, 0.0)

    def _along(self, times: Array) -> tuple[Indices, Array, Array, Array]:
        """Return cell, s, ṡ and s̈, the last of which is constant within a cell."""
        knots, rates, ends = self.knot_times_s, self.knot_rates, self.path.knots
        clipped = np.clip(times, 0.0, knots[-1])
        cell = np.clip(np.searchsorted(knots, clipped, side="right") - 1, 0, len(knots) - 2)
        elapsed = clipped - knots[cell]
        change = 0.5 * (rates[cell + 1] ** 2 - rates[cell] ** 2) / (ends[cell + 1] - ends[cell])
        s = ends[cell] + elapsed * (rates[cell] + 0.5 * change * elapsed)
        s = np.clip(s, ends[cell], ends[cell + 1])
        return cell, s, np.maximum(rates[cell] + change * elapsed, 0.0), change


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CutPath:
    """Path along straight lines with its corners cut.

    s is the length from frame to frame; a step counts as its largest hinge motion. With
    σ = s − s_k, k being the frame of a cell, r the reach of its cut, and a, b the slopes before and
    after::

        q(s) = q_k + a σ + (b − a) (σ + r)² / 4r

    Attributes:
        frames: (K, J) corners.
        places: (K,) s of the corners.
        lengths: (K − 1,) lengths of the steps between them.
        knots: (N + 1,) s of the ends of all cells.
        frame, left, right: (N,) frame of each cell, and indices of the slopes before and after it;
            equal on a straight line.
        reach: (N,) r of each cell.
        cells: Number of cells of a piece.
    """

    frames: Array
    places: Array
    lengths: Array
    knots: Array
    frame: Indices
    left: Indices
    right: Indices
    reach: Array
    cells: int

    @classmethod
    def through(cls, frames: Array) -> CutPath:
        """Build the path through (K, J) frames, no two neighbours of which are equal."""
        lengths = np.array(
            [np.abs(b - a).max() for a, b in zip(frames[:-1], frames[1:], strict=True)]
        )
        places = np.concatenate([[0.0], np.cumsum(lengths)])
        count = max(2, -(-200 // len(lengths)))  # paths of few frames get a fine grid, too
        reach = np.zeros(len(frames))
        reach[1:-1] = 0.5 * np.minimum(lengths[1:], lengths[:-1])
        ends: list[Array] = [np.zeros(1)]
        cells: list[tuple[int, int, int, float]] = []

        def piece(step: float, to: float, *cell: float) -> None:
            if to - ends[-1][-1] > 1e-6 * step:  # else rounding
                ends.append(np.linspace(ends[-1][-1], to, count + 1)[1:])
                cells.extend([cell] * count)  # pyright: ignore[reportArgumentType]

        for k in range(len(lengths)):
            piece(lengths[k], places[k] + reach[k], k, k - 1, k, reach[k])
            piece(lengths[k], places[k + 1] - reach[k + 1], k, k, k, 1.0)
            piece(lengths[k], places[k + 1], k + 1, k, k + 1, reach[k + 1])
        frame, left, right = np.array([cell[:3] for cell in cells], dtype=np.int64).T.copy()
        return cls(
            frames=frames,
            places=places,
            lengths=lengths,
            knots=np.concatenate(ends),
            frame=frame,
            left=left,
            right=right,
            reach=np.array([cell[3] for cell in cells]),
            cells=count,
        )

    @property
    def slopes(self) -> Array:
        """(K − 1, J) dq/ds between the corners; computed at every call."""
        return self._slopes(np.arange(len(self.lengths)))

    def _slopes(self, steps: Indices) -> Array:
        """Return (T, J) dq/ds on (T,) steps; only those are read if the path is in a file."""
        return (self.frames[steps + 1] - self.frames[steps]) / self.lengths[steps][:, None]

    def at(self, cell: Indices, s: Array) -> tuple[Array, Array, Array]:
        """Return q, q' and q'' at (T,) values of s in (T,) cells, each (T, J)."""
        along = (s - self.places[self.frame[cell]])[:, None]
        reach = self.reach[cell][:, None]
        before = self._slopes(self.left[cell])
        turn = self._slopes(self.right[cell]) - before
        angles = (
            self.frames[self.frame[cell]]
            + before * along
            + turn * (along + reach) ** 2 / (4.0 * reach)
        )
        return angles, before + turn * (along + reach) / (2.0 * reach), turn / (2.0 * reach)

    def deviation(self) -> float:
        """Return the largest distance of a hinge from the straight lines: r (b − a) / 4, rad."""
        cut = self.left != self.right
        corners, first = np.unique(self.frame[cut], return_index=True)
        largest = 0.0
        for start in range(0, len(corners), CORNERS_AT_ONCE):
            part = slice(start, start + CORNERS_AT_ONCE)
            turns = np.abs(self._slopes(corners[part]) - self._slopes(corners[part] - 1))
            largest = max(largest, (self.reach[cut][first[part]] * turns.max(axis=1)).max())
        return float(largest / 4.0)


_TRAJECTORY_ARRAYS: Final = ("time_s", "knot_times_s", "knot_rates", "frame_numbers")
"""Fields of a trajectory whose arrays are saved in its file; the arrays of the trajectory's path
are saved in addition."""
_PATH_ARRAYS: Final = ("frames", "places", "lengths", "knots", "frame", "left", "right", "reach")
"""Fields of a trajectory's path (the joint angles without times) whose arrays are saved in the
trajectory's file."""
