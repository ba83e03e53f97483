"""Snake cubes solved: ways to fold a sequence of pieces into solids of cells.

Searches count their work in steps, one for each attempt to place a piece: the result of a search
does not depend on the speed of the machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product
from typing import Final

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.core import snake_cube_paths
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.lattice import colours, neighbours
from foldback.planner.progress import Cancelled, never
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.figures import cube_names_of
from foldback.planner.twist_chains.folded_chains import cube_chain

MAX_PIECES: Final = 1000
"""Maximum number of pieces of a snake cube that is solved."""
DEFAULT_MAX_STEPS: Final = 100_000_000
"""Steps after which a search of up to ``USUAL_PIECES`` pieces ends without an answer: half a minute
of processor time. Longer snakes get fewer, because a step takes longer with more pieces."""
USUAL_PIECES: Final = 64
"""Number of pieces up to which searches get all steps."""
MAX_SOLUTIONS: Final = 200_000
"""Maximum number of solutions that one search lists; a cube of 3³ has 103 346 paths in all."""
SLICE_STEPS: Final = 1_000_000
"""Steps between two looks at whether the search is cancelled."""
FIRST_ATTEMPT_STEPS: Final = 50_000
"""Steps of the shortest attempts at one solution. Each attempt numbers the cells in another random
order, and every second one begins with the last piece."""
MAX_BOX_CHAINS: Final = 12
"""Maximum number of solutions of a snake cube that are tried in a fold."""
MAX_SMALL_PIECES: Final = 36
"""Maximum number of pieces of which several solutions are searched, which takes less than a second
for a box."""
LATTICE_SYMMETRIES: Final = tuple(
    np.array(
        [[sign * (axis == k) for k in range(3)] for axis, sign in zip(axes, signs, strict=True)]
    )
    for axes in permutations(range(3))
    for signs in product((1, -1), repeat=3)
)
"""The 48 rotations and mirror images of the cubic lattice, as (3, 3) matrices."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SnakeCubeSearch:
    """Result of a search for foldings of a snake cube.

    Attributes:
        paths: (m, k, n, 3) cells of the n pieces in each of k solids, for each of m solutions.
            Solutions that a symmetry of their solid maps to each other count once.
        is_complete: True if these are all solutions; without one, it is proved that there is none.
        steps: Number of steps taken.
    """

    paths: Ints
    is_complete: bool
    steps: int

    @property
    def sequences(self) -> tuple[CubeSequence, ...]:
        """Sequence of pieces of each solution."""
        return tuple(CubeSequence(tuple(row)) for row in corners_of(self.paths[:, 0]).tolist())


def fold_sequence(
    sequence: CubeSequence,
    cells: Ints,
    *,
    max_solutions: int = MAX_SOLUTIONS,
    max_steps: int = DEFAULT_MAX_STEPS,
    seed: int = 0,
    cancelled: Cancelled = never,
) -> SnakeCubeSearch:
    """Find ways to fold a sequence of pieces into a solid that it fills.

    Args:
        sequence: The pieces.
        cells: (n, 3) cells of the solid.
        max_solutions: Number of solutions after which the search ends. If it is 1, a search that
            takes long begins again in another order.
        max_steps: Number of steps after which the search ends.
        seed: Seed of the orders in which cells are tried.
        cancelled: Polled between slices of the search.

    Raises:
        InputError: ``wrong-count`` if the solid has another number of cells than there are pieces;
            ``too-many-cells`` above ``MAX_PIECES``.
    """
    if len(cells) != len(sequence):
        raise InputError(
            "wrong-count",
            f"got {len(sequence)} pieces and a solid of {len(cells)} cells, expected as many "
            "pieces as cells.",
        )
    pieces = np.array(sequence.corners, dtype=np.int8)
    return _search((cells,), pieces, None, max_solutions, max_steps, seed, cancelled)


