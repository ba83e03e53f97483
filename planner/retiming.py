"""Retiming: the time stamps at which a robot with given joints passes along a plan.

The path is the plan's, with its corners cut: frames are the control points of a uniform quadratic
B-spline, which is one of the simplest curves without jumps in speed. It touches the plan's own
motion in the middle between two frames and is farthest from it at a frame, by an eighth of the
second difference of the frames (``Trajectory.deviation_rad``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.errors import InputError
from planner.kernels.retiming import fastest_profile
from planner.plan import Plan
from planner.sweep import sweep

Array = NDArray[np.float64]
CELLS: Final = (16, 8, 4)
"""Cells of the grid from one frame to the next, the most that ``LARGEST_GRID`` allows.

With 4 the motion takes some per cent longer than need be, with 16 half a per cent.
"""
LARGEST_GRID: Final = 20_000_000
"""Cells times hinges."""
STILL_RAD: Final = 1e-6
"""Frames between which no hinge turns more than this count as one."""
BOUNDS: Final = (1e-6, 1e6)
"""What speeds and accelerations may be, in rad/s and rad/s²."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """A plan's path with times, at rest at both ends.

    Attributes:
        joint_names: (J,) names of the hinges.
        time_s: (F,) when the path passes each frame of the plan.
        joint_angles_rad: (F, J) where the hinges are then.
        joint_speeds_rad_s: (F, J) how fast they turn then.
        max_speed_rad_s, max_acceleration_rad_s2: The bounds that were given.
        deviation_rad: The farthest that any hinge is from the plan's own motion.
        path: Where it leads, through the frames that differ.
        knot_times_s: (N + 1,) times between which s̈ is constant, ``cells`` to a step of the path.
        knot_rates: (N + 1,) ṡ at those times, in steps of the path per second.
        frame_numbers: (K,) numbers of the frames that differ.
    """

    joint_names: tuple[str, ...]
    time_s: Array
    joint_angles_rad: Array
    joint_speeds_rad_s: Array
    max_speed_rad_s: float
    max_acceleration_rad_s2: float
    deviation_rad: float
    path: SmoothPath
    knot_times_s: Array
    knot_rates: Array
    frame_numbers: Array

    @property
    def duration_s(self) -> float:
        """Time from straight to folded."""
        return float(self.knot_times_s[-1])

    @property
    def cells(self) -> int:
        """Cells of the grid from one frame to the next."""
        return (len(self.knot_times_s) - 1) // len(self.path.steps)

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Angles, speeds and accelerations at (T,) times, each (T, J).

        Before the beginning and after the end the chain rests. At a knot, where accelerations may
        jump, that of the following cell is given.
        """
        times = np.asarray(time_s, dtype=np.float64)
        cell, elapsed, within = self._cells_of(times)
        s, rate, change = self._along(cell, elapsed)
        path = self.path
        slope, bend = path.slope(s), path.bend(cell // (self.cells // 2))
        rate, change = np.where(within, rate, 0.0)[:, None], np.where(within, change, 0.0)[:, None]
        return path.angles(s), slope * rate, slope * change + bend * rate**2

    def frame_at(self, time_s: Array) -> Array:
        """(T,) place in the plan at (T,) times, as a frame number; 0.5 is between two."""
        cell, elapsed, _ = self._cells_of(np.asarray(time_s, dtype=np.float64))
        s, _, _ = self._along(cell, elapsed)
        return np.interp(s, np.arange(len(self.path.frames)), self.frame_numbers)

    def _cells_of(self, times: Array) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
        knots = self.knot_times_s
        clipped = np.clip(times, 0.0, knots[-1])
        cell = np.clip(np.searchsorted(knots, clipped, side="right") - 1, 0, len(knots) - 2)
        return cell, clipped - knots[cell], (times >= 0.0) & (times <= knots[-1])

    def _along(self, cell: NDArray[np.int64], elapsed: Array) -> tuple[Array, Array, Array]:
        """s, ṡ and s̈, the last of which is constant within a cell."""
        rates = self.knot_rates
        change = 0.5 * self.cells * (rates[cell + 1] ** 2 - rates[cell] ** 2)
        s = cell / self.cells + elapsed * (rates[cell] + 0.5 * change * elapsed)
        s = np.clip(s, cell / self.cells, (cell + 1) / self.cells)
        return s, np.maximum(rates[cell] + change * elapsed, 0.0), change


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothPath:
    """The quadratic B-spline of (F, J) frames; s runs from 0 to F − 1."""

    frames: Array
    steps: Array

    def angles(self, s: Array) -> Array:
        """(T, J) at (T,) places: the chord to the nearest middle, and the cut of the corner."""
        left = np.clip(s.astype(np.int64), 0, len(self.steps) - 1)
        part = (s - left)[:, None]
        line = (1.0 - part) * self.frames[left] + part * self.frames[left + 1]
        near = np.rint(s).astype(np.int64)
        corner = (near > 0) & (near < len(self.frames) - 1)
        inside = np.clip(near, 1, max(1, len(self.frames) - 2))
        bend = self.bend_at_frame(inside)
        cut = 0.5 * (0.5 - np.abs(s - near)) ** 2
        return line + np.where(corner, cut, 0.0)[:, None] * bend

    def bend_at_frame(self, frame: NDArray[np.int64]) -> Array:
        """(T, J) second difference at inner frames; zero for a path of one step."""
        if len(self.steps) < 2:
            return np.zeros((len(frame), self.frames.shape[1]))
        return self.steps[frame] - self.steps[frame - 1]

    def slope(self, s: Array) -> Array:
        """(T, J) dq/ds."""
        place = np.clip(s - 0.5, 0.0, len(self.steps) - 1)
        left = place.astype(np.int64)
        right = np.minimum(left + 1, len(self.steps) - 1)
        part = (place - left)[:, None]
        return (1.0 - part) * self.steps[left] + part * self.steps[right]

    def bend(self, half: NDArray[np.int64]) -> Array:
        """(T, J) d²q/ds² in (T,) halves of the intervals between frames."""
        frame = (half + 1) // 2
        inner = (frame > 0) & (frame < len(self.steps))
        return np.where(
            inner[:, None], self.bend_at_frame(np.clip(frame, 1, max(1, len(self.steps) - 1))), 0.0
        )


def retime(plan: Plan, max_speed_rad_s: float, max_acceleration_rad_s2: float) -> Trajectory:
    """The fastest way along a plan within bounds on every hinge's speed and acceleration.

    Args:
        plan: A plan with frames.
        max_speed_rad_s: Bound of every hinge's |speed|.
        max_acceleration_rad_s2: Bound of every hinge's |acceleration|.

    Raises:
        InputError: ``bad-bound`` for a bound that is no positive number, ``no-motion`` for a plan
            in which nothing moves.
    """
    return retimed(
        plan.joint_angles_rad, plan.chain.joint_names, max_speed_rad_s, max_acceleration_rad_s2
    )


def retimed(
    frames: Array,
    joint_names: tuple[str, ...],
    max_speed_rad_s: float,
    max_acceleration_rad_s2: float,
) -> Trajectory:
    """The same for (F, J) frames of angles; see ``retime``."""
    for name, unit, value in (
        ("speed", "rad/s", max_speed_rad_s),
        ("acceleration", "rad/s²", max_acceleration_rad_s2),
    ):
        if not BOUNDS[0] <= value <= BOUNDS[1]:
            raise InputError(
                "bad-bound",
                f"got a largest {name} of {value:g} {unit}, expected {BOUNDS[0]:g} to "
                f"{BOUNDS[1]:g}.",
                where=f"max_{name}",
            )
    kept = _moving(frames)
    if len(kept) < 2:
        raise InputError("no-motion", "the plan has no two frames between which a hinge turns.")
    points = np.ascontiguousarray(frames[kept])
    path = SmoothPath(frames=points, steps=np.diff(points, axis=0))
    cells = next((c for c in CELLS if c * path.steps.size <= LARGEST_GRID), CELLS[-1])
    x = fastest_profile(path.steps, cells, float(max_speed_rad_s), float(max_acceleration_rad_s2))
    rates = np.sqrt(x)
    times = np.concatenate([[0.0], np.cumsum(2.0 / cells / (rates[1:] + rates[:-1]))])
    # Frames that were left out are passed at the same moment as those before them.
    owner = np.searchsorted(kept, np.arange(len(frames)), side="right") - 1
    passed = path.angles(np.arange(len(points), dtype=np.float64))
    speeds = path.slope(np.arange(len(points), dtype=np.float64)) * rates[::cells, None]
    return Trajectory(
        joint_names=joint_names,
        time_s=times[::cells][owner],
        joint_angles_rad=passed[owner],
        joint_speeds_rad_s=speeds[owner],
        max_speed_rad_s=float(max_speed_rad_s),
        max_acceleration_rad_s2=float(max_acceleration_rad_s2),
        deviation_rad=float(np.abs(passed - points).max()) + (len(kept) < len(frames)) * STILL_RAD,
        path=path,
        knot_times_s=times,
        knot_rates=rates,
        frame_numbers=kept.astype(np.float64),
    )


def clearance(trajectory: Trajectory, chain: Chain, *, size: float) -> float:
    """The least clearance of modules along a trajectory, in pitches; see ``planner.sweep``.

    It is looked at in steps of half a frame, between which the path is within a 32nd of the second
    difference of the frames from a straight line.

    Args:
        trajectory: Of this chain.
        chain: The chain.
        size: Module size as a fraction of the pitch.
    """
    last = len(trajectory.path.steps)
    return sweep(chain, trajectory.path.angles(np.arange(0, last + 0.25, 0.5)), size=size).clearance


def _moving(frames: Array) -> NDArray[np.int64]:
    """(K,) numbers of the first frame, the last, and those between that differ."""
    kept: list[int] = []
    for k in range(len(frames)):
        if not kept or np.abs(frames[k] - frames[kept[-1]]).max() > STILL_RAD:
            kept.append(k)
    if len(kept) > 1:
        kept[-1] = len(frames) - 1  # so that the end is exact
    return np.array(kept, dtype=np.int64)
