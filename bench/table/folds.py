"""Explosions on a table: which shapes lie down straight, and within what torque.

``python -m bench --only table-folds``; ``table-long-folds``, half an hour, for chains of
80 and 160. An attempt is one path and one seed; a run is straight when one of a few attempts is.
Every frame is certified apart from the guard.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.table.paths import gallery_cells
from bench.tables import Section
from planner.certificate.table import table_certificate
from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.clearance.sweep import sweep
from planner.explosion.table import explode_on_table
from planner.parameters.explosion import Base, TableParameters
from tests.planner.table_search import table_paths

Cells = NDArray[np.int64]
SMALL: Final = {"4×3×2": (4, 3, 2), "3×3×3": (3, 3, 3), "4×4×2": (4, 4, 2)}
SEEDS: Final = 5
ATTEMPTS: Final = 8
LONGER: Final = ("wrench-80", "wrench-160", "mallet-160")
SIZE, LARGE = 0.98, 0.95
"""Module sizes at which small shapes, and those of the gallery, are to be clear."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is asked of a fold: friction, its hold, the largest torque in w·p, the module size."""

    friction: float
    limit: float
    size: float
    base: Base = "free"


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What came of the attempts at a shape."""

    torque: float | None
    clearance: float | None
    attempts: int
    seconds: float
    reason: str = ""


def table_folds(reference_seconds: float) -> Section:
    """Small boxes with and without friction, and the gallery up to 64 modules."""
    section = Section(name="table-folds")
    for asked, seeds, bar in (
        (Asked(friction=0.0, limit=4.0, size=SIZE), SEEDS, "≤ 4 w·p, ≥ 14 of 15, ≤ 30 s"),
        (Asked(friction=0.1, base="free", limit=10.0, size=SIZE), SEEDS, "≤ 10 w·p"),
        (Asked(friction=0.1, base="clamped", limit=10.0, size=SIZE), 1, ""),
    ):
        runs = [
            _run(section, name, np.argwhere(np.ones(sides, dtype=bool)), seed, asked)
            for name, sides in SMALL.items()
            for seed in range(seeds)
        ]
        limit = asked.limit
        good = [run for run in runs if run.torque is not None and run.torque <= limit]
        most = max((run.torque or 0.0 for run in good), default=0.0)
        section.add(
            f"24 to 32 modules, friction {asked.friction:g}, {asked.base}: straight within "
            f"{limit:g} w·p at {SIZE:g}",
            f"{len(good)} of {len(runs)}, at most {most:.2f} w·p, median "
            f"{np.median([r.seconds for r in runs]):.1f} s, longest "
            f"{max(r.seconds for r in runs):.1f} s (reference {reference_seconds:.2f} s)",
            bar,
            len(good) >= len(runs) - 1 if bar else None,
        )
    runs = [
        _run(section, name, cells, 0, Asked(friction=0.0, limit=8.0, size=LARGE))
        for name, cells in gallery_cells(64)
        if name != "wrench-24"  # which has no path for a table
    ]
    good = [run for run in runs if run.torque is not None]
    section.add(
        "gallery up to 64 modules that has a path for a table: straight within 8 w·p at 0.95",
        f"{len(good)} of {len(runs)}, longest {max(r.seconds for r in runs):.0f} s",
        "≥ 90 %, ≤ 120 s",
        len(good) >= 0.9 * len(runs),
    )
    return section


def table_long_folds(reference_seconds: float) -> Section:
    """What comes of longer chains."""
    del reference_seconds
    section = Section(name="table-long-folds")
    for name, cells in gallery_cells(160):
        if name in LONGER:
            run = _run(section, name, cells, 0, Asked(friction=0.0, limit=10.0, size=LARGE))
            section.add(
                f"{name}: straight within 10 w·p at {LARGE}",
                f"{run.reason[:60] if run.torque is None else f'{run.torque:.2f} w·p'}, "
                f"{run.attempts} attempts, {run.seconds:.0f} s",
                "shown",
            )
    return section


def _run(section: Section, name: str, cells: Cells, seed: int, asked: Asked) -> Found:
    found = explored(name, cells, seed, asked)
    section.rows.append(
        {
            "shape": name,
            "seed": seed,
            "friction": asked.friction,
            "base": asked.base,
            "torque_wp": found.torque,
            "clearance": found.clearance,
            "attempts": found.attempts,
            "s": found.seconds,
            "reason": found.reason[:80],
        }
    )
    return found


def explored(name: str, cells: Cells, seed: int, asked: Asked) -> Found:
    """Attempts at a shape until one lies straight within a torque, and clear at a module size."""
    begun = time.perf_counter()
    paths = table_paths(cells, seed=seed)
    parameters = replace(
        TableParameters(),
        most_torque=asked.limit,
        friction=asked.friction,
        base=asked.base,
        verify_size=asked.size,
    )
    reason = ""
    for attempt in range(ATTEMPTS):
        path = Path.from_cells(paths[attempt % len(paths)].cells, name=name)
        chain = Chain.from_path(path)
        record = explode_on_table(chain, parameters, seed=seed)
        reason = record.reason
        if record.status != "straight":
            continue
        assert record.frames.is_windowed
        certificate = table_certificate(
            chain,
            record.frames[::-1],
            friction=asked.friction,
            base=asked.base,
            on_table=True,
            height=chain.table_height,
        )
        clearance = sweep(chain, record.frames, size=asked.size).clearance
        if certificate.rests and clearance > 0.0:
            return Found(
                torque=certificate.torque,
                clearance=clearance,
                attempts=attempt + 1,
                seconds=time.perf_counter() - begun,
            )
        reason = certificate.verdict
    return Found(
        torque=None,
        clearance=None,
        attempts=ATTEMPTS,
        seconds=time.perf_counter() - begun,
        reason=reason,
    )
