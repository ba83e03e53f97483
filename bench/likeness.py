"""Likeness: how much chains look like thirty meshes, at what cost, and whether they fold."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.command import fold
from bench.held_out_meshes import HELD_OUT
from bench.meshes import MESHES, Mesh
from bench.processes import each_of
from bench.sections import Section
from bench.thin_meshes import THIN, WALLS
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.errors import InputError
from foldback.planner.path_fit.fill_fitted import fill_fitted
from foldback.planner.path_fit.fill_trail import fill_with_trail
from foldback.planner.path_fit.fit import fit_path
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare_subject
from foldback.planner.shapes.lattice_fits import Ladder
from foldback.planner.shapes.orientations import candidates
from foldback.planner.shapes.solid import Solid

FORMS: Final[dict[str, Callable[[], Mesh]]] = {**MESHES, **HELD_OUT, **THIN}
"""Thirty meshes by their names."""
MORE_MODULES: Final = ("mug", "bowl", "chair", "trefoil", "rabbit", *tuple(THIN)[:5])
"""Ten meshes that are measured with more modules, too."""
FOLDED: Final = ("mug", "chair", "bowl", "spring", "rings", "teapot")
"""Meshes whose chains the section ``likeness`` folds; ``likeness-folds`` folds all."""
MODULES: Final = 160
BARS: Final = {160: (0.73, 1.2), 500: (0.77, 4.0)}
"""Targets for each number of modules: mean IoU, and processor time of a fit, s."""
PREVIEW_BARS: Final = {"first": 0.5, "final": 2.0}
"""Targets for the processor time of the first preview of a mesh, and of the final one after it."""
MIN_THIN_IOU: Final = 0.55
"""Target for the IoU of the worst mesh with thin parts."""
MAX_PATH_LOSS: Final = 0.02
"""Target for the mean IoU that a path costs against the best cells of its placement."""
EXACT_MODULES: Final = 200
"""Number of modules that is met exactly with the method ``exact``."""
MIN_EXACT: Final = 0.9
"""Target for the share of meshes with a path of exactly that many."""
MAX_MISSING: Final = 0.1
"""Target for the share of walls much thinner than a module that no module covers."""
MIN_TETRAHEDRA_GAIN: Final = 0.1
"""Target for the mean IoU that fitted tetrahedra gain over rings of twelve in voxels."""
MIN_VERIFIED: Final = 28 / 30
"""Target for the share of chains that are verified at the first attempt."""


def likeness(reference_seconds: float) -> Section:
    """Compare fitted chains with blocks and with the best cells, and fold a few."""
    section = Section(name="likeness")
    fill_fitted(_solid("torus"), PathOptions(modules=32), seed=0)  # import all libraries first
    for modules, names in ((MODULES, tuple(FORMS)), (500, MORE_MODULES)):
        rows = [_row(name, modules, reference_seconds) for name in names]
        section.rows += rows
        _figures(section, modules, rows)
    exact_names = [name for name in MORE_MODULES if _meets_exactly(name)]
    section.add(
        f"paths of exactly {EXACT_MODULES} modules",
        f"{len(exact_names)} of {len(MORE_MODULES)}",
        f"≥ {MIN_EXACT:.0%}",
        len(exact_names) >= MIN_EXACT * len(MORE_MODULES),
    )
    rows = [_wall_row(name) for name in WALLS]
    section.rows += rows
    missing = float(np.mean([row["missing"] for row in rows]))
    section.add(
        f"share of thin walls without a module, mean of {len(rows)} meshes, {MODULES} modules",
        f"{missing:.2f}",
        f"≤ {MAX_MISSING}",
        missing <= MAX_MISSING,
    )
    return _with_folds(section, FOLDED)


def _wall_row(name: str) -> dict[str, Any]:
    mesh = WALLS[name]()
    solid = Solid.from_triangles(mesh.vertices, mesh.faces, name=name)
    preparation = prepare_subject(solid, PathOptions(modules=MODULES))
    assert preparation.likeness is not None
    return {
        "mesh": name,
        "asked": MODULES,
        "modules": len(preparation.cells),
        "method": preparation.method,
        "iou": preparation.likeness.iou,
        "missing": preparation.likeness.missing,
    }


def _meets_exactly(name: str) -> bool:
    """Return True if a mesh has a path of exactly ``EXACT_MODULES`` modules."""
    options = PathOptions(modules=EXACT_MODULES, method="exact")
    try:
        return len(prepare_subject(_solid(name), options).chain) == EXACT_MODULES
    except InputError:
        return False


def likeness_folds(reference_seconds: float) -> Section:
    """Fold chains of 160 modules for all thirty meshes."""
    del reference_seconds
    return _with_folds(Section(name="likeness-folds"), tuple(FORMS))


def likeness_tetrahedra(reference_seconds: float) -> Section:
    """Compare fitted tetrahedra with rings of twelve in the voxels of ten meshes."""
    section = Section(name="likeness-tetrahedra")
    fill_with_trail(_solid("torus"), PathOptions(modules=32, module=TETRAHEDRON.name), seed=0)
    for name in MORE_MODULES:
        row: dict[str, Any] = {"mesh": name}
        for method in ("fitted", "blocks"):
            options = PathOptions(modules=MODULES, module=TETRAHEDRON.name, method=method)
            start_s = time.process_time()
            preparation = prepare_subject(_solid(name), options)
            seconds = time.process_time() - start_s
            assert preparation.likeness is not None
            row |= {
                f"iou, {preparation.method}": preparation.likeness.iou,
                f"{preparation.method} s": seconds,
            }
        section.rows.append({**row, "ratio": row["fitted s"] / reference_seconds})
    fitted, rings, seconds = (
        float(np.mean([row[name] for row in section.rows]))
        for name in ("iou, fitted", "iou, rings", "fitted s")
    )
    label = f"{len(section.rows)} meshes, {MODULES} tetrahedra"
    bar = f"≥ {rings + MIN_TETRAHEDRA_GAIN:.3f}"
    is_met = fitted >= rings + MIN_TETRAHEDRA_GAIN
    section.add(f"IoU, mean of {label}", f"{fitted:.3f}; rings {rings:.3f}", bar, is_met)
    section.add(f"processor time of the preparation, mean of {label}", f"{seconds:.2f} s")
    return section


def previews(reference_seconds: float) -> Section:
    """Time the first and the final preview of ten meshes, as the service computes them."""
    section = Section(name="previews")
    _preview_s(_solid("torus"), quick=False)  # import all libraries first
    for name in MORE_MODULES:
        solid = _solid(name)
        first, final = _preview_s(solid, quick=True), _preview_s(solid, quick=False)
        row = {"mesh": name, "first s": first, "final s": final}
        section.rows.append({**row, "ratio": (first + final) / reference_seconds})
    for label, most_s in PREVIEW_BARS.items():
        seconds = [row[f"{label} s"] for row in section.rows]
        figure = f"processor time of the {label} preview, {MODULES} modules"
        section.add(f"{figure}, mean of {len(seconds)}", f"{np.mean(seconds):.2f} s")
        longest = max(seconds)
        within = longest <= most_s
        section.add(f"{figure}, longest", f"{longest:.2f} s", f"≤ {most_s} s", within)
    return section


def _preview_s(solid: Solid, *, quick: bool) -> float:
    """Return the processor time of a preview, in seconds; a final one goes on from a first one."""
    start_s = time.process_time()
    prepare_subject(solid, PathOptions(modules=MODULES), offering=True, quick=quick).report()
    return time.process_time() - start_s


def _solid(name: str) -> Solid:
    mesh = FORMS[name]()
    return Solid.from_triangles(mesh.vertices, mesh.faces, name=name)


def _row(name: str, modules: int, reference_seconds: float) -> dict[str, Any]:
    solid = _solid(name)
    own_iou, blocks = (
        prepare_subject(solid, PathOptions(modules=modules, method=method))
        for method in ("auto", "blocks")
    )
    start_s = time.process_time()
    ladder = Ladder(solid, candidates(solid, np.random.default_rng(0)))
    *_, fit = fit_path(ladder, modules)
    seconds = time.process_time() - start_s
    assert own_iou.likeness is not None and blocks.likeness is not None
    best = max(fit.paths, key=lambda path: path.iou)
    return {
        "mesh": name,
        "asked": modules,
        "modules": len(own_iou.cells),
        "method": own_iou.method,
        "iou": own_iou.likeness.iou,
        "iou of blocks": blocks.likeness.iou,
        "best cells": best.placement.bound,
        "path loss": best.placement.bound - best.iou,
        "fit s": seconds,
        "ratio": seconds / reference_seconds,
    }


def _figures(section: Section, modules: int, rows: list[dict[str, Any]]) -> None:
    def mean(name: str) -> float:
        return float(np.mean([row[name] for row in rows]))

    min_iou, most_s = BARS[modules]
    label = f"{len(rows)} meshes, {modules} modules"
    iou, seconds, loss = mean("iou"), mean("fit s"), mean("path loss")
    thin = [row for row in rows if row["mesh"] in (*THIN, "mug", "chair")]
    worst = min(thin, key=lambda row: row["iou"])
    section.add(f"IoU, mean of {label}", f"{iou:.3f}", f"≥ {min_iou}", iou >= min_iou)
    section.add(f"IoU of blocks, {label}", f"{mean('iou of blocks'):.3f}")
    section.add(
        f"IoU that the path costs, {label}",
        f"{loss:.3f}",
        f"≤ {MAX_PATH_LOSS}",
        loss <= MAX_PATH_LOSS,
    )
    section.add(
        f"IoU of the worst thin mesh ({worst['mesh']}), {modules} modules",
        f"{worst['iou']:.3f}",
        f"≥ {MIN_THIN_IOU}",
        worst["iou"] >= MIN_THIN_IOU,
    )
    section.add(
        f"processor time of the fit, mean of {label}",
        f"{seconds:.2f} s",
        f"≤ {most_s} s",
        seconds <= most_s,
    )


def _with_folds(section: Section, names: Sequence[str]) -> Section:
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as directory:
        first = list(each_of(partial(_folds_at_once, directory), names))
    failed = [name for name, verified in zip(names, first, strict=True) if not verified]
    section.add(
        f"verified at the first attempt, {MODULES} modules",
        f"{sum(first)} of {len(first)}" + (f"; not: {', '.join(failed)}" if failed else ""),
        f"≥ {MIN_VERIFIED:.0%}",
        sum(first) >= MIN_VERIFIED * len(first),
    )
    return section


def _folds_at_once(directory: str, name: str) -> bool:
    """Return True if the first attempt at folding a mesh is verified."""
    file = Path(directory) / f"{name}.stl"
    FORMS[name]().export(file, file_type="stl")
    run = fold(str(file), "--modules", str(MODULES), "--workers", "1")
    return run.code == 0 and run.summary["attempts"] == 1
