"""Lattice fits: pitches and orientations in which a solid is laid on the lattice, and the cells.

They are steps of one ladder that belongs to the solid and not to the count that is asked for, so
that what one search finds is found again by another. Nothing in a fit depends on a search.

The inside is sampled several times finer than the cells. Sums over windows of samples then tell for
every offset at once how full each cell would be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, checked_fraction
from planner.kernels.crossings import block_sums, window_histograms, window_sums
from planner.shapes.bridges import Bridged, bridged, parts_of
from planner.shapes.sampling import Sampling, grid_of, sample
from planner.shapes.seams import welded
from planner.shapes.solid import Solid, signed_volume

OFFSETS: Final = 4
"""Offsets along each axis that are tried, in parts of a cell."""
LEVELS: Final = 64
EMPTIEST_KEPT: Final = 0.06
FULLEST_LEFT: Final = 0.65
STEP: Final = 1.0125
PLAIN_SIZE: Final = 4
SMALL_SIZE: Final = 8
LARGEST_SIZE: Final = 16
SMALL_SAMPLES: Final = 250_000
FINE_SAMPLES: Final = 2_000_000
FINER_SAMPLES: Final = 3_000_000
MANY_SAMPLES: Final = 8_000_000
THIN: Final = 2.0
"""Samples that the mean thickness of a solid takes at least."""
BODY_SAMPLES: Final = 1_000_000
MOST_BODY_SAMPLES: Final = 4_000_000
LEAST_BODY: Final = 0.01
ROUGH: Final = 0.12
MANY_TRIANGLES: Final = 20_000
STORED: Final = 64 << 20
"""Bytes of samples that are kept for the next time."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
OffsetThreshold = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LatticeFit:
    """One sampling, judged for every offset and threshold.

    Attributes:
        turn: Number of the orientation.
        pitch: Edge of a cell.
        counts: (o, o, o, T) cells for each offset and threshold, before they are joined.
        ious: (o, o, o, T) their intersection over union with the samples.
        thresholds: (T,) samples that a cell needs.
    """

    turn: int
    pitch: float
    counts: Ints
    ious: Floats
    thresholds: Ints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedCells:
    """Cells in one piece, as one fit has them with one offset and threshold.

    Attributes:
        turn, pitch: Of the fit.
        offset_threshold: The offset along each axis, and the number of the threshold.
        joined: The cells, and what was joined or left out.
        count: How many they are.
        iou: Intersection over union, by finer samples than those that were searched with.
    """

    turn: int
    pitch: float
    offset_threshold: OffsetThreshold
    joined: Bridged
    count: int
    iou: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """A sampling summed up in parts of cells.

    Attributes:
        parts: (X, Y, Z) samples inside each part.
        split: Parts along the edge of a cell.
        size: Samples along it.
        offset: (3,) where the solid's origin went, in samples.
        crossed: Share of the samples inside that the surface goes around more than once.
    """

    parts: NDArray[np.int16]
    split: int
    size: int
    offset: Floats
    crossed: float

    @property
    def count(self) -> int:
        """Samples inside."""
        return int(self.parts.sum(dtype=np.int64))

    def fill(self, offset_threshold: OffsetThreshold) -> NDArray[np.int32]:
        """Return (X, Y, Z) samples in each cell with an offset."""
        sums = window_sums(self.parts, self.split)
        return sums[tuple(slice(at, None, self.split) for at in offset_threshold[:3])]


