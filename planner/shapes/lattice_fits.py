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

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.core import window_histograms, window_sums
from foldback.planner.errors import checked_fraction
from foldback.planner.shapes.bridges import Bridged, bridged, parts_of
from foldback.planner.shapes.mesh_repair import welded
from foldback.planner.shapes.separate_bodies import (
    MAX_CROSSED_SHARE,
    MIN_BODY_SHARE,
    SeparateBody,
    separate_bodies,
)
from foldback.planner.shapes.solid import Solid, signed_volume
from foldback.planner.shapes.solid_sampling import Sampling, enclosed_volume, grid_of, sample
from foldback.planner.shapes.tunnels import tunnels_of_samples, tunnels_of_surface

OFFSETS_PER_AXIS: Final = 4
"""Number of offsets of the lattice of cells, along each axis and within one cell, that are tried to
fit cells to a solid."""
THRESHOLD_LEVELS: Final = 64
"""Maximum number of levels to which the filled fractions of cells are rounded when the threshold is
chosen above which a cell becomes a module. Measured from 45 to 90: equally good (decision 0051)."""
MAX_FILL_THRESHOLD: Final = 0.65
"""Largest filled fraction of a cell that is tried as the threshold above which a cell becomes a
module. Measured on three meshes: with 0.455 the worst loses 0.02 of its overlap, with 0.91 none
changes (decision 0051)."""
PITCH_STEP: Final = 1.0125
"""Ratio of two neighbouring pitches (sizes of a cell) that are tried to fit cells to a solid."""
BASE_CELL_SAMPLES: Final = 4
"""Usual number of points along a cell's edge at which a solid is sampled for being inside; other
numbers are multiples or half of it."""
SMALL_CELL_SAMPLES: Final = 8
"""Number of points along a cell's edge at which small solids (few samples in all) are sampled."""
MAX_FULL_EDGE_SAMPLES: Final = 8_000_000
"""Maximum number of samples in a solid's bounding box with the usual number of samples along a
cell's edge. Beyond it, an edge gets half as many; a pitch that needs more than twice this number
even then is not tried."""
MIN_THICKNESS_SAMPLES: Final = 2.0
"""Minimum number of samples across a solid's mean wall thickness."""
WELD_TOLERANCE_SHARE: Final = 0.12
"""Distance up to which vertices of a large mesh are merged before it is sampled, as a fraction of
the pitch (a cell's size)."""

OffsetThreshold = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LatticeFit:
    """Overlap of one sampling for every offset and threshold.

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
    ious: Array
    thresholds: Ints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedCells:
    """Connected cells of one fit with one offset and threshold.

    Attributes:
        turn, pitch: Orientation and pitch of the fit.
        offset_threshold: The offset along each axis, and the number of the threshold.
        joined: The cells, with counts of added and dropped ones.
        count: Number of cells.
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
    """A sampling, summed over parts of cells.

    Attributes:
        parts: (X, Y, Z) samples inside each part.
        split: Parts along the edge of a cell.
        size: Samples along it.
        offset: (3,) position of the solid's origin, in samples.
        crossed: Share of the samples inside that the surface goes around more than once.
    """

    parts: NDArray[np.int16]
    split: int
    size: int
    offset: Array
    crossed: float

    @property
    def count(self) -> int:
        """Number of samples inside."""
        return int(self.parts.sum(dtype=np.int64))

    def fill(self, offset_threshold: OffsetThreshold) -> NDArray[np.int32]:
        """Return (X, Y, Z) samples in each cell with an offset."""
        sums = window_sums(self.parts, self.split)
        return sums[tuple(slice(at, None, self.split) for at in offset_threshold[:3])]


