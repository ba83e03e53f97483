"""Choice of the fit of a solid that comes near a count and overlaps most.

``Chooser.choose`` depends on the solid and the count alone. So a count may be offered when asking
for it was tried and gave it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.errors import InputError
from foldback.planner.shapes.lattice_fits import FittedCells, Ladder, LatticeFit, OffsetThreshold
from foldback.planner.shapes.layered_path import has_whole_layers
from foldback.planner.shapes.solid_sampling import too_fine

COUNT_TOLERANCE: Final = 0.1
"""Maximum deviation from the requested number of modules, as a fraction of it, for a voxelisation
of a solid to count as near."""
COUNT_PENALTY: Final = 0.3
"""Amount that is subtracted from the score of a voxelisation (its overlap with the solid, IoU from
0 to 1) if its number of modules deviates by 100 % from the requested one; less in proportion.
Measured from 0.21 to 0.42: equally good (decision 0051)."""
SCORE_TOLERANCE: Final = 0.01
"""Difference of scores (overlap with the solid, IoU from 0 to 1) within which two voxelisations
count as equally good."""
UPRIGHT_BONUS: Final = 0.02
"""Score (as overlap with the solid, IoU from 0 to 1) that a voxelisation in the file's own
orientation gets in addition. Measured from 0.014 to 0.028: equally good (decision 0051)."""
OTHER_PITCHES: Final = {False: (1.08, 1.25), True: (0.93, 0.8)}
"""Factors on the chosen pitch (a cell's size) at which voxelisations with more modules (True) or
fewer (False) are searched, to offer other numbers. Factors farther from 1 offer more distant
numbers."""
OTHER_COUNTS: Final = {False: (0.85, 0.7, 0.5), True: (1.18, 1.4, 2.0)}
"""Factors on the number of modules next to the chosen one that are tried in order, above (True) and
below (False), if no other voxelisation to offer is found nearby."""
MAX_OFFER_FACTOR: Final = 2.5
"""When a solid is divided into modules, other numbers of modules that also fit it well are offered
to the user. This is the largest ratio, upwards or downwards, of an offered number to the nearest
one that could be offered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenVoxels:
    """Cells chosen for a requested count.

    Attributes:
        fit: The cells.
        visited: Evaluated fits.
        score: IoU of the cells, with the bonus for the orientation of the file.
    """

    fit: FittedCells
    visited: tuple[LatticeFit, ...]
    score: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Entries:
    """Table of all counts and scores of some fits.

    Attributes:
        fits: The fits.
        rows: (E,) index of the fit.
        places: (E,) flat index of offset and threshold in the fit.
        counts: (E,) number of cells before joining.
        scores: (E,) IoU with the bonus for the orientation.
        misfits: (E,) relative difference of volume to the solid.
    """

    fits: tuple[LatticeFit, ...]
    rows: Ints
    places: Ints
    counts: Ints
    scores: Array
    misfits: Array

    def at(self, entry: int) -> tuple[LatticeFit, OffsetThreshold]:
        fit = self.fits[self.rows[entry]]
        x, y, z, t = np.unravel_index(self.places[entry], fit.counts.shape)
        return fit, (int(x), int(y), int(z), int(t))

    def first(self, order: Ints, max_entries: int, *, max_per_row: int) -> Iterator[int]:
        """Yield the first ``max_entries`` of an order, at most ``max_per_row`` of one fit."""
        row_counts: dict[int, int] = {}
        for entry in order.tolist():
            row = int(self.rows[entry])
            if row_counts.get(row, 0) < max_per_row:
                row_counts[row] = row_counts.get(row, 0) + 1
                yield entry
                if sum(row_counts.values()) >= max_entries:
                    return


class Chooser:
    """Choice among the fits of a solid, with a cache of the chosen cells per count.

    Attributes:
        ladder: The fits of the solid.
    """

    def __init__(self, ladder: Ladder) -> None:
        self.ladder = ladder
        self._choices: dict[int, ChosenVoxels] = {}

    def choose(self, cells: int) -> ChosenVoxels:
        """Return the cells for a requested count."""
        if cells not in self._choices:
            self._choices[cells] = self._search(cells)
        return self._choices[cells]

    def offers(self, cells: int) -> tuple[int | None, int | None]:
        """Return the next smaller and larger counts that requests for them give."""
        return self._offer(cells, above=False), self._offer(cells, above=True)

    def _search(self, cells: int) -> ChosenVoxels:
        ladder = self.ladder
        max_fits = self._most(cells)
        visited: dict[tuple[int, float], LatticeFit] = {}
        for turn in range(len(ladder.turns)):
            if turn and len(visited) > max_fits // 2:
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
                "the mesh has no inside that cells of this size can fill; use more modules, or "
                "a closed surface with thicker walls.",
            )
        best = max(visited.values(), key=lambda fit: _merit(fit, cells))
        for turn in dict.fromkeys([best.turn, 0]):
            turn_fits = [fit for fit in visited.values() if fit.turn == turn]
            if not turn_fits:
                continue
            pitch = max(turn_fits, key=lambda fit: _merit(fit, cells)).pitch
            self._visit_all(turn, self._around(turn, pitch), visited, max_fits)
        best_fit = self._best(visited.values(), cells)
        if best_fit is None or not _near(best_fit.count, cells):
            for turn in range(len(ladder.turns)):
                step = ladder.step(ladder.pitch_for(cells))
                pitches = [ladder.pitch_of(step + wide) for wide in range(-16, 17, 2)]
                self._visit_all(turn, pitches, visited, max_fits)
            best_fit = self._best(visited.values(), cells)
        assert best_fit is not None
        return ChosenVoxels(fit=best_fit, visited=tuple(visited.values()), score=_score(best_fit))

    def _most(self, cells: int) -> int:
        work = self.ladder.work(0, self.ladder.pitch_for(cells))
        return int(np.clip(1.2e8 / max(work, 1.0), 10, 120))

    def _is_thorough(self, cells: int) -> bool:
        return self._most(cells) >= 30

    def _visit(self, turn: int, pitch: float, visited: dict[tuple[int, float], LatticeFit]) -> bool:
        fit = self.ladder.fit(turn, pitch)
        if fit is not None:
            visited[turn, pitch] = fit
        return fit is not None

    def _visit_all(
        self,
        turn: int,
        pitches: Iterable[float],
        visited: dict[tuple[int, float], LatticeFit],
        max_fits: int,
    ) -> None:
        for pitch in pitches:
            if len(visited) >= max_fits:
                return
            if (turn, pitch) not in visited:
                self._visit(turn, pitch, visited)

    def _around(self, turn: int, pitch: float) -> list[float]:
        """Return pitches near one: those that divide the box, then a few to both sides."""
        step = self.ladder.step(pitch)
        sides = [step + sign * n for n in range(5) for sign in (1, -1)]
        return self.ladder.dividing(turn, pitch) + [self.ladder.pitch_of(s) for s in sides]

    def _best(self, fits: Iterable[LatticeFit], cells: int) -> FittedCells | None:
        """Return the cells nearest to the count among those with nearly the best score."""
        is_thorough = self._is_thorough(cells)
        entries = _entries(fits, self.ladder.volume)
        off = np.abs(entries.counts - cells)
        inside = np.flatnonzero(_near(entries.counts, cells))
        if len(inside):
            scores = entries.scores[inside] - COUNT_PENALTY * off[inside] / cells
            by_score = inside[np.lexsort((entries.misfits[inside], -scores))]
            good = inside[scores >= scores.max() - SCORE_TOLERANCE]
            by_count = good[np.lexsort((entries.misfits[good], -entries.scores[good], off[good]))]
            first_entries = [
                *entries.first(by_score, 6 if is_thorough else 2, max_per_row=1),
                *entries.first(by_count, 4 if is_thorough else 2, max_per_row=2),
            ]
            candidates = self._made_of(entries, first_entries, cells)
            if not candidates:  # joining changed the counts of all of those
                more_entries = entries.first(by_score, 24 if is_thorough else 6, max_per_row=4)
                candidates = self._made_of(entries, more_entries, cells)
            if candidates:
                best_worth = max(_worth(fit, cells) for fit in candidates)
                good_ones = [
                    m for m in candidates if _worth(m, cells) >= best_worth - SCORE_TOLERANCE
                ]
                if cells >= 75:  # 600 modules: such long chains are easier to unfold
                    more_entries = entries.first(by_score, 24 if is_thorough else 6, max_per_row=4)
                    layered = [
                        fit
                        for fit in (*candidates, *self._made_of(entries, more_entries, cells))
                        # layered voxels unfold more easily
                        if _worth(fit, cells) >= best_worth - 0.02
                        and has_whole_layers(fit.joined.cells)
                    ]
                    good_ones = layered or good_ones
                return min(good_ones, key=lambda fit: self._rank(fit, cells))
        by_off = np.lexsort((entries.misfits, -entries.scores, off))
        nearest = by_off[np.sort(np.unique(entries.counts[by_off], return_index=True)[1])]
        candidates = [
            self.ladder.fitted_cells(*entries.at(entry))
            for entry in nearest[: 12 if is_thorough else 4].tolist()
        ]
        return min(candidates, key=lambda fit: self._rank(fit, cells), default=None)

    def _rank(self, fit: FittedCells, cells: int) -> tuple[int, float, float]:
        misfit = abs(fit.count * fit.pitch**3 / self.ladder.volume - 1.0)
        return abs(fit.count - cells), -_score(fit), misfit

    def _made_of(self, entries: _Entries, numbers: Iterable[int], cells: int) -> list[FittedCells]:
        fits = (self.ladder.fitted_cells(*entries.at(entry)) for entry in dict.fromkeys(numbers))
        return [fit for fit in fits if _near(fit.count, cells)]

    def _offer(self, cells: int, *, above: bool) -> int | None:
        """Return the nearest count to one side that a request for it gives, or None."""
        choice = self.choose(cells)
        chosen_count = choice.fit.count
        # What comes nearer than what was made would belie it.
        limit = (
            max(chosen_count + 1, 2 * cells - chosen_count)
            if above
            else min(chosen_count - 1, 2 * cells - chosen_count)
        )
        max_tries = 8 if self._is_thorough(cells) else 2
        for count in islice(self._likely(choice, limit, above=above), max_tries):
            offer = self._held(count, limit, above=above, max_tries=2)
            if offer is not None:
                return offer
        for factor in OTHER_COUNTS[above]:
            offer = self._held(max(1, round(limit * factor)), limit, above=above, max_tries=3)
            if offer is not None:
                return offer
        return None

    def _held(self, count: int, limit: int, *, above: bool, max_tries: int) -> int | None:
        """Return a reproducible count beyond a limit: this one, or what it gives; else None."""
        for _ in range(max_tries):
            if count < limit if above else count > limit:
                return None
            offered_count = self.choose(count).fit.count
            if offered_count == count:
                return count
            count = offered_count
        return None

    def _likely(self, choice: ChosenVoxels, limit: int, *, above: bool) -> Iterator[int]:
        """Yield counts of nearby fits to one side, those with the largest overlap first."""
        ladder = self.ladder
        fits = {(fit.turn, fit.pitch): fit for fit in choice.visited}
        turn, pitch = choice.fit.turn, choice.fit.pitch
        for pitch_factor in OTHER_PITCHES[above]:
            near = [ladder.pitch_of(ladder.step(pitch * pitch_factor))]
            self._visit_all(
                turn, near + ladder.dividing(turn, pitch * pitch_factor), fits, len(fits) + 3
            )
        entries = _entries(fits.values(), ladder.volume)
        counts = entries.counts
        beyond = counts >= limit if above else counts <= limit
        far = counts <= MAX_OFFER_FACTOR * limit if above else counts >= limit / MAX_OFFER_FACTOR
        reached, row_of_count = np.unique(counts, return_inverse=True)
        best_scores = np.full(len(reached), -np.inf)
        np.maximum.at(best_scores, row_of_count, entries.scores)
        rows = np.unique(row_of_count[beyond & far])
        offered: set[int] = set()
        for slack in (0.03, 0.1, 0.3, 1.0):
            min_score = choice.score - SCORE_TOLERANCE - slack
            for row in (rows if above else rows[::-1])[:400].tolist():
                count = int(reached[row])
                if best_scores[row] < min_score or count in offered:
                    continue
                low, high = np.searchsorted(reached, [0.9 * count, 1.1 * count])
                off = np.abs(reached[low:high] - count) / count
                if (
                    best_scores[row]
                    >= (best_scores[low:high] - COUNT_PENALTY * off).max() - SCORE_TOLERANCE
                ):
                    offered.add(count)
                    yield count