class Ladder:
    """All fits of a solid; each is made when it is first asked for."""

    def __init__(self, solid: Solid, turns: tuple[Floats, ...]) -> None:
        self.solid = solid
        self.turns = turns
        self.volume = _volume(solid)
        self.thickness = 2.0 * self.volume / _area(solid)
        self.bodies = 1
        self.share = 1.0
        self._apart = False
        self._fits: dict[tuple[int, float], LatticeFit | None] = {}
        self._made: dict[tuple[int, float, OffsetThreshold], FittedCells] = {}
        self._grids: dict[tuple[int, float, int], Grid] = {}
        self._stored = 0
        self._rough: dict[int, Solid] = {}
        self._turned: dict[tuple[int, int], Floats] = {}
        self._bounds = _bounds(solid, turns)
        self._count_bodies()
        self._base = float(np.cbrt(self.volume))

    @property
    def extents(self) -> tuple[Floats, ...]:
        """For each turn (3,) the box of the turned solid."""
        return tuple(high - low for low, high in self._bounds)

    def _count_bodies(self) -> None:
        # A long thin solid that lies askew fits only when it is turned.
        boxes = [float(np.prod(extents)) for extents in self.extents]
        turn = int(np.argmin(boxes))
        edge = max(float(np.cbrt(boxes[turn] / BODY_SAMPLES)), self.thickness / 6.0)
        edge = min(edge, self.thickness / THIN)
        while float(np.prod(grid_of(self.extents[turn], 2.0 * edge, 2))) > MOST_BODY_SAMPLES:
            edge *= 1.25
        sampling = sample(self.solid, pitch=2.0 * edge, size=2, rotation=self.turns[turn])
        numbers, sizes = parts_of(sampling.inside)
        if len(sizes):
            self.bodies = max(1, int((sizes >= LEAST_BODY * sizes.sum()).sum()))
        if self.bodies == 1:
            return
        self.share = checked_fraction(float(sizes.max() / sizes.sum()), "share of the largest body")
        self.volume *= self.share
        body = _around(self.solid, sampling, numbers == int(np.argmax(sizes)) + 1)
        self._apart = len(body) == len(self.solid)
        if not self._apart:
            self.solid = body
            self._bounds = _bounds(body, self.turns)
            if body.oriented:
                self.volume = abs(signed_volume(body.vertices, body.faces)) or self.volume

    def pitch_for(self, cells: int) -> float:
        """Edge of so many cells as large as the solid together."""
        return float(np.cbrt(self.volume / cells))

    def step(self, pitch: float) -> int:
        """Number of the plain step that is nearest to a pitch."""
        return round(float(np.log(pitch / self._base) / np.log(STEP)))

    def pitch_of(self, step: int) -> float:
        """The pitch of a plain step."""
        return self._base * STEP**step

    def dividing(self, turn: int, pitch: float) -> list[float]:
        """Pitches near one that divide the box of the turned solid."""
        found: list[float] = []
        for extent in self.extents[turn].tolist():
            middle = round(extent / pitch)
            found += [extent / k for k in (middle, middle - 1, middle + 1) if k >= 1]
        return [p for p in found if 0.8 <= p / pitch <= 1.26]

    def samples(self, turn: int, pitch: float, size: int) -> float:
        """How many samples the turned solid's box takes."""
        return float(np.prod(grid_of(self.extents[turn], pitch, size).astype(np.float64)))

    def size(self, turn: int, pitch: float) -> int:
        """Samples along a cell: more where the solid is thin; 0 where they are too many."""
        thin = PLAIN_SIZE * int(np.ceil(min(THIN * pitch / self.thickness, 1e3) / PLAIN_SIZE))
        size = min(max(thin, PLAIN_SIZE), LARGEST_SIZE)
        while size > PLAIN_SIZE and self.samples(turn, pitch, size) > FINE_SAMPLES:
            size -= PLAIN_SIZE
        if size < SMALL_SIZE and self.samples(turn, pitch, SMALL_SIZE) <= SMALL_SAMPLES:
            return SMALL_SIZE
        if size == PLAIN_SIZE and self.samples(turn, pitch, size) > MANY_SAMPLES:
            size = PLAIN_SIZE // 2
        return size if self.samples(turn, pitch, size) <= 2 * MANY_SAMPLES else 0

    def work(self, turn: int, pitch: float) -> float:
        """About what a fit costs."""
        samples = self.samples(turn, pitch, self.size(turn, pitch) or PLAIN_SIZE // 2)
        triangles = len(self._roughened(pitch)[1])
        several = 4.0 if self._apart else 1.0
        return several * samples + (40.0 if self.solid.oriented else 120.0) * triangles

    def fit(self, turn: int, pitch: float) -> LatticeFit | None:
        """The fit of a turn and pitch; None where it would take too many samples."""
        key = (turn, pitch)
        if key not in self._fits:
            size = self.size(turn, pitch)
            self._fits[key] = _judged(self.grid(turn, pitch, size), turn, pitch) if size else None
        return self._fits[key]

    def grid(self, turn: int, pitch: float, size: int, *, exact: bool = False) -> Grid:
        """Samples the turned solid; with ``exact`` all of its triangles."""
        key = (turn, pitch, size)
        if not exact and key in self._grids:
            return self._grids[key]
        level, rough = (0, self.solid) if exact else self._roughened(pitch)
        turned = None if exact else self._turned_by(turn, level, rough)
        sampling = sample(
            rough,
            pitch=pitch,
            size=size,
            rotation=self.turns[turn],
            turned=turned,
            bounds=self._bounds[turn],
        )
        if self._apart:
            sampling = _largest_body(sampling)
        split = min(OFFSETS, self.size(turn, pitch))
        grid = Grid(
            parts=block_sums(sampling.inside.view(np.uint8), size // split),
            split=split,
            size=size,
            offset=sampling.offset,
            crossed=sampling.crossed,
        )
        if not exact and self._stored + grid.parts.nbytes <= STORED:
            self._stored += grid.parts.nbytes
            self._grids[key] = grid
        return grid

    def made(self, fit: LatticeFit, offset_threshold: OffsetThreshold) -> FittedCells:
        """The cells of a fit in one piece, and how much of the solid they truly keep."""
        key = (fit.turn, fit.pitch, offset_threshold)
        if key not in self._made:
            grid = self.grid(fit.turn, fit.pitch, self.size(fit.turn, fit.pitch))
            sums = grid.fill(offset_threshold)
            joined = bridged(
                sums >= fit.thresholds[offset_threshold[3]], sums / float(grid.size**3)
            )
            finer = self.finer(fit.turn, fit.pitch, FINER_SAMPLES)
            fine = self.grid(fit.turn, fit.pitch, finer)
            self._made[key] = FittedCells(
                turn=fit.turn,
                pitch=fit.pitch,
                offset_threshold=offset_threshold,
                joined=joined,
                count=int(joined.cells.sum()),
                iou=overlap(fine, offset_threshold, joined.cells),
            )
        return self._made[key]

    def finer(self, turn: int, pitch: float, most: int) -> int:
        """Samples along a cell to measure with: twice as many where they are not too many."""
        size = self.size(turn, pitch)
        return 2 * size if self.samples(turn, pitch, 2 * size) <= most else size

    def _roughened(self, pitch: float) -> tuple[int, Solid]:
        """The solid with vertices that are nearly the same made one, where they are many."""
        if len(self.solid) < MANY_TRIANGLES or not self.solid.closed:
            return 0, self.solid
        level = int(np.floor(2.0 * np.log2(pitch / self._base)))
        if level not in self._rough:
            solid = self.solid
            tolerance = ROUGH * self._base * 2.0 ** (level / 2.0)
            vertices, faces = welded(solid.vertices, solid.faces, tolerance=tolerance, once=False)
            rough = replace(solid, vertices=vertices, faces=faces) if len(faces) else solid
            self._rough[level] = rough
        return level, self._rough[level]

    def _turned_by(self, turn: int, level: int, rough: Solid) -> Floats:
        key = (turn, level)
        if key not in self._turned:
            self._turned[key] = rough.vertices @ self.turns[turn].T
        return self._turned[key]


def overlap(grid: Grid, offset_threshold: OffsetThreshold, cells: Bools) -> float:
    """Return the intersection over union of cells with samples."""
    shared = int(grid.fill(offset_threshold)[cells].sum(dtype=np.int64))
    union = grid.count + int(cells.sum()) * grid.size**3 - shared
    return checked_fraction(shared / max(1, union), "intersection over union")


def _judged(grid: Grid, turn: int, pitch: float) -> LatticeFit:
    full = grid.size**3
    levels = min(LEVELS, full)
    sums = window_sums(grid.parts, grid.split)
    windows, samples = window_histograms(sums, grid.split, full, levels)
    chosen = np.arange(
        max(1, round(EMPTIEST_KEPT * levels)), max(1, round(FULLEST_LEFT * levels)) + 1
    )
    counts = np.cumsum(windows[..., ::-1], axis=-1)[..., ::-1][..., chosen]
    shared = np.cumsum(samples[..., ::-1], axis=-1)[..., ::-1][..., chosen]
    union = grid.count + counts * full - shared
    ious = shared / np.maximum(union, 1)
    checked_fraction(float(ious.min()), "intersection over union")
    checked_fraction(float(ious.max()), "intersection over union")
    return LatticeFit(
        turn=turn,
        pitch=pitch,
        counts=counts,
        ious=ious,
        thresholds=-(-chosen * full // levels),
    )


def _largest_body(sampling: Sampling) -> Sampling:
    numbers, sizes = parts_of(sampling.inside)
    if len(sizes) < 2:
        return sampling
    return replace(sampling, inside=numbers == int(np.argmax(sizes)) + 1)


def _around(solid: Solid, sampling: Sampling, body: Bools) -> Solid:
    """The surfaces of a solid that go around or lie in one of its bodies, or all of them."""
    from scipy import sparse  # not before a mesh is read: importing it takes a while

    a, b, c = solid.faces.T
    links: Any = sparse.coo_matrix(
        (np.ones(2 * len(a), dtype=np.bool_), (np.concatenate([a, b]), np.concatenate([b, c]))),
        shape=(len(solid.vertices), len(solid.vertices)),
    )
    connected: Any = sparse.csgraph.connected_components
    count, surface = connected(links, directed=False)
    points = solid.vertices @ sampling.rotation.T * (sampling.size / sampling.pitch)
    at = np.floor(points + sampling.offset).astype(np.int64)
    near = np.zeros(len(at), dtype=np.bool_)
    for step in np.ndindex(3, 3, 3):
        near |= body[tuple(np.clip(at + np.array(step) - 1, 0, np.array(body.shape) - 1).T)]
    kept = 2 * np.bincount(surface[near], minlength=count) > np.bincount(surface, minlength=count)
    faces = solid.faces[kept[surface[a]]]
    if not len(faces):
        return solid
    used, inverse = np.unique(faces, return_inverse=True)
    return replace(solid, vertices=solid.vertices[used], faces=inverse.reshape(-1, 3))


def _bounds(solid: Solid, turns: tuple[Floats, ...]) -> tuple[tuple[Floats, Floats], ...]:
    turned = (solid.vertices @ turn.T for turn in turns)
    return tuple((points.min(axis=0), points.max(axis=0)) for points in turned)


def _area(solid: Solid) -> float:
    a, b, c = (solid.vertices[solid.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def _volume(solid: Solid) -> float:
    """About what a solid encloses."""
    if solid.oriented:
        volume = abs(signed_volume(solid.vertices, solid.faces))
        if volume > 0.0:
            return volume
    pitch = float(solid.extents.max()) / 64.0
    for finer in (1.0, 3.0):
        volume = sample(solid, pitch=pitch / finer, size=2, rotation=np.eye(3)).volume
        if volume > 0.0:
            return volume
    raise InputError(
        "no-volume",
        "the mesh encloses no volume, expected a closed surface: close it, or give its walls some "
        "thickness.",
    )
