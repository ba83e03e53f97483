"""Turns: how many chains fold in turns, in how many steps, with how much travel."""

from __future__ import annotations

import time
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench.sections import Section
from foldback.planner.arrays import Array
from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core import grow
from foldback.planner.pathfinding.lattice import neighbours
from foldback.planner.pipeline.fold import fold
from foldback.planner.plan.steps import steps_of
from foldback.planner.readers import read
from foldback.planner.readers.gallery import gallery
from foldback.planner.turns.turn_sequence import NoTurns, find_turns

SIZES = (0.95, 0.9)
"""Module sizes at which random paths are folded."""
RANDOM_BOXES = (
    *((2, 3, 4), (3, 3, 3), (2, 4, 4), (3, 3, 4), (2, 4, 5), (3, 4, 4), (3, 4, 5), (2, 5, 6)),
    *((3, 3, 7), (4, 4, 4), (3, 4, 6), (2, 6, 8), (4, 5, 6)),
)
"""Boxes of 24 to 120 cells through which random paths are folded."""
RANDOM_SEEDS = 3
"""Number of random paths through each box."""
MOVES_PER_CELL = 100
"""Largest number of moves per cell in which a random path is searched for."""
SHORT_MODULES = 160
"""Number of modules of the longest chains of cubes in the section ``turns``."""
TETRAHEDRA_MODULES = 192
"""Number of modules of the longest chains of tetrahedra for which the most seconds are given."""
FRAMES_PER_STEP = 20
"""Number of frames from one rest to the next for the bound of the clearance, as in a plan."""
LONG_STRIDE = 6
"""The section ``turns`` also folds one of so many longer gallery shapes, in the order of the number
of modules; ``turns-long`` folds all of them."""
WRENCH = "wrench-160"
"""Gallery shape whose plan is made and verified."""


def turns(reference_seconds: float) -> Section:
    """Fold gallery shapes, and random paths through boxes, in turns."""
    section = Section(name="turns")
    chains = _gallery_chains(CUBE.name)
    count = sum(len(chain) <= SHORT_MODULES for chain in chains)
    chains = [*chains[:count], *chains[count::LONG_STRIDE]]
    find_turns(chains[0], module_size=0.95, at_once=None, seed=0)  # import all libraries first
    rows = [_row(chain, 0.95, reference_seconds) for chain in chains]
    _add_share(section, f"gallery to {SHORT_MODULES} cubes", rows[:count], 0.95)
    _add_share(section, f"longer shapes, one of {LONG_STRIDE}", rows[count:], 0.85)
    _add_medians(section, rows)
    for name, bar in (("seconds, 64 cubes", 1.0), ("seconds, 160 cubes", 5.0)):
        modules = int(name.split()[1])
        most_seconds = max(row["seconds"] for row in rows if row["modules"] == modules)
        section.add(f"most {name}", f"{most_seconds:.2f}", f"at most {bar}", most_seconds <= bar)
    _add_wrench(section, next(chain for chain in chains if chain.name == WRENCH))
    section.rows = [*rows, *_tetrahedra(section, reference_seconds)]
    random_chains = [
        Chain.from_path(_random_path(box, seed))
        for box in RANDOM_BOXES
        for seed in range(RANDOM_SEEDS)
    ]
    for size in SIZES:
        rows = [_row(chain, size, reference_seconds) for chain in random_chains]
        _add_share(section, f"random paths, size {size}", rows, 0.85)
        section.rows += rows
    return section


def turns_long(reference_seconds: float) -> Section:
    """Fold all gallery shapes of cubes that are longer in turns: up to an hour."""
    section = Section(name="turns-long")
    chains = _gallery_chains(CUBE.name)
    find_turns(chains[0], module_size=0.95, at_once=None, seed=0)  # import all libraries first
    long_chains = [chain for chain in chains if len(chain) > SHORT_MODULES]
    section.rows = [_row(chain, 0.95, reference_seconds) for chain in long_chains]
    _add_share(section, f"gallery beyond {SHORT_MODULES} cubes", section.rows, 0.85)
    _add_medians(section, section.rows)
    return section


def _gallery_chains(module: str) -> list[Chain]:
    """Return the chains of all gallery shapes of a kind of module, the shortest first."""
    chains: list[Chain] = []
    for shape in gallery():
        if shape.module == module:
            path = read(shape.data)
            assert isinstance(path, Path | Chain)
            chains.append(Chain.from_path(path) if isinstance(path, Path) else path)
    return sorted(chains, key=len)


