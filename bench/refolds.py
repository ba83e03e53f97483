"""Refolds: pairs of unlike shapes with as many modules, each with several seeds.

``python -m bench.refolds [PAIR …]`` prints some of them; a pair is written ``wrench-24:mallet-24``.
"""

from __future__ import annotations

import sys
import time
from functools import cache
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console

from bench.meshes import revolved
from bench.sections import Section
from bench.shape_files import SHAPES
from foldback.planner.pipeline.fold import refold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan

HOURGLASS = "hourglass"
PAIRS = (
    "wrench-24:mallet-24",
    "mallet-24:wrench-24",
    "box-4x4x4:letter-f",
    "letter-l:mallet-64",
    "four:seven",
    "letter-e:wrench-80",
    "cross:two",
    "letter-a:sword",
    "cross-3d:tower",
    "arch:snake",
    "key:plane",
    "bench:pawn",
    "bolt:picture-frame",
    "guitar:pliers",
    "wrench-160:hourglass",
    "wrench-160:mallet-160",
    "sponge:axe",
    "fish:umbrella",
    "cat:dumbbell",
    "mallet-80:letter-e",
)
"""Pairs of shapes with equal numbers of modules: from the first into the second."""
SEEDS = (0, 1, 2)
"""Seeds of both folds and of the refold."""


def refolds(reference_seconds: float, pairs: tuple[str, ...] = PAIRS) -> Section:
    """Refold all pairs with all seeds."""
    section = Section(name="refolds")
    section.rows = [_row(pair, seed) for pair in pairs for seed in SEEDS]
    rows, expected = section.rows, len(pairs) * len(SEEDS)
    verified = sum(row["verified"] for row in rows)
    section.add("verified", f"{verified} of {expected}", "all", verified == expected)
    first = sum(row["playbacks"] == 1 for row in rows)
    section.add("at the first playback", f"{first} of {expected}")
    bounds = [row["bound"] for row in rows if row["bound"] is not None]
    section.add("least clearance bound", f"{min(bounds):.4f} pitch")
    seconds = sum(row["cpu s"] for row in rows)
    ratio = seconds / reference_seconds if reference_seconds else 0.0
    section.add("refolds in all, without folds", f"{seconds:.0f} s ({ratio:.0f} × reference)")
    return section


def _row(pair: str, seed: int) -> dict[str, Any]:
    first, second = pair.split(":")
    start, end = _plan(first, seed), _plan(second, seed)
    cpu = time.process_time()
    plan = refold(start, end.chain, seed=seed)
    cpu = time.process_time() - cpu
    return {
        "pair": pair,
        "modules": len(plan.chain),
        "seed": seed,
        "verified": plan.certificate.verified,
        "verdict": plan.certificate.verdict,
        "playbacks": len(plan.attempts),
        "patience": max(attempt.get("patience", 0) for attempt in plan.attempts),
        "bound": plan.certificate.clearance_bound,
        "fold time s": plan.certificate.fold_time_s,
        "cpu s": cpu,
    }


@cache
def _plan(name: str, seed: int) -> Plan:
    """Return the plan of a shape of the gallery, or of the hourglass with 160 cubes."""
    if name == HOURGLASS:
        profile = [(0.0, -1.3), *((0.35 + 0.65 * abs(z) ** 1.2, z) for z in _heights()), (0.0, 1.3)]
        data = revolved(profile).export(file_type="stl")
        # Blocks of 2×2×2 cubes fit the number exactly; other methods come near it.
        request = FoldRequest(filename="hourglass.stl", modules=160, method="blocks", seed=seed)
    else:
        data = (SHAPES / f"{name}.json").read_bytes()
        request = FoldRequest(filename=f"{name}.json", seed=seed)
    assert isinstance(data, bytes)
    with TemporaryDirectory() as directory:
        Workspace(FilePath(directory)).write_request(request, data)
        run_stages(FilePath(directory))
        return Plan.load(FilePath(directory) / "plan.npz")


def _heights() -> list[float]:
    return [1.3 * (k / 20.0 - 1.0) for k in range(41)]


def main() -> None:
    """Print the pairs of the command line."""
    refolds(0.0, tuple(sys.argv[1:]) or PAIRS).show(Console(width=200))


if __name__ == "__main__":
    main()
