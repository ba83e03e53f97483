"""Snake cubes solved: counts of 3³ that others published, known cubes, and random cubes of 4³."""

from __future__ import annotations

import time
from collections import Counter
from typing import Final

import numpy as np

from bench.sections import Section
from foldback.planner.arrays import Ints
from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.pathfinding.snake_cubes import (
    box_cells,
    corners_of,
    find_common_sequence,
    find_sequence,
    fold_sequence,
    symmetries_of,
)
from foldback.planner.shapes.shape import Shape
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.figures import known_snake_cubes

PUBLISHED: Final = {"sequences": 11487, "solutions": 51704, "with one solution": 3639, "most": 142}
"""Numbers of sequences of 27 pieces that fold into a cube of 3³, and of their solutions, as three
independent programs count them: oscar6echo/snake-cube-go states all four."""
RANDOM_CUBES: Final = 24
"""Number of random sequences of 64 pieces that fill a cube of 4³."""
PAIRS: Final = (((3, 3, 3), (1, 3, 9)), ((4, 4, 4), (2, 4, 8)), ((2, 6, 6), (3, 4, 6)))
"""Sides of two boxes for which a common sequence is searched."""


def snake_cubes(reference_seconds: float) -> Section:
    """Count the snake cubes of 3³, and solve known ones and random ones of 4³."""
    section = Section(name="snake-cubes")
    _add_counts(section, reference_seconds)
    _add_known(section)
    _add_random(section, reference_seconds)
    _add_corners(section)
    for first, second in PAIRS:
        started = time.process_time()
        search = find_common_sequence((box_cells(first), box_cells(second)))
        is_solved = len(search.paths) > 0
        section.add(
            f"one sequence for {first} and {second}",
            f"{'found' if is_solved else 'not found'}, {time.process_time() - started:.2f} s",
            "found",
            is_solved,
        )
        section.rows.append({"solids": [first, second], "solved": is_solved, "steps": search.steps})
    return section


def count_sequences(cells: Ints, paths: Ints) -> dict[str, int]:
    """Count sequences up to reversal, and their solutions, from all paths through a solid.

    The solutions of a sequence are its paths up to symmetries of the solid. In the number of all
    solutions, a path and the same one read from the other end count once.

    Args:
        cells: (n, 3) cells of the solid.
        paths: (m, n, 3) its paths, one of all that its symmetries map to each other.
    """
    corners = corners_of(paths)
    weights = 1 << np.arange(corners.shape[1])
    keys, reversed_keys = corners @ weights, corners[:, ::-1] @ weights
    solutions = Counter(keys.tolist())
    same = np.flatnonzero(keys == reversed_keys)
    order = {cell: index for index, cell in enumerate(map(tuple, cells.tolist()))}
    symmetries = symmetries_of(cells)
    their_own_reverse = 0
    for path in paths[same].tolist():
        row = np.array([order[tuple(cell)] for cell in path])
        their_own_reverse += int((symmetries[:, row[::-1]] == row).all(axis=1).any())
    per_sequence = [solutions[key] for key in set(np.minimum(keys, reversed_keys).tolist())]
    return {
        "sequences": len(per_sequence),
        "solutions": (len(paths) + their_own_reverse) // 2,
        "with one solution": per_sequence.count(1),
        "most": max(per_sequence),
    }


def _add_counts(section: Section, reference_seconds: float) -> None:
    cells = box_cells((3, 3, 3))
    started = time.process_time()
    search = find_sequence(cells, max_solutions=200_000)
    counts = count_sequences(cells, search.paths[:, 0])
    seconds = time.process_time() - started
    for name, published in PUBLISHED.items():
        is_same = search.is_complete and counts[name] == published
        section.add(f"3³, {name}", str(counts[name]), str(published), is_same)
    section.add(
        "3³, processor time", f"{seconds:.1f} s, {seconds / reference_seconds:.2f} × the reference"
    )
    section.rows.append(
        {"solid": [3, 3, 3], **counts, "paths": len(search.paths), "steps": search.steps}
    )


def _add_known(section: Section) -> None:
    for puzzle in known_snake_cubes():
        search = fold_sequence(puzzle.sequence, box_cells((puzzle.side, puzzle.side, puzzle.side)))
        is_same = search.is_complete and len(search.paths) == puzzle.solutions
        section.add(
            f"{puzzle.names[0]}, solutions", str(len(search.paths)), str(puzzle.solutions), is_same
        )
        section.rows.append(
            {
                "names": puzzle.names,
                "sequence": puzzle.sequence.text(),
                "solutions": len(search.paths),
                "steps": search.steps,
            }
        )


def _add_random(section: Section, reference_seconds: float) -> None:
    cells = box_cells((4, 4, 4))
    steps, seconds = [], []
    for seed in range(RANDOM_CUBES):
        path = exact_path(Shape.from_cells(cells), seed=seed, eased=False).cells
        assert path is not None
        sequence = CubeSequence(tuple(corners_of(path).tolist()))
        started = time.process_time()
        search = fold_sequence(sequence, cells, max_solutions=1)
        section.rows.append(
            {"sequence": sequence.text(), "solved": len(search.paths) > 0, "steps": search.steps}
        )
        if len(search.paths):
            steps.append(search.steps)
            seconds.append(time.process_time() - started)
    section.add(
        "4³, random sequences solved",
        f"{len(steps)} of {RANDOM_CUBES}",
        f"{RANDOM_CUBES} of {RANDOM_CUBES}",
        len(steps) == RANDOM_CUBES,
    )
    section.add("4³, steps", f"median {np.median(steps):.0f}, most {max(steps)}")
    section.add(
        "4³, processor time",
        f"median {np.median(seconds):.2f} s, most {max(seconds):.1f} s "
        f"({max(seconds) / reference_seconds:.1f} × the reference)",
    )


def _add_corners(section: Section) -> None:
    """Add the numbers of corners with which a sequence fills 3³, each proved."""
    possible, is_complete = [], True
    for corners in range(26):
        search = find_sequence(box_cells((3, 3, 3)), corners)
        is_complete &= search.is_complete or len(search.paths) > 0
        if len(search.paths):
            possible.append(corners)
    section.add(
        "3³, possible numbers of corners",
        f"{possible[0]} to {possible[-1]}",
        "proved",
        is_complete and len(possible) == possible[-1] - possible[0] + 1,
    )
    section.rows.append({"solid": [3, 3, 3], "corners": possible})
