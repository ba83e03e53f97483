"""Placements: ways in which a lattice can be laid over a solid, roughly the most promising first.

They are compared by the best set of cells, which need not have a path: no path is better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.core import FULL, best_overlap, count_in_tetrahedra, count_points
from foldback.planner.core.structures import CLOSED
from foldback.planner.path_fit.cloud import Clouds
from foldback.planner.shapes.inside_points import turned

MARGIN: Final = 2
"""Number of empty cells around a solid that a path may use."""
SHIFTS: Final = tuple(np.array(shift) / 4.0 for shift in product(range(4), repeat=3))
"""Shifts of the lattice that are tried for the upright solid, in periods."""
FEW_SHIFTS: Final = tuple(np.array(shift) / 2.0 for shift in product(range(2), repeat=3))
"""Shifts of the lattice that are tried for other orientations, in periods."""
CLIMB_PITCH, CLIMB_SHIFT = 0.025, 0.25
"""Largest random steps of the pitch, relative, and of each shift, in periods, at first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lattice:
    """Places for modules.

    Attributes:
        count: Kernel that counts the points in each place, by flat indices of the places.
        shape: Number of places at each point of the grid, as the further axes of an array of them.
        volume: Volume of a module, in cubes of the pitch.
        period: Shift by which the lattice repeats along each axis, in pitches.
    """

    count: Callable[[Array, int, float, Array, Ints], Ints]
    shape: tuple[int, ...]
    volume: float
    period: int


CUBES: Final = Lattice(count=count_points, shape=(), volume=1.0, period=1)
TETRAHEDRA: Final = Lattice(count=count_in_tetrahedra, shape=(3,), volume=2.0 / 3.0, period=2)
"""Tetrahedra, of which the pitch is the distance of two nodes; see ``planner/core/trails.cpp``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turn:
    """Rotation of a solid.

    Attributes:
        rotation: (3, 3) rotation.
        pitches: Edges of cells that are tried, in the solid's units.
        is_upright: True if the solid stands as in its file.
    """

    rotation: Array
    pitches: tuple[float, ...]
    is_upright: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """A lattice over a solid: a point x lies in the cell ``floor(R x / pitch + offset)``.

    Attributes:
        turn: Rotation of the solid, R.
        pitch: Edge of a cell, in the solid's units.
        offset: (3,) shift, in cells.
        fill: (X, Y, Z) share of each cell inside the solid, in 1/``FULL``; ``CLOSED`` at the rim.
            Of tetrahedra, (X, Y, Z, 3): from each node one step along each axis.
        volume: Volume of the solid, in cells.
        worth: (X, Y, Z) like ``fill``, but a wall that is much thinner than a cell counts as thick
            as a cell: a cell with a whole wall through it is worth ``FULL``.
        needed: Sum of ``worth``, in cells.
        bound: IoU of the best set of cells, by ``worth``.
    """

    turn: Turn
    pitch: float
    offset: Array
    fill: Ints
    volume: float
    worth: Ints
    needed: float
    bound: float

    def cells_of(self, path: Ints) -> Ints:
        """Return the (n, 3) cells of flat indices."""
        return np.stack(np.unravel_index(path, self.fill.shape), axis=1).astype(np.int64)

    def steps(self) -> Ints:
        """Return the (6,) differences of flat indices to the neighbours; +z and −z come last."""
        y, z = self.fill.shape[1:3]
        return np.array([y * z, -y * z, z, -z, 1, -1], dtype=np.int64)

    def overlap(self, path: Ints) -> float:
        """Return the intersection over union of a path's cells with the solid."""
        return _iou(self.fill, self.volume, path)

    def score(self, path: Ints) -> float:
        """Return the same by ``worth``."""
        return _iou(self.worth, self.needed, path)


