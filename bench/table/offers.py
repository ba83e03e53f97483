"""Offered changes of a torus without a path for a table, and the results of folding them.

``python -m bench --only table-offers`` takes a quarter of an hour: the first offer for each count
is folded once, with playback and certificate.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any, Final, cast

import trimesh

from bench.command import fold
from bench.sections import Section
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.readers import read
from foldback.planner.shapes.solid import Solid
from foldback.planner.table_paths.offers import Offer, table_offers

COUNTS: Final = (80, 100, 120, 160, 200, 240, 300)
"""Numbers of modules that are requested."""
FILENAME: Final = "torus.stl"
"""Name of the file with the torus."""


def table_offers_section(reference_seconds: float) -> Section:
    """Fold the first offer for each count of modules of a torus."""
    section = Section(name="table-offers")
    data = cast(
        "bytes", trimesh.creation.torus(major_radius=10, minor_radius=4).export(file_type="stl")
    )
    folded: dict[tuple[str, ...], dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as directory:
        file = Path(directory) / FILENAME
        file.write_bytes(data)
        for count in COUNTS:
            start_s = time.process_time()
            offer = _first_offer(data, count)
            row = {
                "asked": count,
                "offered": "as it is" if offer is None else offer.kind,
                "search_cpu_s": time.process_time() - start_s,
            }
            options = _options(count, offer)
            if options not in folded:
                folded[options] = _folded(file, options)
            section.rows.append({**row, "options": " ".join(options), **folded[options]})
    good = sum(row["status"] == "verified" for row in section.rows)
    section.add(
        f"torus at {', '.join(map(str, COUNTS))}: what is offered first for a table folds",
        f"{good} of {len(COUNTS)}, {len(folded)} different folds, longest "
        f"{max(row['wall_s'] for row in section.rows):.0f} s (reference {reference_seconds:.2f} s)",
        f"{len(COUNTS)} of {len(COUNTS)}",
        good == len(COUNTS),
    )
    return section


def _first_offer(data: bytes, request: int) -> Offer | None:
    """Return the first offer; None if the shape has a path without a change."""
    options = PathOptions(modules=request, world="table")
    if prepare(data, FILENAME, options).chains:
        return None
    solid = read(data, filename=FILENAME)
    assert isinstance(solid, Solid)
    return next(table_offers(solid, options))


def _options(request: int, offer: Offer | None) -> tuple[str, ...]:
    """Return the options of the command line that accept an offer."""
    change = {"modules": request, **({} if offer is None else offer.change)}
    repair = ("--repair",) if change.pop("repair", False) else ()
    return tuple(f"--{name}={value}" for name, value in change.items()) + repair


def _folded(file: Path, options: tuple[str, ...]) -> dict[str, Any]:
    run = fold(str(file), "--world", "table", *options)
    certificate = run.summary.get("certificate") or {}
    return {
        "modules": run.summary.get("modules"),
        "status": run.summary["status"],
        "attempts": run.summary.get("attempts"),
        "torque_wp": (certificate.get("table") or {}).get("torque"),
        "wall_s": run.wall_s,
    }
