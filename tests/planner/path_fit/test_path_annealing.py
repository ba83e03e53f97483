"""Annealing of paths: whatever is moved, a path remains one, and it fills what has a path."""

from hashlib import sha256

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.core import FULL, MOVES, anneal
from foldback.planner.core.structures import CLOSED, Field, Schedule
from foldback.planner.path_fit.fit import first_step, schedule
from tests.case import case


def around(fill: Ints) -> tuple[Ints, Ints]:
    """Return a grid of fills with two empty cells and a closed rim around, and the flat steps."""
    padded = np.pad(np.pad(fill, 2), 1, constant_values=CLOSED).astype(np.int64)
    _, y, z = padded.shape
    return padded, np.array([y * z, -y * z, z, -z, 1, -1], dtype=np.int64)


def field(fill: Ints, cells: int, *, cost: int = 0) -> tuple[Field, Ints]:
    grid, steps = around(fill)
    flat = grid.reshape(-1)
    costs = np.where(flat == 0, cost, 0).astype(np.int64)
    volume = float(flat[flat > 0].sum()) / FULL
    return Field(flat, costs, steps, volume, float(cells), int(0.9 * cells), cells), grid


def cells_of(path: Ints, grid: Ints) -> Ints:
    return np.stack(np.unravel_index(path, grid.shape), axis=1)


def check(annealing_field: Field, grid: Ints, path: Ints, energy: float) -> Ints:
    cells = cells_of(path, grid)
    assert len(np.unique(path)) == len(path) <= annealing_field.high
    assert (np.abs(np.diff(cells, axis=0)).sum(axis=1) == 1).all()
    fills = annealing_field.fill[path]
    assert (fills >= 0).all()
    shared = float(fills.sum()) / FULL
    expected = -annealing_field.target * shared / (annealing_field.volume + len(path) - shared)
    expected += (
        0.6 * max(0, annealing_field.low - len(path))
        + float(annealing_field.cost[path].sum()) / FULL
    )
    assert abs(energy - expected) < 1e-9
    return cells


def overlap(annealing_field: Field, path: Ints) -> float:
    shared = float(annealing_field.fill[path].sum()) / FULL
    return shared / (annealing_field.volume + len(path) - shared)


def only(kinds: list[int], moves: int) -> Schedule:
    usual = schedule(moves)
    return usual._replace(kinds=np.resize(np.array(kinds, dtype=np.int64), 256))


def test_moves_keep_a_path_and_its_sums() -> None:
    rng = np.random.default_rng(0)
    accepted = np.zeros(MOVES, dtype=np.int64)
    for seed in range(60):
        fill = rng.integers(0, FULL + 1, (4, 5, 4))
        annealing_field, grid = field(fill, 40, cost=int(rng.integers(0, FULL)))
        moves = int(rng.integers(1, 6000))
        for rises in (False, True):
            start = first_step(annealing_field, rises=rises)
            path, energy, counts = anneal(annealing_field, schedule(moves), start, seed, rises)
            cells = check(annealing_field, grid, path, energy)
            accepted += counts
            if rises:
                steps = np.diff(cells, axis=0)
                assert (steps[:, 2] >= 0).all() and steps[0, 2] == 0
    assert (accepted > 0).all()


def test_each_move_alone_keeps_a_path() -> None:
    annealing_field, grid = field(np.full((4, 4, 4), FULL // 2), 50)
    for kind in range(MOVES):
        with case(str(kind)):
            path, energy, _ = anneal(
                annealing_field, only([kind, 3, 0], 3000), first_step(annealing_field), 1, False
            )
            check(annealing_field, grid, path, energy)


def test_shapes_with_a_path_are_filled() -> None:
    ring = np.zeros((7, 7, 1), dtype=np.int64)
    ring[[0, -1]] = FULL
    ring[:, [0, -1]] = FULL
    bay = np.full((5, 5, 2), FULL)
    bay[1:4, 1:] = 0
    for name, fill in {"box": np.full((4, 5, 8), FULL), "ring": ring, "bay": bay}.items():
        with case(name):
            annealing_field, _ = field(fill, int((fill > 0).sum()))
            path, _, _ = anneal(
                annealing_field, schedule(400_000), first_step(annealing_field), 1, False
            )
            assert overlap(annealing_field, path) > 0.97


def test_a_chessboard_trap_costs_few_cells() -> None:
    trap = np.full((3, 3, 3), FULL)
    trap[0, 0, 1] = 0  # 14 cells of one colour and 12 of the other have no path
    annealing_field, _ = field(trap, 26)
    path, _, _ = anneal(annealing_field, schedule(200_000), first_step(annealing_field), 1, False)
    assert overlap(annealing_field, path) >= 24 / 27


def test_air_that_costs_is_avoided() -> None:
    two = np.zeros((5, 3, 3), dtype=np.int64)
    two[[0, 1, 3, 4]] = FULL  # two boxes with one layer of air between them
    crossed = []
    for cost in (0, 20 * FULL):
        annealing_field, _ = field(two, 36, cost=cost)
        path, _, _ = anneal(
            annealing_field, schedule(200_000), first_step(annealing_field), 1, False
        )
        crossed.append(int((annealing_field.fill[path] == 0).sum()))
    assert crossed[0] > 0 == crossed[1]


def test_a_seed_gives_the_same_cells_on_every_machine() -> None:
    fill = np.arange(4 * 5 * 6).reshape(4, 5, 6) * 37 % (FULL + 1)
    annealing_field, _ = field(fill, 40)
    path, _, _ = anneal(annealing_field, schedule(20_000), first_step(annealing_field), 5, False)
    second_path, _, _ = anneal(
        annealing_field, schedule(20_000), first_step(annealing_field), 5, False
    )
    assert (path == second_path).all()
    assert sha256(path.tobytes()).hexdigest()[:16] == "2119840c365578fd"