def _near(counts: Ints | int, cells: int) -> Flags:
    """Return True for nonzero counts within ``COUNT_TOLERANCE`` of a requested one."""
    return np.asarray(
        (np.abs(np.asarray(counts) - cells) <= COUNT_TOLERANCE * cells) & (counts != 0)
    )


def _entries(fits: Iterable[LatticeFit], volume: float) -> _Entries:
    listed = tuple(fits)
    sizes = [fit.counts.size for fit in listed]
    counts = np.concatenate([fit.counts.ravel() for fit in listed])
    scores = np.concatenate([(fit.ious + _bonus(fit.turn)).ravel() for fit in listed])
    rows = np.repeat(np.arange(len(listed)), sizes)
    places = np.concatenate([np.arange(size) for size in sizes])
    nonzero = np.flatnonzero(counts)
    volumes = np.array([fit.pitch**3 for fit in listed])[rows] * counts
    return _Entries(
        fits=listed,
        rows=rows[nonzero],
        places=places[nonzero],
        counts=counts[nonzero],
        scores=np.round(scores[nonzero], 9),
        misfits=np.abs(volumes[nonzero] / volume - 1.0),
    )


def _count_factor(fit: LatticeFit, cells: int) -> float:
    """Return the factor of the pitch that brings the best offset near the count."""
    count = int(fit.counts.ravel()[int(np.argmax(fit.ious))])
    return float(np.clip(np.cbrt(max(count, 0.2) / cells), 0.6, 1.4))


def _bonus(turn: int) -> float:
    return UPRIGHT_BONUS if turn == 0 else 0.0


def _score(fit: FittedCells) -> float:
    return round(fit.iou + _bonus(fit.turn), 9)


def _worth(fit: FittedCells, cells: int) -> float:
    """Return the score less the penalty of the count."""
    return _score(fit) - COUNT_PENALTY * abs(fit.count - cells) / cells


def _merit(fit: LatticeFit, cells: int) -> float:
    """Return the best score of a fit less the deviation beyond ``COUNT_TOLERANCE``."""
    off = np.abs(fit.counts - cells) / cells
    scores = fit.ious + _bonus(fit.turn) - np.maximum(0.0, off - COUNT_TOLERANCE)
    return float(scores.max())
