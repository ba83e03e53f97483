"""Choice: of the fits of a solid, the cells that come near a count and keep the most.

``Chooser.choose`` depends on the solid and the count alone. So a count may be offered when asking
for it was tried and gave it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.shapes.lattice_fits import FittedCells, Ladder, LatticeFit, OffsetThreshold
from planner.shapes.layers import has_whole_layers
from planner.shapes.sampling import too_fine

NEAR_COUNT: Final = 0.1
"""How far off a count may be, as a part of it, for the sake of the shape."""
OFF_COUNT: Final = 0.3
"""How much more of the shape is to be kept for a count that is off by as much as it is itself."""
NEARLY_AS_GOOD: Final = 0.01
UPRIGHT_BONUS: Final = 0.02
LAYERED_FROM: Final = 75
"""Cells from which on layers that hang together count: so many blocks of 2×2×2 are peeled."""
FOR_LAYERS: Final = 0.02
"""How much less of the shape such cells may keep."""
SLACKS: Final = (0.03, 0.1, 0.3, 1.0)
"""How much less of the shape offered counts may keep: more where there are none that keep more."""
OTHER_PITCHES: Final = {False: (1.08, 1.25), True: (0.93, 0.8)}
OTHER_COUNTS: Final = {False: (0.85, 0.7, 0.5), True: (1.18, 1.4, 2.0)}
FARTHEST_OFFER: Final = 2.5
OFFERS_TRIED: Final = 8
MOST_LOOKED_AT: Final = 400
WORK: Final = 1.2e8
FEWEST_TRIED: Final = 10
MOST_TRIED: Final = 120
MUCH_TRIED: Final = 30
"""Fits that a solid can afford whose candidates are all looked at."""
STEPS_TO_SIDES: Final = 4
WIDE_STEPS: Final = range(-16, 17, 2)

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenVoxels:
    """What is made when a count is asked for.

    Attributes:
        made: The cells.
        visited: The fits that were looked at.
        score: What they keep, with the bonus for the orientation of the file.
    """

    made: FittedCells
    visited: tuple[LatticeFit, ...]
    score: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Entries:
    """Everything that some fits have for some counts.

    Attributes:
        fits: The fits.
        rows: (E,) number of the fit.
        places: (E,) offset and threshold in it.
        counts: (E,) cells before they are joined.
        scores: (E,) what they keep.
        misfits: (E,) by how much their volume differs from the solid's, as a part of it.
    """

    fits: tuple[LatticeFit, ...]
    rows: Ints
    places: Ints
    counts: Ints
    scores: Floats
    misfits: Floats

    def at(self, entry: int) -> tuple[LatticeFit, OffsetThreshold]:
        fit = self.fits[self.rows[entry]]
        x, y, z, t = np.unravel_index(self.places[entry], fit.counts.shape)
        return fit, (int(x), int(y), int(z), int(t))

    def first(self, order: Ints, most: int, *, each: int) -> Iterator[int]:
        """The first entries of an order, so many of each fit."""
        taken: dict[int, int] = {}
        for entry in order.tolist():
            row = int(self.rows[entry])
            if taken.get(row, 0) < each:
                taken[row] = taken.get(row, 0) + 1
                yield entry
                if sum(taken.values()) >= most:
                    return


class Chooser:
    """Chooses among the fits of a solid; remembers what was chosen for which count."""

    def __init__(self, ladder: Ladder) -> None:
        self._ladder = ladder
        self._chosen: dict[int, ChosenVoxels] = {}

    def choose(self, cells: int) -> ChosenVoxels:
        """What is made when so many cells are asked for."""
        if cells not in self._chosen:
            self._chosen[cells] = self._search(cells)
        return self._chosen[cells]

    def offers(self, cells: int) -> tuple[int | None, int | None]:
        """The counts next to the one that is made, no nearer to the asked one, that hold."""
        return self._offer(cells, above=False), self._offer(cells, above=True)

    def _search(self, cells: int) -> ChosenVoxels:
        ladder = self._ladder
        most = self._most(cells)
        visited: dict[tuple[int, float], LatticeFit] = {}
        for turn in range(len(ladder.turns)):
            if turn and len(visited) > most // 2:
                break
            pitch = ladder.pitch_for(cells)
            for _ in range(3 if turn == 0 else 2):
                near = ladder.pitch_of(ladder.step(pitch))
                if (turn, near) in visited or not self._visit(turn, near, visited):
                    break
                pitch = near * _count_factor(visited[turn, near], cells)
        if not visited:
            raise too_fine(ladder.pitch_for(cells), ladder.solid.extents)
        if not any(fit.counts.any() for fit in visited.values()):
            raise InputError(
                "no-volume",
                "the mesh has no inside that cells of this size can fill, expected a closed "
                "surface with thicker walls; or use more modules.",
            )
        best = max(visited.values(), key=lambda fit: _merit(fit, cells))
        for turn in dict.fromkeys([best.turn, 0]):
            own = [fit for fit in visited.values() if fit.turn == turn]
            if not own:
                continue
            pitch = max(own, key=lambda fit: _merit(fit, cells)).pitch
            self._visit_all(turn, self._around(turn, pitch), visited, most)
        made = self._best(visited.values(), cells)
        if made is None or not _near(made.count, cells):
            for turn in range(len(ladder.turns)):
                step = ladder.step(ladder.pitch_for(cells))
                pitches = [ladder.pitch_of(step + wide) for wide in WIDE_STEPS]
                self._visit_all(turn, pitches, visited, most)
            made = self._best(visited.values(), cells)
        assert made is not None
        return ChosenVoxels(made=made, visited=tuple(visited.values()), score=_score(made))

    def _most(self, cells: int) -> int:
        work = self._ladder.work(0, self._ladder.pitch_for(cells))
        return int(np.clip(WORK / max(work, 1.0), FEWEST_TRIED, MOST_TRIED))

    def _visit(self, turn: int, pitch: float, visited: dict[tuple[int, float], LatticeFit]) -> bool:
        fit = self._ladder.fit(turn, pitch)
        if fit is not None:
            visited[turn, pitch] = fit
        return fit is not None

    def _visit_all(
        self,
        turn: int,
        pitches: Iterable[float],
        visited: dict[tuple[int, float], LatticeFit],
        most: int,
    ) -> None:
        for pitch in pitches:
            if len(visited) >= most:
                return
            if (turn, pitch) not in visited:
                self._visit(turn, pitch, visited)

    def _around(self, turn: int, pitch: float) -> list[float]:
        """Pitches near one: those that divide the box first, then a few to both sides."""
        step = self._ladder.step(pitch)
        sides = [step + sign * n for n in range(STEPS_TO_SIDES + 1) for sign in (1, -1)]
        return self._ladder.dividing(turn, pitch) + [self._ladder.pitch_of(s) for s in sides]

    def _best(self, fits: Iterable[LatticeFit], cells: int) -> FittedCells | None:
        """Of what is nearly as good as the best of a count, what comes nearest to the count."""
        many = self._most(cells) >= MUCH_TRIED
        entries = _entries(fits, self._ladder.volume)
        off = np.abs(entries.counts - cells)
        inside = np.flatnonzero(_near(entries.counts, cells))
        if len(inside):
            scores = entries.scores[inside] - OFF_COUNT * off[inside] / cells
            by_score = inside[np.lexsort((entries.misfits[inside], -scores))]
            good = inside[scores >= scores.max() - NEARLY_AS_GOOD]
            by_count = good[np.lexsort((entries.misfits[good], -entries.scores[good], off[good]))]
            wanted = [
                *entries.first(by_score, 6 if many else 2, each=1),
                *entries.first(by_count, 4 if many else 2, each=2),
            ]
            found = self._made_of(entries, wanted, cells)
            if not found:  # joining changed the counts of all of those
                more = entries.first(by_score, 24 if many else 6, each=4)
                found = self._made_of(entries, more, cells)
            if found:
                most = max(_worth(made, cells) for made in found)
                good_ones = [m for m in found if _worth(m, cells) >= most - NEARLY_AS_GOOD]
                if cells >= LAYERED_FROM:
                    more = entries.first(by_score, 24 if many else 6, each=4)
                    layered = [
                        made
                        for made in (*found, *self._made_of(entries, more, cells))
                        if _worth(made, cells) >= most - FOR_LAYERS
                        and has_whole_layers(made.joined.cells)
                    ]
                    good_ones = layered or good_ones
                return min(good_ones, key=lambda made: self._rank(made, cells))
        by_off = np.lexsort((entries.misfits, -entries.scores, off))
        nearest = by_off[np.sort(np.unique(entries.counts[by_off], return_index=True)[1])]
        found = [
            self._ladder.made(*entries.at(entry)) for entry in nearest[: 12 if many else 4].tolist()
        ]
        return min(found, key=lambda made: self._rank(made, cells), default=None)

    def _rank(self, made: FittedCells, cells: int) -> tuple[int, float, float]:
        misfit = abs(made.count * made.pitch**3 / self._ladder.volume - 1.0)
        return abs(made.count - cells), -_score(made), misfit

    def _made_of(self, entries: _Entries, wanted: Iterable[int], cells: int) -> list[FittedCells]:
        all_made = (self._ladder.made(*entries.at(entry)) for entry in dict.fromkeys(wanted))
        return [made for made in all_made if _near(made.count, cells)]

    def _offer(self, cells: int, *, above: bool) -> int | None:
        """The nearest count to one side that is made when it is asked for."""
        choice = self.choose(cells)
        got = choice.made.count
        # What comes nearer than what was made would belie it.
        limit = max(got + 1, 2 * cells - got) if above else min(got - 1, 2 * cells - got)
        most = OFFERS_TRIED if self._most(cells) >= MUCH_TRIED else 2
        for count in islice(self._likely(choice, limit, above=above), most):
            held = self._held(count, limit, above=above, most=2)
            if held is not None:
                return held
        for factor in OTHER_COUNTS[above]:
            held = self._held(max(1, round(limit * factor)), limit, above=above, most=3)
            if held is not None:
                return held
        return None

    def _held(self, count: int, limit: int, *, above: bool, most: int) -> int | None:
        """A count beyond a limit that asking for it gives: this one, or what this one gives."""
        for _ in range(most):
            if count < limit if above else count > limit:
                return None
            made = self.choose(count).made.count
            if made == count:
                return count
            count = made
        return None

    def _likely(self, choice: ChosenVoxels, limit: int, *, above: bool) -> Iterator[int]:
        """Counts to one side that fits near the chosen one have, those that keep most first."""
        ladder = self._ladder
        fits = {(fit.turn, fit.pitch): fit for fit in choice.visited}
        turn, pitch = choice.made.turn, choice.made.pitch
        for other in OTHER_PITCHES[above]:
            near = [ladder.pitch_of(ladder.step(pitch * other))]
            self._visit_all(turn, near + ladder.dividing(turn, pitch * other), fits, len(fits) + 3)
        entries = _entries(fits.values(), ladder.volume)
        counts = entries.counts
        beyond = counts >= limit if above else counts <= limit
        far = counts <= FARTHEST_OFFER * limit if above else counts >= limit / FARTHEST_OFFER
        reached, which = np.unique(counts, return_inverse=True)
        kept = np.full(len(reached), -np.inf)
        np.maximum.at(kept, which, entries.scores)
        rows = np.unique(which[beyond & far])
        said: set[int] = set()
        for slack in SLACKS:
            least = choice.score - NEARLY_AS_GOOD - slack
            for row in (rows if above else rows[::-1])[:MOST_LOOKED_AT].tolist():
                count = int(reached[row])
                if kept[row] < least or count in said:
                    continue
                low, high = np.searchsorted(reached, [0.9 * count, 1.1 * count])
                off = np.abs(reached[low:high] - count) / count
                if kept[row] >= (kept[low:high] - OFF_COUNT * off).max() - NEARLY_AS_GOOD:
                    said.add(count)
                    yield count


def _near(counts: Ints | int, cells: int) -> NDArray[np.bool_]:
    """Whether counts are near an asked one."""
    return np.asarray((np.abs(np.asarray(counts) - cells) <= NEAR_COUNT * cells) & (counts != 0))


def _entries(fits: Iterable[LatticeFit], volume: float) -> _Entries:
    listed = tuple(fits)
    sizes = [fit.counts.size for fit in listed]
    counts = np.concatenate([fit.counts.ravel() for fit in listed])
    scores = np.concatenate([(fit.ious + _bonus(fit.turn)).ravel() for fit in listed])
    rows = np.repeat(np.arange(len(listed)), sizes)
    places = np.concatenate([np.arange(size) for size in sizes])
    some = np.flatnonzero(counts)
    volumes = np.array([fit.pitch**3 for fit in listed])[rows] * counts
    return _Entries(
        fits=listed,
        rows=rows[some],
        places=places[some],
        counts=counts[some],
        scores=np.round(scores[some], 9),
        misfits=np.abs(volumes[some] / volume - 1.0),
    )


def _count_factor(fit: LatticeFit, cells: int) -> float:
    """By how much to change the pitch to come near the count, as the best offset has it."""
    count = int(fit.counts.ravel()[int(np.argmax(fit.ious))])
    return float(np.clip(np.cbrt(max(count, 0.2) / cells), 0.6, 1.4))


def _bonus(turn: int) -> float:
    return UPRIGHT_BONUS if turn == 0 else 0.0


def _score(made: FittedCells) -> float:
    return round(made.iou + _bonus(made.turn), 9)


def _worth(made: FittedCells, cells: int) -> float:
    """What is kept, less what the count is off."""
    return _score(made) - OFF_COUNT * abs(made.count - cells) / cells


def _merit(fit: LatticeFit, cells: int) -> float:
    """What a fit keeps at best, less what the count is off beyond what is near."""
    off = np.abs(fit.counts - cells) / cells
    scores = fit.ious + _bonus(fit.turn) - np.maximum(0.0, off - NEAR_COUNT)
    return float(scores.max())
