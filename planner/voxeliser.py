"""Voxeliser: a solid becomes a shape of about as many cells as are asked for.

The inside is sampled several times finer than the cells. Sums over windows of samples then tell for
every offset at once how full each cell would be, so that many pitches, orientations, offsets and
thresholds are compared by their intersection over union with the solid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.bridges import bridged, parts_of
from planner.errors import InputError
from planner.kernels.crossings import window_histograms, window_sums
from planner.orientations import candidates
from planner.sampling import Sampling, grid_of, sample, too_fine
from planner.seams import welded
from planner.shapes import Shape
from planner.solids import Solid, signed_volume

MOST_CELLS: Final = 200_000
FINE: Final = 4
FINEST: Final = 8
MANY_SAMPLES: Final = 8_000_000
LEAST_BODY: Final = 0.01
NEARLY_AS_GOOD: Final = 0.01
SLACKS: Final = (0.0, 0.05, 0.2, 1.0)
"""How much less of the shape other counts may keep, when there are none that keep as much."""
OTHER_PITCHES: Final = (0.93, 0.8, 1.08, 1.25)
NEAR_COUNT: Final = 0.1
UPRIGHT_BONUS: Final = 0.02
EMPTIEST_KEPT: Final = 0.2
FULLEST_LEFT: Final = 0.65
WORK: Final = 1.2e8
FEWEST_TRIED: Final = 10
MOST_TRIED: Final = 120
ROUGH: Final = 0.1
MANY_TRIANGLES: Final = 20_000

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Voxels:
    """A solid as cells.

    Attributes:
        shape: Its cells, in one piece; the smallest coordinates are 0.
        iou: Intersection over union of the cells with the solid (its largest body).
        pitch: Edge of a cell in the solid's units.
        rotation: (3, 3) how the solid was turned.
        offset: (3,) in cells: a point x of the solid lies in ``floor(R x / pitch + offset)``.
        asked: How many cells were asked for.
        below: The nearest smaller count than the asked one that can be had as well, or None.
        above: The nearest larger one, or None.
        bodies: How many bodies the solid has; the largest was kept.
        notes: What was lost, joined or left out, in plain words.
    """

    shape: Shape
    iou: float
    pitch: float
    rotation: Floats
    offset: Floats
    asked: int
    below: int | None
    above: int | None
    bodies: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tried:
    """One sampling, judged for every offset and threshold.

    Attributes:
        pitch: Edge of a cell.
        turn: Number of the orientation.
        counts: (s, s, s, T) cells for each offset and threshold.
        ious: (s, s, s, T) intersection over union.
        thresholds: (T,) samples that a cell needs.
    """

    pitch: float
    turn: int
    counts: Ints
    ious: Floats
    thresholds: Ints


def voxelise(
    solid: Solid, *, cells: int, seed: int = 0, upright: bool = False, most_cells: int = MOST_CELLS
) -> Voxels:
    """Makes about ``cells`` solid cells of a solid.

    Args:
        solid: What to make cells of.
        cells: How many are asked for.
        seed: Of the orientations that are tried besides the plain ones.
        upright: Keep the solid's orientation.
        most_cells: More are refused.

    Raises:
        InputError: For counts out of range, and for solids without an inside.
    """
    if not 1 <= cells <= most_cells:
        raise InputError(
            "wrong-count", f"got {cells} cells asked for, expected 1 to {most_cells} of them."
        )
    turns = candidates(solid, np.random.default_rng(seed))[: 1 if upright else None]
    search = _Search(solid, cells, turns)
    search.run()
    return search.result()


class _Search:
    """The search for the pitch, orientation, offset and threshold that keep the solid best."""

    def __init__(self, solid: Solid, cells: int, turns: tuple[Floats, ...]) -> None:
        self._solid = solid
        self._cells = cells
        self._turns = turns
        self._tried: list[_Tried] = []
        self._seen: set[tuple[int, float]] = set()
        self._several = False
        self._bodies = 1
        self._share = 1.0
        self._volume = _volume(solid)
        self._rough = _roughened(solid, self._pitch_for(self._volume) * ROUGH)
        self._turned: dict[int, Floats] = {}
        self._size = FINE
        self._most = FEWEST_TRIED
        self._begin()

    def _begin(self) -> None:
        """Counts the bodies and settles how fine to sample."""
        first = self._pitch_for(self._volume)
        all_samples = [self._samples(turn, first, FINE) for turn in range(len(self._turns))]
        # A long thin solid that lies askew fits only when it is turned.
        turn = next((i for i, n in enumerate(all_samples) if n <= MANY_SAMPLES), -1)
        turn = turn if turn >= 0 else int(np.argmin(all_samples))
        samples = all_samples[turn]
        self._size = FINE if samples <= MANY_SAMPLES else FINE // 2
        sampling = self._sampled(turn, first, self._size)
        _, sizes = parts_of(sampling.inside)
        if len(sizes) == 0:
            return
        self._bodies = max(1, int((sizes >= LEAST_BODY * sizes.sum()).sum()))
        self._several = self._bodies > 1
        if self._several:
            self._share = float(sizes.max() / sizes.sum())
            self._volume *= self._share
        work = samples * (4.0 if self._several else 1.0)
        work += (40.0 if self._solid.oriented else 120.0) * len(self._rough)
        self._most = int(np.clip(WORK / max(work, 1.0), FEWEST_TRIED, MOST_TRIED))

    def run(self) -> None:
        """Tries orientations with a few pitches, then the best of them with more."""
        for turn in range(len(self._turns)):
            if turn and len(self._tried) > self._most // 2:
                break
            pitch = self._pitch_for(self._volume)
            for _ in range(3 if turn == 0 else 2):
                tried = self._try(turn, pitch)
                if tried is None:
                    break
                pitch *= _count_factor(tried, self._cells)
        if not self._tried:
            raise too_fine(self._pitch_for(self._volume), self._solid.extents)
        if not any(t.counts.any() for t in self._tried):
            raise InputError(
                "no-volume",
                "the mesh has no inside that cells of this size can fill; expected a closed "
                "surface with walls, or ask for more modules.",
            )
        for turn in dict.fromkeys([self._best().turn, 0]):
            own = [t for t in self._tried if t.turn == turn]
            if not own:
                continue
            best = max(own, key=lambda t: _merit(t, self._cells))
            for pitch in self._pitches(turn, best.pitch):
                if len(self._tried) >= self._most:
                    break
                self._try(turn, pitch)

    def _pitch_for(self, volume: float) -> float:
        return float(np.cbrt(volume / self._cells))

    def _pitches(self, turn: int, pitch: float) -> list[float]:
        """Pitches near one: those that divide the box first, then a few to both sides."""
        found: list[float] = []
        for extent in np.ptp(self._points(turn), axis=0).tolist():
            middle = round(extent / pitch)
            found += [extent / k for k in (middle, middle - 1, middle + 1) if k >= 1]
        near = [p for p in found if 0.8 <= p / pitch <= 1.26]
        return near + [pitch * f for f in (0.99, 1.01, 0.98, 1.02, 0.965, 1.035, 0.95, 1.05)]

    def _try(self, turn: int, pitch: float) -> _Tried | None:
        key = (turn, float(f"{pitch:.6g}"))
        if key in self._seen:
            return None
        self._seen.add(key)
        if self._samples(turn, pitch, self._size) > 2 * MANY_SAMPLES:
            return None
        tried = _judged(self._sampled(turn, pitch, self._size), turn)
        self._tried.append(tried)
        return tried

    def _samples(self, turn: int, pitch: float, size: int) -> float:
        """How many samples the turned solid's box takes."""
        extents = np.ptp(self._points(turn), axis=0)
        return float(np.prod(grid_of(extents, pitch, size).astype(np.float64)))

    def _points(self, turn: int) -> Floats:
        """(V, 3) vertices of the rough solid, turned."""
        if turn not in self._turned:
            self._turned[turn] = self._rough.vertices @ self._turns[turn].T
        return self._turned[turn]

    def _sampled(self, turn: int, pitch: float, size: int) -> Sampling:
        sampling = sample(
            self._rough,
            pitch=pitch,
            size=size,
            rotation=self._turns[turn],
            turned=self._points(turn),
        )
        return _largest_body(sampling) if self._several else sampling

    def _best(self) -> _Tried:
        return max(self._tried, key=lambda t: _merit(t, self._cells))

    def _chosen(self) -> tuple[_Tried, tuple[int, ...], int | None, int | None]:
        """Of what is nearly as good as the best, what comes nearest to the asked count."""
        least = _merit(self._best(), self._cells) - NEARLY_AS_GOOD
        chosen: tuple[float, float] | None = None
        place: tuple[_Tried, tuple[int, ...]] | None = None
        for tried in self._tried:
            score = _score(tried, self._cells)
            kept = (score >= least) & (tried.counts > 0)
            if not kept.any():
                continue
            off = np.abs(tried.counts - self._cells)
            index = np.lexsort((-score.ravel(), np.where(kept, off, 1 << 40).ravel()))[0]
            where = tuple(int(i) for i in np.unravel_index(index, score.shape))
            rank = (float(off[where]), -float(score[where]))
            if chosen is None or rank < chosen:
                chosen, place = rank, (tried, where)
        assert place is not None
        below, above = self._near(place[0], least)
        return *place, below, above

    def _near(self, chosen: _Tried, least: float) -> tuple[int | None, int | None]:
        """The nearest other counts, as good as what was chosen, or nearly so where none is."""
        below = above = None
        tried = list(self._tried)
        for slack in SLACKS:
            reached: set[int] = set()
            for one in tried:
                good = (one.ious + _bonus(one) >= least - slack) & (one.counts > 0)
                reached.update(np.unique(one.counts[good]).tolist())
            below = below or max((c for c in reached if c < self._cells), default=None)
            above = above or min((c for c in reached if c > self._cells), default=None)
            if below and above:
                break
            if slack == SLACKS[0]:  # a little finer and coarser, for the sake of the other counts
                wanted = [f for f in OTHER_PITCHES if not (above if f < 1.0 else below)]
                size = self._size
                tried += [
                    _judged(self._sampled(chosen.turn, chosen.pitch * f, size), chosen.turn)
                    for f in wanted
                    if self._samples(chosen.turn, chosen.pitch * f, size) <= 2 * MANY_SAMPLES
                ]
        return below, above

    def result(self) -> Voxels:
        """Makes the cells of the best."""
        tried, where, below, above = self._chosen()
        sampling = self._sampled(tried.turn, tried.pitch, self._size)
        size = sampling.size
        at = where[:3]
        sums = window_sums(sampling.inside.view(np.uint8), size)[
            at[0] :: size, at[1] :: size, at[2] :: size
        ]
        filled = sums / float(size**3)
        joined = bridged(sums >= tried.thresholds[where[3]], filled)
        found = np.argwhere(joined.cells)
        offset = (sampling.offset - np.array(at)) / size - found.min(axis=0)
        shape = Shape.from_cells(found - found.min(axis=0), name=self._solid.name)
        return Voxels(
            shape=shape,
            iou=self._measured(tried, shape, offset),
            pitch=tried.pitch,
            rotation=sampling.rotation,
            offset=offset,
            asked=self._cells,
            below=below,
            above=above,
            bodies=self._bodies,
            notes=tuple(self._notes(sampling, joined.cells, filled, joined.added, joined.dropped)),
        )

    def _measured(self, tried: _Tried, shape: Shape, offset: Floats) -> float:
        """Intersection over union with finer samples than those that were searched with."""
        samples = self._samples(tried.turn, tried.pitch, FINEST)
        sampling = sample(
            self._solid,
            pitch=tried.pitch,
            size=FINEST if samples <= MANY_SAMPLES * 2 else self._size,
            rotation=self._turns[tried.turn],
        )
        if self._several:
            sampling = _largest_body(sampling)
        size = sampling.size
        points = (np.argwhere(sampling.inside) + 0.5 - sampling.offset) / size + offset
        own = np.floor(points + 1e-9).astype(np.int64)
        top = shape.cells.max(axis=0) + 1
        within = ((own >= 0) & (own < top)).all(axis=1)
        grid = np.zeros(tuple(top), dtype=bool)
        grid[tuple(shape.cells.T)] = True
        shared = int(grid[tuple(own[within].T)].sum())
        return shared / (len(points) + len(shape) * size**3 - shared)

    def _notes(
        self,
        sampling: Sampling,
        cells: NDArray[np.bool_],
        filled: Floats,
        added: int,
        dropped: int,
    ) -> list[str]:
        notes: list[str] = []
        if self._several:
            notes.append(
                f"got {self._bodies} separate bodies and kept the largest, "
                f"{100 * self._share:.0f} % of the volume; join them, or fold them one by one."
            )
        if sampling.crossed > 0.001:
            notes.append("the surface crosses itself; what it goes around was taken as inside.")
        if added:
            word = "cell was" if added == 1 else "cells were"
            notes.append(f"{added} {word} added to keep thin parts connected.")
        if dropped:
            word = "cell" if dropped == 1 else "cells"
            notes.append(f"{dropped} loose {word} at thin parts left out.")
        lost = _lost(cells, filled)
        if lost > 0.005:
            notes.append(
                f"{100 * lost:.1f} % of the volume is thinner than a cell and is lost; "
                "ask for more modules to keep it."
            )
        return notes


