"""The gallery, folded with the default preset: how many are verified at once, how fast."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from examples.run_gallery import PROCESSES, SHAPES, fold_shape
from planner.pipeline.warm_up import warm_up
from tests.benchmarks.tables import Section

AT_ONCE = 0.98


def gallery(reference_seconds: float) -> Section:
    """Every shape; those that are not verified with the first seed are tried with others."""
    del reference_seconds
    section = Section(name="gallery")
    files = sorted(SHAPES.glob("*.json"))
    with ProcessPoolExecutor(
        PROCESSES, mp_context=get_context("spawn"), initializer=warm_up
    ) as pool:
        results = list(pool.map(fold_shape, files))
    section.rows = [
        {
            "shape": file.stem,
            "modules": result["modules"],
            "verdict": result["verdict"],
            "attempts": result["attempts"],
            "steps": result["steps"],
            "clearance": result["clearance"],
            "wall s": result["seconds"],
        }
        for file, result in zip(files, results, strict=True)
    ]
    verified = [result for result in results if result["verdict"].startswith("verified")]
    at_once = sum(result["attempts"] == 1 for result in verified)
    walls = sorted(result["seconds"] for result in results)
    share = at_once / len(files)
    section.add(
        "verified at once",
        f"{at_once} of {len(files)} ({100 * share:.1f} %)",
        f"at least {100 * AT_ONCE:.0f} %",
        share >= AT_ONCE,
    )
    section.add(
        "verified with retries",
        f"{len(verified)} of {len(files)}",
        "all",
        len(verified) == len(files),
    )
    section.add("median wall", f"{walls[len(walls) // 2]:.1f} s", "reported")
    section.add("longest wall", f"{walls[-1]:.1f} s", "reported")
    return section