def find_sequence(
    cells: Ints,
    corners: int | None = None,
    *,
    max_solutions: int = 1,
    max_steps: int = DEFAULT_MAX_STEPS,
    seed: int = 0,
    cancelled: Cancelled = never,
) -> SnakeCubeSearch:
    """Find sequences of so many corners that fill a solid; all other pieces are straight.

    Args:
        cells: (n, 3) cells of the solid.
        corners: Number of corners; None for any. The ends are straight.
        max_solutions, max_steps, seed, cancelled: As in ``fold_sequence``.

    Raises:
        InputError: ``wrong-count`` for more corners than there are pieces between the ends;
            ``too-many-cells`` above ``MAX_PIECES``.
    """
    if corners is not None and not 0 <= corners <= len(cells) - 2:
        raise InputError(
            "wrong-count",
            f"got {corners} corners, expected at most {max(len(cells) - 2, 0)} between the ends of "
            f"{len(cells)} pieces.",
        )
    pieces = np.full(len(cells), -1, dtype=np.int8)
    return _search((cells,), pieces, corners, max_solutions, max_steps, seed, cancelled)


def find_common_sequence(
    solids: tuple[Ints, Ints],
    corners: int | None = None,
    *,
    max_solutions: int = 1,
    max_steps: int = DEFAULT_MAX_STEPS,
    seed: int = 0,
    cancelled: Cancelled = never,
) -> SnakeCubeSearch:
    """Find sequences that fill each of two solids, with a folding into either.

    Args:
        solids: (n, 3) cells of both solids.
        corners, max_solutions, max_steps, seed, cancelled: As in ``find_sequence``.

    Raises:
        InputError: ``wrong-count`` if the solids have different numbers of cells;
            ``too-many-cells`` above ``MAX_PIECES``.
    """
    sizes = [len(cells) for cells in solids]
    if sizes[0] != sizes[1]:
        raise InputError(
            "wrong-count",
            f"got solids of {sizes[0]} and {sizes[1]} cells, expected the same number.",
        )
    pieces = np.full(sizes[0], -1, dtype=np.int8)
    return _search(solids, pieces, corners, max_solutions, max_steps, seed, cancelled)


def corners_of(paths: Ints) -> Flags:
    """Return (..., n) flags of the corners of (..., n, 3) paths."""
    corners = np.zeros(paths.shape[:-1], dtype=np.bool_)
    corners[..., 1:-1] = (np.diff(paths, n=2, axis=-2) != 0).any(axis=-1)
    return corners


def box_cells(sides: tuple[int, int, int]) -> Ints:
    """Return the (n, 3) cells of a box."""
    return np.array(list(product(*map(range, sides))), dtype=np.int64)