def _roughened(solid: Solid, tolerance: float) -> Solid:
    """A solid of many triangles with vertices that are nearly the same made one."""
    if len(solid) < MANY_TRIANGLES or not solid.closed:
        return solid
    vertices, faces = welded(solid.vertices, solid.faces, tolerance=tolerance, once=False)
    return replace(solid, vertices=vertices, faces=faces) if len(faces) else solid


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
        "the mesh encloses nothing, expected a closed surface: close it, or give its walls some "
        "thickness.",
    )


def _judged(sampling: Sampling, turn: int) -> _Tried:
    size = sampling.size
    full = size**3
    sums = window_sums(sampling.inside.view(np.uint8), size)
    found = window_histograms(sums, size)[..., ::-1]
    samples = np.arange(full, -1, -1)
    counts = np.cumsum(found, axis=-1)[..., ::-1]
    shared = np.cumsum(found * samples, axis=-1)[..., ::-1]
    thresholds = np.arange(max(1, round(EMPTIEST_KEPT * full)), round(FULLEST_LEFT * full) + 1)
    counts, shared = counts[..., thresholds], shared[..., thresholds]
    union = sampling.count + counts * full - shared
    return _Tried(
        pitch=sampling.pitch,
        turn=turn,
        counts=counts,
        ious=shared / np.maximum(union, 1),
        thresholds=thresholds,
    )