def _iou(fill: Ints, volume: float, path: Ints) -> float:
    shared = float(fill.reshape(-1)[path].sum()) / FULL
    return shared / (volume + len(path) - shared)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pose:
    """Pitch, (3,) shift of the lattice from the corner of the solid's box in cells, and bound."""

    pitch: float
    shift: Array
    bound: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counts:
    """Numbers of cells that a path may have.

    Attributes:
        low: Smallest number.
        high: Largest number.
    """

    low: int
    high: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _TurnedCloud:
    """Points of a turned solid, and the cells that they are counted in.

    Attributes:
        points: (p, 3) points, from ``corner``; rounding may put some a little lower.
        corner: (3,) lowest corner of the turned solid's box.
        extents: (3,) size of that box.
        volume_per_point: Volume that a point stands for.
        wall: Same as in ``Clouds``.
        counts: Numbers of cells.
        lattice: The cells.
    """

    points: Array
    corner: Array
    extents: Array
    volume_per_point: float
    wall: float
    counts: Counts
    lattice: Lattice

    def tally(
        self, pitch: float, shift: Array, *, stride: int = 1, margin: int = 0
    ) -> tuple[Ints, Ints]:
        """Count every ``stride``-th point; return the points in each cell, and the grid's size."""
        period = self.lattice.period
        span = np.ceil(self.extents / pitch).astype(np.int64) + 2 * margin + 4 * period
        tally = self.lattice.count(self.points, stride, pitch, shift + margin + period, span)
        return tally, span

    def bound(self, pitch: float, shift: Array, stride: int = 1) -> float:
        """Return the IoU of the best cells of a pose, by every ``stride``-th point."""
        tally, _ = self.tally(pitch, shift, stride=stride)
        counted = -(-len(self.points) // stride)
        return self.best(tally, pitch, counted)

    def best(self, tally: Ints, pitch: float, counted: int) -> float:
        """Return the IoU of the best cells, of which each contains so many points.

        Args:
            tally: (m,) points in each cell.
            pitch: Edge of a cell.
            counted: Number of points that were counted.
        """
        full = self.lattice.volume * pitch**3 / self.volume_per_point * counted / len(self.points)
        total = float(counted)
        if self.wall < pitch:
            full *= self.wall / pitch
            total = float(np.minimum(tally, full).sum())
        return best_overlap(tally, full, total, self.counts.low, self.counts.high)


def best_placements(
    clouds: Clouds,
    counts: Counts,
    turn: Turn,
    *,
    min_bound: float,
    rng: np.random.Generator,
    lattice: Lattice = CUBES,
) -> Iterator[Placement]:
    """Yield placements of a turned solid: of each pitch the best shift, both improved.

    The pitch that was best before the improvements comes first.

    Args:
        clouds: The solid.
        counts: Numbers of cells.
        turn: The rotation and its pitches.
        min_bound: Smallest bound of the best pose before it is improved; else there are none.
        rng: Random numbers.
        lattice: The cells.
    """
    vertices = turned(clouds.vertices, turn.rotation)
    corner = vertices.min(axis=0)
    rough, fine = (
        _TurnedCloud(
            points=turned(inside.points, turn.rotation) - corner,
            corner=corner,
            extents=vertices.max(axis=0) - corner,
            volume_per_point=inside.volume / len(inside.points),
            wall=clouds.wall,
            counts=counts,
            lattice=lattice,
        )
        for inside in (clouds.rough, clouds.fine)
    )
    stride = max(1, len(rough.points) // 6_000)
    shifts = [lattice.period * shift for shift in (SHIFTS if turn.is_upright else FEW_SHIFTS)]
    poses: list[_Pose] = []
    for pitch in turn.pitches:
        bounds = [rough.bound(pitch, shift, stride) for shift in shifts]
        best = int(np.argmax(bounds))
        poses.append(_Pose(pitch=pitch, shift=shifts[best], bound=bounds[best]))
    poses.sort(key=lambda pose: -pose.bound)
    if poses[0].bound < min_bound:
        return
    for pose in poses:
        yield _filled(fine, turn, _climbed(rough, pose, rng))


def _climbed(cloud: _TurnedCloud, pose: _Pose, rng: np.random.Generator) -> _Pose:
    """Improve a pitch and shift by random steps, which get smaller."""
    period = cloud.lattice.period
    best = _Pose(pitch=pose.pitch, shift=pose.shift, bound=cloud.bound(pose.pitch, pose.shift))
    width = 1.0
    for k in range(120):
        steps = rng.uniform(-width, width, 4)
        pitch = best.pitch * (1.0 + CLIMB_PITCH * float(steps[0]))
        shift = (best.shift + period * CLIMB_SHIFT * steps[1:]) % period
        bound = cloud.bound(pitch, shift)
        if bound > best.bound:
            best = _Pose(pitch=pitch, shift=shift, bound=bound)
        elif k % 12 == 11:
            width = max(0.15, 0.8 * width)
    return best


def _filled(cloud: _TurnedCloud, turn: Turn, pose: _Pose) -> Placement:
    """Fill the cells of a pose."""
    pitch, points, lattice = pose.pitch, cloud.points, cloud.lattice
    tally, span = cloud.tally(pitch, pose.shift, margin=MARGIN)
    full = lattice.volume * pitch**3 / cloud.volume_per_point
    fill, worth = (
        np.minimum(np.rint(tally * (FULL / points_in_full)), FULL)
        .astype(np.int64)
        .reshape((*span.tolist(), *lattice.shape))
        for points_in_full in (full, full * min(1.0, cloud.wall / pitch))
    )
    volume = len(points) / full
    needed = float(worth.sum()) / FULL if cloud.wall < pitch else volume
    for axis in range(3):
        for cells in (fill, worth):
            rim = np.moveaxis(cells, axis, 0)
            rim[0] = CLOSED
            rim[-lattice.period :] = CLOSED
    return Placement(
        turn=turn,
        pitch=pitch,
        offset=pose.shift + MARGIN + lattice.period - cloud.corner / pitch,
        fill=fill,
        volume=volume,
        worth=worth,
        needed=needed,
        bound=cloud.best(tally, pitch, len(points)),
    )
