"""Explosions on a table: shapes that end straight, and the torque that they need.

``python -m bench --only table-folds``; ``table-long-folds``, half an hour, for chains of 80 and
160. An attempt is one path and one seed. A run is straight if one of its attempts is. The
certificate checks every frame independently of the explosion.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.sections import Section
from bench.table.paths import gallery_cells
from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.clearance.sweep import sweep
from foldback.planner.explosion.table.table_explosion import explode_on_table
from foldback.planner.parameters.explosion import Base, TableParameters
from tests.planner.table_search import table_paths

Cells = NDArray[np.int64]
SMALL_BOXES: Final = {"4×3×2": (4, 3, 2), "3×3×3": (3, 3, 3), "4×4×2": (4, 4, 2)}
"""Sides of small boxes, in cells."""
SEEDS_PER_BOX: Final = 5
"""Number of random seeds with which each small box is folded on a table."""
MAX_ATTEMPTS: Final = 8
"""Maximum number of attempts (another path through the shape, the same seed) to fold a shape on a
table; if none succeeds, the fold counts as failed."""
LONG_SHAPES: Final = ("wrench-80", "wrench-160", "mallet-160")
"""Shapes of the gallery with 80 and 160 modules."""
BOX_MODULE_SIZE, GALLERY_MODULE_SIZE = 0.98, 0.95
"""Module sizes, as fractions of the pitch, of small boxes and of shapes of the gallery."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions of a fold.

    Attributes:
        friction: Coefficient of friction between modules and table.
        limit: Maximum static torque of a hinge, w·p.
        size: Module size as a fraction of the pitch.
        base: Support of the base module.
    """

    friction: float
    limit: float
    size: float
    base: Base = "free"


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Result of the attempts at a shape.

    Attributes:
        torque: Largest static torque of a hinge, w·p; None if no attempt succeeded.
        clearance: Least clearance of the record, pitches; None likewise.
        attempts: Number of attempts.
        seconds: Wall time, s.
        reason: Reason why the last attempt failed; empty if it did not.
    """

    torque: float | None
    clearance: float | None
    attempts: int
    seconds: float
    reason: str = ""


def table_folds(reference_seconds: float) -> Section:
    """Fold small boxes with and without friction, and the gallery up to 64 modules."""
    section = Section(name="table-folds")
    for conditions, seeds, bar in (
        (
            Conditions(friction=0.0, limit=4.0, size=BOX_MODULE_SIZE),
            SEEDS_PER_BOX,
            "≤ 4 w·p, ≥ 14 of 15, ≤ 30 s",
        ),
        (
            Conditions(friction=0.1, base="free", limit=10.0, size=BOX_MODULE_SIZE),
            SEEDS_PER_BOX,
            "≤ 10 w·p",
        ),
        (Conditions(friction=0.1, base="clamped", limit=10.0, size=BOX_MODULE_SIZE), 1, ""),
    ):
        runs = [
            _run(section, name, np.argwhere(np.ones(sides, dtype=bool)), seed, conditions)
            for name, sides in SMALL_BOXES.items()
            for seed in range(seeds)
        ]
        limit = conditions.limit
        good = [run for run in runs if run.torque is not None and run.torque <= limit]
        max_torque = max((run.torque or 0.0 for run in good), default=0.0)
        section.add(
            f"24 to 32 modules, friction {conditions.friction:g}, {conditions.base}: straight "
            f"within {limit:g} w·p at {BOX_MODULE_SIZE:g}",
            f"{len(good)} of {len(runs)}, at most {max_torque:.2f} w·p, median "
            f"{np.median([r.seconds for r in runs]):.1f} s, longest "
            f"{max(r.seconds for r in runs):.1f} s (reference {reference_seconds:.2f} s)",
            bar,
            len(good) >= len(runs) - 1 if bar else None,
        )
    runs = [
        _run(section, name, cells, 0, Conditions(friction=0.0, limit=8.0, size=GALLERY_MODULE_SIZE))
        for name, cells in gallery_cells(64)
        if name != "wrench-24"  # it has no path for a table
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
    """Fold the longer chains."""
    del reference_seconds
    section = Section(name="table-long-folds")
    for name, cells in gallery_cells(160):
        if name in LONG_SHAPES:
            conditions = Conditions(friction=0.0, limit=10.0, size=GALLERY_MODULE_SIZE)
            run = _run(section, name, cells, 0, conditions)
            section.add(
                f"{name}: straight within 10 w·p at {GALLERY_MODULE_SIZE}",
                f"{run.reason[:60] if run.torque is None else f'{run.torque:.2f} w·p'}, "
                f"{run.attempts} attempts, {run.seconds:.0f} s",
                "shown",
            )
    return section


def _run(section: Section, name: str, cells: Cells, seed: int, conditions: Conditions) -> Result:
    result = explored(name, cells, seed, conditions)
    section.rows.append(
        {
            "shape": name,
            "seed": seed,
            "friction": conditions.friction,
            "base": conditions.base,
            "torque_wp": result.torque,
            "clearance": result.clearance,
            "attempts": result.attempts,
            "s": result.seconds,
            "reason": result.reason[:80],
        }
    )
    return result


def explored(name: str, cells: Cells, seed: int, conditions: Conditions) -> Result:
    """Try a shape until an attempt ends straight within the torque, and without contact."""
    start_s = time.perf_counter()
    paths = table_paths(cells, seed=seed)
    parameters = replace(
        TableParameters(),
        table_torque=conditions.limit,
        table_friction=conditions.friction,
        table_base=conditions.base,
        verify_size=conditions.size,
    )
    reason = ""
    for attempt in range(MAX_ATTEMPTS):
        path = Path.from_cells(paths[attempt % len(paths)].cells, name=name)
        chain = Chain.from_path(path)
        record = explode_on_table(chain, parameters, seed=seed)
        reason = str(record.reason or "")
        if record.status != "straight":
            continue
        assert record.frames.is_windowed
        certificate = table_certificate(
            chain,
            record.frames[::-1],
            friction=conditions.friction,
            base=conditions.base,
            on_table=True,
            height=chain.table_height,
        )
        clearance = sweep(chain, record.frames, module_size=conditions.size).clearance
        if certificate.rests and clearance > 0.0:
            return Result(
                torque=certificate.torque,
                clearance=clearance,
                attempts=attempt + 1,
                seconds=time.perf_counter() - start_s,
            )
        reason = certificate.verdict
    return Result(
        torque=None,
        clearance=None,
        attempts=MAX_ATTEMPTS,
        seconds=time.perf_counter() - start_s,
        reason=reason,
    )
