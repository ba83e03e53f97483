"""Chains of tetrahedra: verdicts, times, and the largest module size without contact."""

from __future__ import annotations

import json
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.command import Run, fold
from bench.sections import Section
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import ring_pairs
from foldback.planner.clearance.margins import largest_size
from foldback.planner.pathfinding.eulerian_circuits import eulerian_circuit
from foldback.planner.pathfinding.trail_search import find_trails
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.readers.gallery import gallery
from foldback.planner.shapes.shape import Shape

SEEDS = (0, 1, 2)
"""Seeds with which each chain is folded."""
LARGE = (5, 5, 4)
"""Sides of a block of cells whose chain is folded once, by one command."""
LONG_TRAIL_TETRAHEDRA = 100_000
"""Minimum number of tetrahedra of a very long chain whose path is computed to measure the time,
without folding it. The time grows with it."""
SIZED = ("tetra-wrench", "tetra-cube-2", "tetra-letter-f")
"""Shapes whose largest module size without contact is measured."""


def tetrahedra(reference_seconds: float) -> Section:
    """Measure the gallery's chains of tetrahedra, a large one, and a long trail."""
    section = Section(name="tetrahedra")
    shapes = [shape for shape in gallery() if shape.module == "tetrahedron"]
    fold("tetra-ring")
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        runs = {
            (shape.name, seed): fold(
                shape.name, "--seed", str(seed), out=Path(folder) / f"{shape.name}-{seed}"
            )
            for shape in shapes
            for seed in SEEDS
        }
        section.rows += [_row(name, seed, run) for (name, seed), run in runs.items()]
        verified = sum(run.code == 0 for run in runs.values())
        first = sum(
            run.code == 0 and _attempts(Path(folder) / f"{name}-{seed}") == 1
            for (name, seed), run in runs.items()
        )
        section.add(
            "gallery up to 400 modules, seeds 0–2, verified at size 0.95",
            f"{verified} of {len(runs)}, {first} at the first try",
            "all",
            verified == len(runs),
        )
        ends = (run.summary["certificate"]["rms_position_error"] for run in runs.values())
        rms = max(end for end in ends if end is not None)
        section.add("final RMS of the playback", f"{rms:.1e} pitch", "≤ 0.01", rms <= 0.01)
        for name, label, bar in (
            ("tetra-wrench", "192-module wrench, explosion + playback", 8.0),
            ("tetra-slab", "384-module slab, explosion + playback", 30.0),
        ):
            seconds = sorted(_computing(runs[name, seed]) for seed in SEEDS)[1]
            section.add(
                label,
                f"{seconds:.2f} s ({seconds / reference_seconds:.1f} × reference)",
                f"< {bar:g} s",
                seconds < bar,
            )
        sizes = {name: _largest(Path(folder) / f"{name}-0") for name in SIZED}
        section.rows += [{"shape": name, "largest size": size} for name, size in sizes.items()]
        smallest = min(sizes.values())
        section.add(
            "largest module size at which the plan is clear, least of three",
            f"{smallest:.3f}",
            "≥ 0.90",
            smallest >= 0.9,
        )
        _large(section, Path(folder))
    _trail(section)
    return section


def _row(name: str, seed: int, run: Run) -> dict[str, Any]:
    summary = run.summary
    certificate, playback = summary["certificate"], summary["playback"] or {}
    return {
        "shape": name,
        "modules": summary["modules"],
        "seed": seed,
        "verdict": certificate["verdict"],
        "clearance": certificate["min_clearance"],
        "in playback": certificate["min_clearance_playback"],
        "rms": playback.get("rms_position_error"),
        "steps": summary["explosion"]["steps"] + playback.get("steps", 0),
        "explosion + playback s": _computing(run),
        "wall s": run.wall_s,
        "MB": run.peak_mb,
    }


def _attempts(directory: Path) -> int:
    """Return the number of attempts of a plan: explosions and playbacks."""
    return len(json.loads((directory / "attempts.json").read_bytes()))


def _computing(run: Run) -> float:
    playback = run.summary["playback"] or {}
    return run.summary["explosion"]["seconds"] + playback.get("seconds", 0.0)


def _largest(directory: Path) -> float:
    plan = Plan.load(directory / "plan.npz")
    return largest_size(plan.chain, (plan.joint_angles_rad,), clear_at=plan.certificate.module_size)


def _large(section: Section, folder: Path) -> None:
    cells = np.array(list(product(*map(range, LARGE))))
    trail = find_trails(Shape.from_cells(cells, name="large")).trails[0]
    file = folder / "large.json"
    file.write_bytes(write_chain(Chain.from_trail(trail)))
    run = fold(str(file))
    section.rows.append(_row("large", 0, run))
    section.add(
        f"{len(trail)} modules, whole command",
        f"{run.wall_s:.0f} s: {run.summary['certificate']['verdict']}",
        "shown",
    )


def _trail(section: Section) -> None:
    side = round((LONG_TRAIL_TETRAHEDRA / 12) ** (1 / 3)) + 1
    cells = np.array(list(product(range(side), repeat=3)))
    pairs = ring_pairs(cells)
    eulerian_circuit(ring_pairs(cells[:1]))
    start_s = time.perf_counter()
    nodes = eulerian_circuit(pairs)
    seconds = time.perf_counter() - start_s
    section.add(
        f"trail for {len(nodes) - 1} tetrahedra", f"{seconds:.2f} s", "< 10 s", seconds < 10
    )