def _count_factor(tried: _Tried, cells: int) -> float:
    """By how much to change the pitch to come near the count, as the best offset has it."""
    count = int(tried.counts.ravel()[int(np.argmax(tried.ious))])
    return float(np.clip(np.cbrt(max(count, 0.2) / cells), 0.6, 1.4))


def _bonus(tried: _Tried) -> float:
    return UPRIGHT_BONUS if tried.turn == 0 else 0.0


def _score(tried: _Tried, cells: int) -> Floats:
    """(s, s, s, T) intersection over union, less what the count is off beyond a tenth."""
    off = np.abs(tried.counts - cells) / cells
    return tried.ious + _bonus(tried) - np.maximum(0.0, off - NEAR_COUNT)


def _merit(tried: _Tried, cells: int) -> float:
    return float(_score(tried, cells).max())


def _largest_body(sampling: Sampling) -> Sampling:
    numbers, sizes = parts_of(sampling.inside)
    if len(sizes) < 2:
        return sampling
    return replace(sampling, inside=numbers == int(np.argmax(sizes)) + 1)


def _lost(cells: NDArray[np.bool_], filled: Floats) -> float:
    """Share of the volume in cells that are left out and touch none that is kept."""
    near = np.pad(cells, 1)
    for axis in range(3):
        near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
    far = filled * ~near[1:-1, 1:-1, 1:-1]
    return float(far.sum() / max(filled.sum(), np.finfo(float).tiny))