def _tetrahedra(section: Section, reference_seconds: float) -> list[dict[str, Any]]:
    """Fold all gallery shapes of tetrahedra, and prove the clearance of their turns."""
    chains = _gallery_chains(TETRAHEDRON.name)
    find_turns(chains[0], module_size=0.95, at_once=None, seed=0)
    rows = [_row(chain, 0.95, reference_seconds) for chain in chains]
    _add_share(section, "tetrahedra of the gallery", rows, 0.6)
    folded = [row for row in rows if row["steps"]]
    median = float(np.median([row["turns_per_bent_hinge"] for row in folded]))
    section.add(
        "tetrahedra: turns_per_bent_hinge, median", f"{median:.3f}", "at most 1.05", median <= 1.05
    )
    seconds = max(row["seconds"] for row in rows if row["modules"] <= TETRAHEDRA_MODULES)
    section.add(f"tetrahedra: seconds to {TETRAHEDRA_MODULES}, at most", f"{seconds:.1f}")
    return rows


def _add_medians(section: Section, rows: list[dict[str, Any]]) -> None:
    folded = [row for row in rows if row["steps"]]
    for name, bar in (("turns_per_bent_hinge", 1.05), ("travel_per_least", 1.05)):
        median = float(np.median([row[name] for row in folded]))
        section.add(f"{name}, median", f"{median:.3f}", f"at most {bar}", median <= bar)


def _add_wrench(section: Section, chain: Chain) -> None:
    """Add figures of a verified plan of the wrench."""
    with TemporaryDirectory() as directory:  # figures are only made of what is written
        plan = fold(chain, seed=0, strategy="turns", directory=directory)
    steps = len(steps_of(plan).steps)
    seconds, bound = plan.certificate.fold_time_s, plan.certificate.clearance_bound
    assert seconds is not None
    assert bound is not None
    section.add(f"{WRENCH}, steps", str(steps), "at most 15", steps <= 15)
    section.add(f"{WRENCH}, fold at 1 rad/s", f"{seconds:.1f} s", "at most 24 s", seconds <= 24.0)
    section.add(f"{WRENCH}, clearance bound", f"{bound:.4f}", "at least 0.02", bound >= 0.02)


def _random_path(box: tuple[int, int, int], seed: int) -> Path:
    """Return a random path through all cells of a box."""
    cells = np.argwhere(np.ones(box, bool))
    moves = MOVES_PER_CELL * len(cells)
    length, order = grow(neighbours(cells), np.ones(len(cells), bool), -1, moves, 100 * seed)
    assert length == len(cells)
    return Path.from_cells(cells[order].tolist(), name=f"{'×'.join(map(str, box))}, seed {seed}")


def _row(chain: Chain, size: float, reference_seconds: float) -> dict[str, Any]:
    start_s = time.process_time()
    sequence = find_turns(chain, module_size=size, at_once=None, seed=0)
    seconds = time.process_time() - start_s
    bent = int(np.count_nonzero(chain.folded_rad))
    row: dict[str, Any] = {
        "name": chain.name,
        "modules": len(chain),
        "size": size,
        "bent": bent,
        "seconds": round(seconds, 2),
        "ratio": round(seconds / reference_seconds, 2),
    }
    if isinstance(sequence, NoTurns):
        return row | {"steps": 0, "outcome": sequence.outcome}
    rests = sequence.rest_angles_rad
    travel = float(np.abs(np.diff(rests, axis=0)).sum())
    return row | {
        "steps": len(sequence.hinges),
        "turns": sequence.turns,
        "turns_per_bent_hinge": round(sequence.turns / bent, 3),
        "travel_per_least": round(travel / float(np.abs(chain.folded_rad).sum()), 3),
        "room": round(sequence.room, 4),
        "bound": round(sweep(chain, _frames(rests), module_size=size).bound, 4),
    }


def _frames(rests: Array) -> Array:
    """Return frames between rests: the bound of a clearance is the better the nearer they are."""
    at = np.arange((len(rests) - 1) * FRAMES_PER_STEP + 1) / FRAMES_PER_STEP
    before = np.minimum(at.astype(np.int64), len(rests) - 2)
    return rests[before] + (at - before)[:, None] * (rests[before + 1] - rests[before])


def _add_share(section: Section, name: str, rows: list[dict[str, Any]], bar: float) -> None:
    count = sum(bool(row["steps"]) for row in rows)
    section.add(name, f"{count} of {len(rows)}", f"{bar:.0%}", count >= bar * len(rows))