class Ladder:
    """All fits of a solid, computed on demand and cached.

    Attributes:
        solid: The solid; its largest body alone, if others have enough volume and do not touch it,
            unless the ladder is made with ``all_bodies``.
        bodies: Separate bodies of the whole solid, the one that cells are fitted to first; empty
            for a solid in one piece.
        share: Share of the whole solid's volume that cells are fitted to, 0…1.
        tunnels: Number of tunnels of the used bodies; None if that is undecided.
        all_bodies: True if all bodies are used.
        apart: True if ``solid`` still has other bodies, because its surfaces do not separate them.
    """

    def __init__(self, solid: Solid, turns: tuple[Array, ...], *, all_bodies: bool = False) -> None:
        self.solid = solid
        self.all_bodies = all_bodies
        self.turns = turns
        self.volume = enclosed_volume(solid)
        self.thickness = 2.0 * self.volume / _area(solid)
        self.bodies: tuple[SeparateBody, ...] = ()
        self.tunnels: int | None = None
        self.share = 1.0
        self.apart = False
        self._fits: dict[tuple[int, float], LatticeFit | None] = {}
        self._fitted_cells: dict[tuple[int, float, OffsetThreshold], FittedCells] = {}
        self._grids: dict[tuple[int, float, int], Grid] = {}
        self._stored = 0
        self._rough: dict[int, Solid] = {}
        self._turned: dict[tuple[int, int], Array] = {}
        self._bounds = _bounds(solid, turns)
        self._count_bodies()
        self._base = float(np.cbrt(self.volume))

    @property
    def extents(self) -> tuple[Array, ...]:
        """(3,) bounding box of the solid in each orientation."""
        return tuple(high - low for low, high in self._bounds)

    def _count_bodies(self) -> None:
        # A long thin solid that lies askew fits only when it is turned.
        boxes = [float(np.prod(extents)) for extents in self.extents]
        turn = int(np.argmin(boxes))
        edge = max(float(np.cbrt(boxes[turn] / 1_000_000)), self.thickness / 6.0)
        edge = min(edge, self.thickness / MIN_THICKNESS_SAMPLES)
        while float(np.prod(grid_of(self.extents[turn], 2.0 * edge, 2))) > 4_000_000:
            edge *= 1.25
        sampling = sample(self.solid, pitch=2.0 * edge, size=2, rotation=self.turns[turn])
        numbers, sizes = parts_of(sampling.inside)
        if not len(sizes):
            return
        main = sampling.inside if self.all_bodies else numbers == int(np.argmax(sizes)) + 1
        if len(sizes) > 1 or self.solid.surfaces > 1:
            self.bodies = separate_bodies(self.solid, sampling, numbers, sizes)
        self.tunnels = self._count_tunnels(sampling, main)
        if self.all_bodies or int((sizes >= MIN_BODY_SHARE * sizes.sum()).sum()) <= 1:
            return
        self.share = checked_fraction(self.bodies[0].share, "share of the largest body")
        self.volume *= float(sizes.max() / sizes.sum())
        body = _around(self.solid, sampling, main)
        self.apart = len(body) == len(self.solid)
        if not self.apart:
            self.solid = body
            self._bounds = _bounds(body, self.turns)
            if body.oriented:
                self.volume = abs(signed_volume(body.vertices, body.faces)) or self.volume

    def _count_tunnels(self, sampling: Sampling, main: Flags) -> int | None:
        """Return the number of tunnels of the used bodies; None if that is undecided."""
        tunnels: int | None = None
        rows: Ints | None = np.arange(len(self.solid.faces))
        if self.bodies and not self.all_bodies:
            rows = self.bodies[0].faces
        if self.solid.oriented and sampling.crossed <= MAX_CROSSED_SHARE and rows is not None:
            tunnels = tunnels_of_surface(self.solid.faces[rows])
        return tunnels_of_samples(main) if tunnels is None else tunnels

    def pitch_for(self, cells: int) -> float:
        """Return the edge of cells with the volume of the solid together."""
        return float(np.cbrt(self.volume / cells))

    def step(self, pitch: float) -> int:
        """Return the number of the ladder step nearest to a pitch."""
        return round(float(np.log(pitch / self._base) / np.log(PITCH_STEP)))

    def pitch_of(self, step: int) -> float:
        """Return the pitch of a ladder step."""
        return self._base * PITCH_STEP**step

    def dividing(self, turn: int, pitch: float) -> list[float]:
        """Return pitches near one that divide the box of the turned solid."""
        pitches: list[float] = []
        for extent in self.extents[turn].tolist():
            middle = round(extent / pitch)
            pitches += [extent / k for k in (middle, middle - 1, middle + 1) if k >= 1]
        return [p for p in pitches if 0.8 <= p / pitch <= 1.26]

    def samples(self, turn: int, pitch: float, size: int) -> float:
        """Return the number of samples of the turned solid's box."""
        return float(np.prod(grid_of(self.extents[turn], pitch, size).astype(np.float64)))

    def size(self, turn: int, pitch: float) -> int:
        """Return the samples along a cell's edge, more for thin solids; 0 if there are too many."""
        thin = BASE_CELL_SAMPLES * int(
            np.ceil(min(MIN_THICKNESS_SAMPLES * pitch / self.thickness, 1e3) / BASE_CELL_SAMPLES)
        )
        size = min(max(thin, BASE_CELL_SAMPLES), 16)
        while size > BASE_CELL_SAMPLES and self.samples(turn, pitch, size) > 2_000_000:
            size -= BASE_CELL_SAMPLES
        if size < SMALL_CELL_SAMPLES and self.samples(turn, pitch, SMALL_CELL_SAMPLES) <= 250_000:
            return SMALL_CELL_SAMPLES
        if size == BASE_CELL_SAMPLES and self.samples(turn, pitch, size) > MAX_FULL_EDGE_SAMPLES:
            size = BASE_CELL_SAMPLES // 2
        return size if self.samples(turn, pitch, size) <= 2 * MAX_FULL_EDGE_SAMPLES else 0

    def work(self, turn: int, pitch: float) -> float:
        """Estimate the work of a fit, in samples."""
        samples = self.samples(turn, pitch, self.size(turn, pitch) or BASE_CELL_SAMPLES // 2)
        triangles = len(self._roughened(pitch)[1])
        several = 4.0 if self.apart else 1.0
        return several * samples + (40.0 if self.solid.oriented else 120.0) * triangles

    def fit(self, turn: int, pitch: float) -> LatticeFit | None:
        """Return the fit of an orientation and pitch; None if it takes too many samples."""
        key = (turn, pitch)
        if key not in self._fits:
            size = self.size(turn, pitch)
            self._fits[key] = _judged(self.grid(turn, pitch, size), turn, pitch) if size else None
        return self._fits[key]

    def grid(self, turn: int, pitch: float, size: int, *, exact: bool = False) -> Grid:
        """Sample the turned solid; with ``exact`` without merging vertices."""
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
        if self.apart:
            sampling = largest_body(sampling)
        split = min(OFFSETS_PER_AXIS, self.size(turn, pitch))
        grid = Grid(
            parts=_block_sums(sampling.inside, size // split),
            split=split,
            size=size,
            offset=sampling.offset,
            crossed=sampling.crossed,
        )
        if not exact and self._stored + grid.parts.nbytes <= 64 << 20:  # 64 MiB
            self._stored += grid.parts.nbytes
            self._grids[key] = grid
        return grid

    def fitted_cells(self, fit: LatticeFit, offset_threshold: OffsetThreshold) -> FittedCells:
        """Return the connected cells of a fit and their overlap by finer samples."""
        key = (fit.turn, fit.pitch, offset_threshold)
        if key not in self._fitted_cells:
            grid = self.grid(fit.turn, fit.pitch, self.size(fit.turn, fit.pitch))
            sums = grid.fill(offset_threshold)
            joined = bridged(
                sums >= fit.thresholds[offset_threshold[3]], sums / float(grid.size**3)
            )
            finer = self.finer(fit.turn, fit.pitch, 3_000_000)
            fine = self.grid(fit.turn, fit.pitch, finer)
            self._fitted_cells[key] = FittedCells(
                turn=fit.turn,
                pitch=fit.pitch,
                offset_threshold=offset_threshold,
                joined=joined,
                count=int(joined.cells.sum()),
                iou=overlap(fine, offset_threshold, joined.cells),
            )
        return self._fitted_cells[key]

    def finer(self, turn: int, pitch: float, max_samples: int) -> int:
        """Return the samples along a cell's edge for measuring, twice as many if possible."""
        size = self.size(turn, pitch)
        return 2 * size if self.samples(turn, pitch, 2 * size) <= max_samples else size

    def _roughened(self, pitch: float) -> tuple[int, Solid]:
        """Return a level and the solid, with close vertices merged if it is large."""
        if len(self.solid) < 20_000 or not self.solid.closed:
            return 0, self.solid
        level = int(np.floor(2.0 * np.log2(pitch / self._base)))
        if level not in self._rough:
            solid = self.solid
            tolerance = WELD_TOLERANCE_SHARE * self._base * 2.0 ** (level / 2.0)
            vertices, faces = welded(solid.vertices, solid.faces, tolerance=tolerance, once=False)
            rough = replace(solid, vertices=vertices, faces=faces) if len(faces) else solid
            self._rough[level] = rough
        return level, self._rough[level]

    def _turned_by(self, turn: int, level: int, rough: Solid) -> Array:
        key = (turn, level)
        if key not in self._turned:
            self._turned[key] = rough.vertices @ self.turns[turn].T
        return self._turned[key]


def overlap(
    grid: Grid, offset_threshold: OffsetThreshold, cells: Flags, *, share: float = 1.0
) -> float:
    """Return the intersection over union of cells with a solid.

    Args:
        grid: Samples of the solid.
        offset_threshold: Offset of the cells.
        cells: (X, Y, Z) True for the cells.
        share: Share of the solid's volume that was sampled, 0…1; the cells contain nothing of the
            rest.
    """
    shared = int(grid.fill(offset_threshold)[cells].sum(dtype=np.int64))
    union = grid.count / share + int(cells.sum()) * grid.size**3 - shared
    return checked_fraction(shared / max(1, union), "intersection over union")


def _judged(grid: Grid, turn: int, pitch: float) -> LatticeFit:
    full = grid.size**3
    levels = min(THRESHOLD_LEVELS, full)
    sums = window_sums(grid.parts, grid.split)
    windows, samples = window_histograms(sums, grid.split, full, levels)
    chosen_levels = np.arange(
        max(1, round(0.06 * levels)), max(1, round(MAX_FILL_THRESHOLD * levels)) + 1
    )
    counts = np.cumsum(windows[..., ::-1], axis=-1)[..., ::-1][..., chosen_levels]
    shared = np.cumsum(samples[..., ::-1], axis=-1)[..., ::-1][..., chosen_levels]
    union = grid.count + counts * full - shared
    ious = shared / np.maximum(union, 1)
    checked_fraction(float(ious.min()), "intersection over union")
    checked_fraction(float(ious.max()), "intersection over union")
    return LatticeFit(
        turn=turn,
        pitch=pitch,
        counts=counts,
        ious=ious,
        thresholds=-(-chosen_levels * full // levels),
    )


def _block_sums(inside: Flags, side: int) -> NDArray[np.int16]:
    """Return the (X/side, Y/side, Z/side) numbers of samples in each block of side³ samples."""
    x, y, z = (count - count % side for count in inside.shape)
    sums: NDArray[Any] = inside[:x, :y, :z]
    for _ in range(3):  # the last axis, which becomes the first
        along = sums[..., ::side].astype(np.int16)
        for k in range(1, side):
            along += sums[..., k::side]
        sums = along.transpose(2, 0, 1)
    return np.ascontiguousarray(sums)


def largest_body(sampling: Sampling) -> Sampling:
    """Return a sampling with the samples of the largest body alone."""
    numbers, sizes = parts_of(sampling.inside)
    if len(sizes) < 2:
        return sampling
    return replace(sampling, inside=numbers == int(np.argmax(sizes)) + 1)


def _around(solid: Solid, sampling: Sampling, body: Flags) -> Solid:
    """Return the surfaces around or inside one body of a solid; all if there are none."""
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
    near_surface = 2 * np.bincount(surface[near], minlength=count) > np.bincount(
        surface, minlength=count
    )
    faces = solid.faces[near_surface[surface[a]]]
    if not len(faces):
        return solid
    used, inverse = np.unique(faces, return_inverse=True)
    return replace(solid, vertices=solid.vertices[used], faces=inverse.reshape(-1, 3))


def _bounds(solid: Solid, turns: tuple[Array, ...]) -> tuple[tuple[Array, Array], ...]:
    turned = (solid.vertices @ turn.T for turn in turns)
    return tuple((points.min(axis=0), points.max(axis=0)) for points in turned)


def _area(solid: Solid) -> float:
    a, b, c = (solid.vertices[solid.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)
