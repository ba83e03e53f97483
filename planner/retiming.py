"""Retiming: the time stamps at which a robot with given joints passes along a plan.

The path is the plan's own, straight from frame to frame, with its corners cut, for at a corner no
finite acceleration would do: on either side of a frame, up to the middle of the shorter of its two
steps, a parabola takes the place of the two straight lines. It is farthest from them at the frame;
``Trajectory.deviation_rad`` says how far.
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
Indices = NDArray[np.int64]
CELLS: Final = 2
"""Cells of the grid on either side of a frame, and on the straight line between two; with more of
them a motion gets faster by a fraction of a per cent."""
FEWEST_CELLS: Final = 200
"""About as many cells has a path of few frames."""
STILL_RAD: Final = 1e-6
"""Frames between which no hinge turns more than this count as one."""
TINY: Final = 1e-6
"""Straight pieces that are no longer than this part of their step are left out."""
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
        path: Where it leads.
        knot_times_s: (N + 1,) when it passes the path's knots; s̈ is constant between two.
        knot_rates: (N + 1,) ṡ at the knots.
        frame_numbers: (2 K,) for each of the K corners of the path the first and the last of the
            plan's frames that are there.
    """

    joint_names: tuple[str, ...]
    time_s: Array
    joint_angles_rad: Array
    joint_speeds_rad_s: Array
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

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Angles, speeds and accelerations at (T,) times, each (T, J).

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
        """(T,) place in the plan at (T,) times, as a frame number; 0.5 is between two.

        Of frames in which nothing moves it is the last, but 0 in the beginning.
        """
        _, s, _, _ = self._along(np.asarray(time_s, dtype=np.float64))
        found = np.interp(s, np.repeat(self.path.places, 2), self.frame_numbers)
        return np.where(s > 0.0, found, 0.0)

    def _along(self, times: Array) -> tuple[Indices, Array, Array, Array]:
        """Cell, s, ṡ and s̈, the last of which is constant within a cell."""
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
    """A way along straight lines with its corners cut.

    s is the way from frame to frame, a step counting as its largest hinge motion. With σ = s − s_k,
    k being the frame of a cell, r the reach of its cut, and a, b the slopes before and after::

        q(s) = q_k + a σ + (b − a) (σ + r)² / 4r

    Attributes:
        frames: (K, J) the corners.
        places: (K,) s of the corners.
        slopes: (K − 1, J) dq/ds between them.
        knots: (N + 1,) s of the ends of all cells.
        frame, left, right: (N,) frame of each cell, and which slopes are before and after it; twice
            the same on a straight line.
        reach: (N,) r of each cell.
        cells: Cells to a piece.
    """

    frames: Array
    places: Array
    slopes: Array
    knots: Array
    frame: Indices
    left: Indices
    right: Indices
    reach: Array
    cells: int

    @classmethod
    def through(cls, frames: Array) -> CutPath:
        """The path through (K, J) frames, no two neighbours of which are the same."""
        steps = np.diff(frames, axis=0)
        lengths = np.abs(steps).max(axis=1)
        places = np.concatenate([[0.0], np.cumsum(lengths)])
        count = max(CELLS, -(-FEWEST_CELLS // len(steps)))
        reach = np.zeros(len(frames))
        reach[1:-1] = 0.5 * np.minimum(lengths[1:], lengths[:-1])
        ends: list[Array] = [np.zeros(1)]
        cells: list[tuple[int, int, int, float]] = []

        def piece(step: float, to: float, *cell: float) -> None:
            if to - ends[-1][-1] > TINY * step:
                ends.append(np.linspace(ends[-1][-1], to, count + 1)[1:])
                cells.extend([cell] * count)  # pyright: ignore[reportArgumentType]

        for k in range(len(steps)):
            piece(lengths[k], places[k] + reach[k], k, k - 1, k, reach[k])
            piece(lengths[k], places[k + 1] - reach[k + 1], k, k, k, 1.0)
            piece(lengths[k], places[k + 1], k + 1, k, k + 1, reach[k + 1])
        indices = np.array([cell[:3] for cell in cells], dtype=np.int64)
        return cls(
            frames=frames,
            places=places,
            slopes=steps / lengths[:, None],
            knots=np.concatenate(ends),
            frame=indices[:, 0],
            left=indices[:, 1],
            right=indices[:, 2],
            reach=np.array([cell[3] for cell in cells]),
            cells=count,
        )

    def at(self, cell: Indices, s: Array) -> tuple[Array, Array, Array]:
        """q, q' and q'' at (T,) places in (T,) cells, each (T, J)."""
        along = (s - self.places[self.frame[cell]])[:, None]
        reach = self.reach[cell][:, None]
        before = self.slopes[self.left[cell]]
        turn = self.slopes[self.right[cell]] - before
        angles = (
            self.frames[self.frame[cell]]
            + before * along
            + turn * (along + reach) ** 2 / (4.0 * reach)
        )
        return angles, before + turn * (along + reach) / (2.0 * reach), turn / (2.0 * reach)

    def at_knots(self) -> Array:
        """(N + 1, J) q at all knots."""
        cells = np.arange(len(self.knots) - 1)
        last = self.at(cells[-1:], self.knots[-1:])[0]
        return np.concatenate([self.at(cells, self.knots[:-1])[0], last])

    def deviation(self) -> float:
        """The farthest that any hinge is from the straight lines, at a corner: r (b − a) / 4."""
        cuts = np.abs(self.slopes[self.right] - self.slopes[self.left]).max(axis=1)
        return float((self.reach * cuts).max() / 4.0)


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
    corners = np.ascontiguousarray(frames[kept])
    corners[-1] = frames[-1]  # so that the end is exact
    path = CutPath.through(corners)
    lengths = np.diff(path.knots)
    middle = path.places[path.frame]
    ends = np.stack([path.knots[:-1] - middle, path.knots[1:] - middle], axis=1)
    x = fastest_profile(
        path.slopes,
        path.left,
        path.right,
        0.5 + 0.5 * ends / path.reach[:, None],
        lengths,
        float(max_speed_rad_s),
        float(max_acceleration_rad_s2),
    )
    rates = np.sqrt(x)
    times = np.concatenate([[0.0], np.cumsum(2.0 * lengths / (rates[1:] + rates[:-1]))])
    # Frames that were left out are passed at the same moment as those before them.
    owner = np.searchsorted(kept, np.arange(len(frames)), side="right") - 1
    last = np.append(kept[1:], len(frames)) - 1
    passed = np.interp(path.places, path.knots, times)[owner]
    cell = np.clip(np.searchsorted(path.knots, path.places) - 1, 0, len(lengths) - 1)
    angles, slopes, _ = path.at(cell, path.places)
    speeds = slopes * np.interp(path.places, path.knots, rates)[:, None]
    return Trajectory(
        joint_names=joint_names,
        time_s=passed,
        joint_angles_rad=angles[owner],
        joint_speeds_rad_s=speeds[owner],
        max_speed_rad_s=float(max_speed_rad_s),
        max_acceleration_rad_s2=float(max_acceleration_rad_s2),
        deviation_rad=path.deviation() + (len(kept) < len(frames)) * STILL_RAD,
        path=path,
        knot_times_s=times,
        knot_rates=rates,
        frame_numbers=np.stack([kept, last], axis=1).ravel().astype(np.float64),
    )


def clearance(trajectory: Trajectory, chain: Chain, *, size: float) -> float:
    """The least clearance of modules along a trajectory, in pitches; see ``planner.sweep``.

    It is looked at at each frame and where its corners begin and end. Straight lines between those
    places are within a quarter of ``deviation_rad`` of the path.

    Args:
        trajectory: Of this chain.
        chain: The chain.
        size: Module size as a fraction of the pitch.
    """
    path = trajectory.path
    return sweep(chain, path.at_knots()[:: path.cells], size=size).clearance


def _moving(frames: Array) -> Indices:
    """(K,) numbers of the first frame, and of those that differ from the one kept before."""
    kept: list[int] = []
    for k in range(len(frames)):
        if not kept or np.abs(frames[k] - frames[kept[-1]]).max() > STILL_RAD:
            kept.append(k)
    return np.array(kept, dtype=np.int64)
