"""Smoothing: how motions of examples go before and after, at the same clearance.

``python -m tests.benchmarks.smoothing [SHAPE …]`` prints them.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from rich.console import Console

from examples.run_gallery import SHAPES
from planner.explosion import explode
from planner.parameters import ExplosionParameters
from planner.preparation import prepare
from planner.request import Request
from planner.smoothing import smooth
from planner.sweep import sweep
from tests.benchmarks.tables import Section

NAMES = (
    "wrench-24",
    "mallet-64",
    "wrench-94",
    "wrench-160",
    "mallet-192",
    "crown",
    "pot",
    "elephant",
    "tetra-wrench",
    "tetra-slab",
)
SIZE, TIGHT = 0.95, 0.98
RATIOS = ("length_rad", "travel_rad", "largest_way", "fold_time_s", "peak_torque")


def smoothing(reference_seconds: float, shapes: tuple[str, ...] = NAMES) -> Section:
    """Records of examples of 24 to 384 modules, smoothed."""
    del reference_seconds
    section = Section(name="smoothing")
    _row("wrench-24")  # compiles
    for shape in shapes:
        section.rows.append(_row(shape))
    rows = section.rows
    for name in RATIOS:
        ratios = [row[name][1] / row[name][0] for row in rows]
        section.add(f"{name}, after / before", f"{np.exp(np.mean(np.log(ratios))):.2f} (geometric)")
    worst = max((row["cpu s"] for row in rows if row["modules"] == 160), default=0.0)
    section.add("160 modules", f"{worst:.1f} s of the processor", "≤ 2 s", worst <= 2.0)
    kept = sum(row[f"clear {TIGHT}"][1] >= row[f"clear {TIGHT}"][0] - 1e-6 for row in rows)
    proved = sum(row["proved"] for row in rows)
    section.add(
        f"as clear as before at {TIGHT}", f"{kept} of {len(rows)}", "all", kept == len(rows)
    )
    section.add(f"proved clear at {SIZE}", f"{proved} of {len(rows)}", "all", proved == len(rows))
    for row in rows:
        for name, value in row.items():
            if isinstance(value, tuple):
                row[name] = " → ".join(f"{v:.4g}" for v in value)
    return section


def _row(shape: str) -> dict[str, Any]:
    data = (SHAPES / f"{shape}.json").read_bytes()
    chain = prepare(data, None, Request().wishes(), seed=0).chain
    record = explode(chain, ExplosionParameters())
    angles = np.ascontiguousarray(record.frames.dense(chain).joint_angles_rad[::-1])
    cpu = time.process_time()
    found = smooth(chain, angles, size=SIZE)
    cpu = time.process_time() - cpu
    before, after = found.before.as_dict(), found.after.as_dict()
    clear = {
        size: [sweep(chain, motion, size=size) for motion in (angles, found.angles)]
        for size in (SIZE, TIGHT)
    }
    return {
        "shape": shape,
        "modules": len(chain),
        "cpu s": cpu,
        **{name: (before[name], after[name]) for name in before},
        **{f"clear {size}": (a.clearance, b.clearance) for size, (a, b) in clear.items()},
        "proved": clear[SIZE][1].bound > 0.0,
    }


def main() -> None:
    """Prints the shapes that are asked for."""
    smoothing(0.0, tuple(sys.argv[1:]) or NAMES).show(Console(width=200))


if __name__ == "__main__":
    main()
