"""Scaling: whole commands from 160 to 10 000 modules, each verified at a module size of 0.98.

``python -m bench.scaling [CASE …]`` runs some of them, or longer ones, up to a million modules,
that ``make bench`` omits.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import trimesh
from rich.console import Console

from bench.command import fold
from bench.machine import machine
from bench.sections import Section
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.plan.shape_writers import write_path

SCALING_MODULE_SIZE: Final = 0.98
"""Size of the modules for which all folds of this benchmark must be free of collisions, as a
fraction of the pitch."""
MAX_MEMORY_MIB: Final = 1000.0
"""Target of the benchmark: a command that folds about 10 000 modules takes less memory than this,
in MiB. At or above it the target is reported as not met."""
MAX_TIME_EXPONENT: Final = 1.15
"""Target of the benchmark: the processor time of folding boxes grows at most as the number of
modules to this power; 1 would be linear. A larger fitted exponent is reported as not met."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One command.

    Attributes:
        shape: Name of an example, or of a file.
        data: Function that returns the content of the file; None for an example.
        options: Options of the command.
        bar_s: Maximum wall time, s; None if there is no bar.
    """

    shape: str
    data: Callable[[], bytes] | None = None
    options: tuple[str, ...] = ()
    bar_s: float | None = None


def _box(*sides: int) -> Callable[[], bytes]:
    x, y, z = sides

    def path() -> bytes:
        return write_path(Path.from_cells(layered_snake((x, y, z)), name="box"))

    return path


def stl(mesh: Callable[[], trimesh.Trimesh]) -> Callable[[], bytes]:
    """Return a function that writes a mesh as an STL file."""
    return lambda: bytes(mesh().export(file_type="stl"))


def _ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=4)


def _capsule() -> trimesh.Trimesh:
    return trimesh.creation.capsule(height=2.0, radius=1.0)


def _torus() -> trimesh.Trimesh:
    return trimesh.creation.torus(3.0, 1.2)


def _mesh(shape: Callable[[], trimesh.Trimesh], modules: int, bar_s: float) -> Case:
    return Case(shape="mesh.stl", data=stl(shape), options=("--modules", str(modules)), bar_s=bar_s)


CASES: Final = {
    "wrench-160": Case(shape="wrench-160"),
    "simultaneous-512": Case(
        shape="box.txt", data=_box(8, 8, 8), options=("--strategy", "simultaneous"), bar_s=25.0
    ),
    "ball-1000": _mesh(_ball, 1000, 20.0),
    "capsule-1000": _mesh(_capsule, 1000, 20.0),
    "torus-1000": _mesh(_torus, 1000, 20.0),
    "box-1152": Case(shape="box.txt", data=_box(8, 12, 12)),
    "blocks-1152": Case(shape="box.txt", data=_box(8, 12, 12), options=("--strategy", "blocks")),
    "box-4096": Case(shape="box.txt", data=_box(16, 16, 16), bar_s=60.0),
    "box-9600": Case(shape="box.txt", data=_box(20, 20, 24), bar_s=180.0),
    "ball-10000": _mesh(_ball, 10_000, 180.0),
}
LONGER: Final = {
    "capsule-10000": _mesh(_capsule, 10_000, 180.0),
    "box-2000": Case(shape="box.txt", data=_box(10, 10, 20)),
    "box-20000": Case(shape="box.txt", data=_box(20, 25, 40)),
    "box-100000": Case(shape="box.txt", data=_box(40, 50, 50)),
    "box-500000": Case(shape="box.txt", data=_box(79, 79, 80)),
    "box-1000000": Case(shape="box.txt", data=_box(100, 100, 100)),
}
"""Cases that ``make bench`` omits."""
BOXES: Final = ("box-1152", "box-4096", "box-9600")
"""Cases to which the exponent is fitted."""


def scaling(reference_seconds: float, names: tuple[str, ...] = tuple(CASES)) -> Section:
    """Run the commands of these names."""
    section = Section(name="scaling")
    rows = {name: _run(name, {**CASES, **LONGER}[name], reference_seconds) for name in names}
    section.rows = list(rows.values())
    for name, row in rows.items():
        bar_s = {**CASES, **LONGER}[name].bar_s
        verified = row["verdict"] == "verified"
        section.add(
            f"{name}: {row['modules']} modules at size {SCALING_MODULE_SIZE:g}",
            f"{row['wall s']:.1f} s, {row['processor s']:.1f} s of the processor, "
            f"{row['memory MB']:.0f} MB, {row['verdict']}",
            "verified" if bar_s is None else f"verified within {bar_s:g} s",
            verified and (bar_s is None or row["wall s"] < bar_s),
        )
    if all(name in rows for name in BOXES):
        modules = [rows[name]["modules"] for name in BOXES]
        seconds = [rows[name]["processor s"] for name in BOXES]
        power = float(np.polyfit(np.log(modules), np.log(seconds), 1)[0])
        section.add(
            "processor time of boxes ∝ modules^k",
            f"k = {power:.2f}",
            f"≤ {MAX_TIME_EXPONENT:g}",
            power <= MAX_TIME_EXPONENT,
        )
    if "box-1152" in rows and "blocks-1152" in rows:
        share = rows["blocks-1152"]["frames"] / rows["box-1152"]["frames"]
        section.add("frames, blocks against peeling", f"{share:.2f}", "≤ 1/5", share <= 0.2)
    largest = [row for row in section.rows if 9000 <= row["modules"] <= 11_000]
    if largest:
        max_memory = max(row["memory MB"] for row in largest)
        section.add(
            "memory at 10 000",
            f"{max_memory:.0f} MB",
            f"< {MAX_MEMORY_MIB:g} MB",
            max_memory < MAX_MEMORY_MIB,
        )
    return section


def _run(name: str, case: Case, reference_seconds: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        shape = case.shape
        if case.data is not None:
            file = FilePath(folder) / case.shape
            file.write_bytes(case.data())
            shape = str(file)
        run = fold(shape, "--module-size", str(SCALING_MODULE_SIZE), *case.options)
    summary = run.summary
    return {
        "case": name,
        "modules": summary["modules"],
        "strategy": summary["explosion"]["strategy"],
        "verdict": summary["status"],
        "attempts": summary["attempts"],
        "frames": summary["explosion"]["frames"],
        "clearance": summary["certificate"]["min_clearance"],
        "bound": summary["certificate"]["clearance_bound"],
        "wall s": run.wall_s,
        "processor s": run.processor_s,
        "× reference": run.processor_s / reference_seconds,
        "memory MB": run.peak_mb,
    }


def main() -> None:
    """Print the cases of the command line."""
    reference = machine()["reference_seconds"]
    scaling(reference, tuple(sys.argv[1:]) or tuple(CASES)).show(Console(width=160))


if __name__ == "__main__":
    main()