def boxes_of(count: int) -> tuple[tuple[int, int, int], ...]:
    """Return the sides of all boxes of so many cells, the one closest to a cube first."""
    boxes = [
        (a, b, count // (a * b))
        for a in range(1, round(count ** (1 / 3)) + 1)
        for b in range(a, count // a + 1)
        if count % (a * b) == 0 and b <= count // (a * b)
    ]
    return tuple(sorted(boxes, key=sum))


def default_max_steps(pieces: int) -> int:
    """Return the number of steps after which a search of so many pieces ends without an answer."""
    return DEFAULT_MAX_STEPS * USUAL_PIECES // max(pieces, USUAL_PIECES)


def box_chains(sequence: CubeSequence, *, seed: int = 0) -> tuple[Chain, ...]:
    """Return snake cubes that are folded into a box: a cube if there is one of so many cells.

    Several solutions are returned if the pieces are few.

    Raises:
        InputError: ``no-folding`` if the pieces fill no box, or if no way was found.
    """
    is_complete, steps = True, default_max_steps(len(sequence))
    for sides in boxes_of(len(sequence)):
        search = fold_sequence(
            sequence,
            box_cells(sides),
            max_solutions=MAX_BOX_CHAINS if len(sequence) <= MAX_SMALL_PIECES else 1,
            max_steps=steps,
            seed=seed,
        )
        steps -= search.steps
        if len(search.paths):
            box_name = f"Snake cube {' × '.join(map(str, sides))}"
            name = next(iter(cube_names_of(sequence)), box_name)
            return tuple(cube_chain(path, name=name) for path in search.paths[:, 0])
        is_complete &= search.is_complete
    if is_complete:
        raise InputError(
            "no-folding",
            f"these {len(sequence)} pieces cannot be folded into a box: all ways were tried; check "
            "the sequence, or name another solid with 'foldback solve'.",
        )
    raise InputError(
        "no-folding",
        f"no way was found to fold these {len(sequence)} pieces into a box, but not all were "
        "tried; use another random seed.",
    )


def symmetries_of(cells: Ints) -> Ints:
    """Return (s, n) permutations of a solid's cells by rotations and mirror images, each once."""
    order = {cell: index for index, cell in enumerate(map(tuple, cells.tolist()))}
    low = cells.min(axis=0)
    rows: set[tuple[int, ...]] = set()
    for symmetry in LATTICE_SYMMETRIES:
        images = cells @ symmetry.T
        images += low - images.min(axis=0)
        row = tuple(order.get(tuple(image), -1) for image in images.tolist())
        if -1 not in row:
            rows.add(row)
    return np.array(sorted(rows), dtype=np.int64)


def _search(
    solids: tuple[Ints, ...],
    pieces: np.ndarray[tuple[int], np.dtype[np.int8]],
    corners: int | None,
    max_solutions: int,
    max_steps: int,
    seed: int,
    cancelled: Cancelled,
) -> SnakeCubeSearch:
    if len(pieces) > MAX_PIECES:
        raise InputError(
            "too-many-cells", f"got {len(pieces)} pieces, expected at most {MAX_PIECES}."
        )
    random = np.random.default_rng(seed)
    steps, attempt = 0, 0
    while True:
        attempt += 1
        ordered = tuple(random.permutation(cells) for cells in solids)
        attempt_steps = FIRST_ATTEMPT_STEPS * _luby(attempt) if max_solutions == 1 else max_steps
        limit = min(attempt_steps, max_steps - steps)
        back = -1 if attempt % 2 == 0 else 1
        search = _attempt(ordered, pieces[::back].copy(), corners, max_solutions, limit, cancelled)
        steps += search.steps
        if search.is_complete or len(search.paths) or steps >= max_steps or cancelled():
            paths = search.paths[:, :, ::back]
            return SnakeCubeSearch(paths=paths, is_complete=search.is_complete, steps=steps)


def _luby(number: int) -> int:
    """Return a member of the sequence 1 1 2 1 1 2 4 …, of which number 1 is the first.

    Luby, Sinclair & Zuckerman (1993): lengths of attempts that are within a logarithm of the best
    ones for any distribution of the time that a search takes.
    """
    while (number + 1) & number:
        number -= (1 << (number.bit_length() - 1)) - 1
    return (number + 1) // 2


def _attempt(
    solids: tuple[Ints, ...],
    pieces: np.ndarray[tuple[int], np.dtype[np.int8]],
    corners: int | None,
    max_solutions: int,
    max_steps: int,
    cancelled: Cancelled,
) -> SnakeCubeSearch:
    """Search in the order of the cells until so many steps are taken."""
    near = np.array([neighbours(cells) for cells in solids])
    symmetries = _padded([symmetries_of(cells) for cells in solids])
    starts = np.array([_starts(cells) for cells in solids])
    choices = np.zeros(1, dtype=np.int64)
    paths: list[Ints] = []
    is_complete, steps, solutions = False, 0, 0
    while not is_complete and steps < max_steps and solutions < max_solutions and not cancelled():
        indices, is_complete, taken, choices = snake_cube_paths(
            near,
            symmetries,
            starts,
            pieces,
            -1 if corners is None else corners,
            choices,
            min(SLICE_STEPS, max_steps - steps),
            max_solutions - solutions,
        )
        steps, solutions = steps + taken, solutions + len(indices)
        paths.append(indices)
    merged = np.concatenate([np.empty((0, len(solids), len(pieces)), np.int64), *paths])
    placed = np.stack([cells[merged[:, k]] for k, cells in enumerate(solids)], axis=1)
    return SnakeCubeSearch(paths=placed, is_complete=is_complete, steps=steps)


def _padded(symmetries: list[Ints]) -> Ints:
    """Return (k, s, n) symmetries of k solids; those that have fewer get the identity instead."""
    count = max(map(len, symmetries))
    identity = np.arange(symmetries[0].shape[1])
    return np.array(
        [[*rows, *[identity] * (count - len(rows))] for rows in symmetries], dtype=np.int64
    )


def _starts(cells: Ints) -> Flags:
    """Return (n,) flags of the cells in which a path through all cells may begin.

    A path alternates between the two colours of a chessboard. With one cell more of a colour it
    begins there; with more than one there is no path.
    """
    sign = 1 - 2 * colours(cells)
    excess = sign.sum()
    return (sign == excess) | (excess == 0)
