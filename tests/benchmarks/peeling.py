"""Peeling: what boxes of growing size cost.

``python -m tests.benchmarks.peeling [BOX …]`` prints them; a box is written as 12x8x12, and one
whose cells come as assembled blocks as 12x8x12:blocks.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from rich.console import Console

from planner.chain import Chain
from planner.pathfinding.assembly import layered_snake, solid_path
from planner.paths import Path
from planner.peeling import peel
from planner.peeling_parameters import PeelingParameters
from planner.peeling_window import Peelable
from planner.windows import Windows
from tests.benchmarks.tables import Section

BOXES = ("12x8x12", "16x16x16", "20x20x24")
PARTS = 4


def peeling(reference_seconds: float, boxes: tuple[str, ...] = BOXES) -> Section:
    """Boxes of 1152, 4096 and 9600 modules, peeled off and looked at."""
    del reference_seconds
    section = Section(name="peeling")
    _run("4x4x4")  # compiles
    for box in boxes:
        section.rows.append(_run(box))
    rows = section.rows
    if len({row["modules"] for row in rows}) > 1:
        slope = np.polyfit(
            np.log([row["modules"] for row in rows]), np.log([row["cpu s"] for row in rows]), 1
        )[0]
        section.add("cost ∝ modules^k", f"k = {slope:.2f}", "≤ 1.15", bool(slope <= 1.15))
    straight = sum(row["status"] == "straight" for row in rows)
    section.add("came out straight", f"{straight} of {len(rows)}", "all", straight == len(rows))
    return section


def _run(box: str) -> dict[str, Any]:
    name, _, kind = box.partition(":")
    x, y, z = (int(word) for word in name.split("x"))
    if kind:
        coarse = np.argwhere(np.ones((x // 4, y // 4, z // 4), dtype=bool))
        cells = solid_path(coarse, np.random.default_rng(0))
        assert cells is not None
    else:
        cells = layered_snake((x, y, z))
    chain = Chain.from_path(Path.from_cells(cells, name=box))
    cpu = time.process_time()
    record = peel(chain, PeelingParameters())
    cpu = time.process_time() - cpu
    return {
        "box": box,
        "modules": len(chain),
        "status": record.status,
        "wall s": record.seconds,
        "cpu s": cpu,
        "ms/module": 1e3 * cpu / len(chain),
        "frames": len(record.frames),
        "steps": record.steps,
        "clear 0.95": clearance(chain, record.frames, 0.95),
        "clear 0.98": clearance(chain, record.frames, 0.98),
    }


def clearance(chain: Chain, frames: Windows, size: float) -> float:
    """The least one at the frames and at some places between them; no proof, but quick."""
    peelable = Peelable(chain)
    worst = 1.0 - size
    first = int(frames.first[0])
    before = frames.angles_rad[: frames.offsets[1]].astype(np.float64)
    for k in range(len(frames)):
        at = int(frames.first[k])
        now = frames.angles_rad[frames.offsets[k] : frames.offsets[k + 1]].astype(np.float64)
        low = min(first, at)
        one, other = (
            np.concatenate([chain.folded_rad[low:begin], angles])
            for begin, angles in ((first, before), (at, now))
        )
        length = max(len(one), len(other))
        one, other = (np.pad(angles, (0, length - len(angles))) for angles in (one, other))
        for part in range(1, PARTS + 1):
            angles = one + part / PARTS * (other - one)
            worst = min(worst, peelable.clearance(low // 2, angles, size=size, enough=worst))
        first, before = at, now
    return worst


def main() -> None:
    """Prints the boxes that are asked for."""
    peeling(0.0, tuple(sys.argv[1:]) or BOXES).show(Console(width=160))


if __name__ == "__main__":
    main()
