"""Meshes on a table: how many have a path by fitting it, and how many of those fold.

``python -m bench.table.meshes [MESH …]`` folds some of them.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import trimesh
from rich.console import Console

from bench.held_out_meshes import HELD_OUT, ball, rod
from bench.meshes import MESHES, Mesh, box, joined, revolved
from bench.sections import Section
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare_subject
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.shapes.solid import Solid
from foldback.planner.table_paths.rules import rule_violations

FURTHER: Final[dict[str, Callable[[], Mesh]]] = {
    "cone": lambda: trimesh.creation.cone(2.0, 5.0),
    "capsule": lambda: trimesh.creation.capsule(4.0, 1.2),
    "annulus": lambda: trimesh.creation.annulus(1.5, 3.0, 1.2),
    "desk": lambda: joined(
        box((8, 5, 1), (0, 0, 4)), *(box((1, 1, 4), (x, y, 2)) for x in (-3, 3) for y in (-2, 2))
    ),
    "arch": lambda: joined(
        box((7, 2, 2), (0, 0, 5)), *(box((2, 2, 5), (x, 0, 2)) for x in (-3, 3))
    ),
    "cross": lambda: joined(box((9, 2, 2), (0, 0, 0)), box((2, 9, 2), (0, 0, 0))),
    "dumbbell": lambda: joined(
        ball(1.6, (-3, 0, 0)), ball(1.6, (3, 0, 0)), rod((-3, 0, 0), (3, 0, 0), 0.7)
    ),
    "hourglass": lambda: revolved([(0.0, -3.0), (2.0, -3.0), (0.7, 0.0), (2.0, 3.0), (0.0, 3.0)]),
    "stairs": lambda: joined(*(box((2, 4, 2 * k), (2 * k, 0, k)) for k in (1, 2, 3, 4))),
    "snowman": lambda: joined(ball(2.2, (0, 0, 0)), ball(1.6, (0, 0, 3)), ball(1.1, (0, 0, 5))),
}
"""Ten meshes besides those of the other benchmarks."""
FORMS: Final = {**MESHES, **HELD_OUT, **FURTHER}
MIN_WITH_PATH: Final = {32: 20, 64: 25, 96: 27}
"""Smallest number of the meshes that shall have a path, for each number of modules."""
FOLDED: Final = tuple(FORMS)[::3]
"""Meshes that are folded: every third one."""
FOLDED_MODULES: Final = 32


def table_meshes(reference_seconds: float) -> Section:
    """Count the meshes with a path for a table; fold ten of them."""
    section = Section(name="table-meshes")
    for modules, min_modules in MIN_WITH_PATH.items():
        rows = [_path_row(name, modules) for name in FORMS]
        section.rows += rows
        count = sum(row["path"] != "" for row in rows)
        section.add(
            f"meshes with a path for a table at {modules}",
            f"{count} of {len(rows)}",
            f"≥ {min_modules}",
            count >= min_modules,
        )
        seconds = float(np.median([row["cpu s"] for row in rows]))
        section.add(
            f"preparation at {modules}, median",
            f"{seconds:.1f} s ({seconds / reference_seconds:.1f} × reference)",
        )
    _fold(section, FOLDED)
    return section


def _fold(section: Section, names: tuple[str, ...]) -> None:
    rows: list[dict[str, Any]] = []
    for name in names:
        rows.append(_fold_row(name))
        print(rows[-1], file=sys.stderr, flush=True)
    section.rows += rows
    verified = sum(row["verified"] for row in rows)
    section.add(
        f"folded and verified on a table at {FOLDED_MODULES}, of those with a path",
        f"{verified} of {len(rows)}",
        "≥ half",
        2 * verified >= len(rows),
    )


def _path_row(name: str, modules: int) -> dict[str, Any]:
    mesh = FORMS[name]()
    solid = Solid.from_triangles(mesh.vertices, mesh.faces, name=name)
    cpu = time.process_time()
    preparation = prepare_subject(solid, PathOptions(modules=modules, world="table"))
    cpu = time.process_time() - cpu
    if preparation.method == "fitted" and rule_violations(preparation.cells):
        raise AssertionError(f"the path of {name} breaks rules")
    return {
        "mesh": name,
        "asked": modules,
        "path": preparation.method if preparation.chains else "",
        "modules": len(preparation.cells),
        "iou": None if preparation.likeness is None else preparation.likeness.iou,
        "cpu s": cpu,
    }


def _fold_row(name: str) -> dict[str, Any]:
    data = FORMS[name]().export(file_type="stl")
    assert isinstance(data, bytes)
    request = FoldRequest(filename=f"{name}.stl", modules=FOLDED_MODULES, world="table")
    cpu = time.process_time()
    try:
        with TemporaryDirectory() as directory:
            Workspace(Path(directory)).write_request(request, data)
            run_stages(Path(directory))
            plan = Plan.load(Path(directory) / "plan.npz")
        verified, verdict = plan.certificate.verified, plan.certificate.verdict
    except InputError as error:
        verified, verdict = False, f"failed: {error.detail}"
    return {
        "mesh": name,
        "asked": FOLDED_MODULES,
        "verified": verified,
        "verdict": verdict,
        "cpu s": time.process_time() - cpu,
    }


def main() -> None:
    """Fold the meshes of the command line."""
    section = Section(name="table-meshes")
    _fold(section, tuple(sys.argv[1:]) or FOLDED)
    section.show(Console(width=200))


if __name__ == "__main__":
    main()
