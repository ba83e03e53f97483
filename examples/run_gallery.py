"""Fold the shapes of the gallery: `python -m examples.run_gallery [--world table] [NAME …]`.

Writes the result of each shape with the default preset to `results.json`. On a table it folds
shapes of up to 64 modules and writes `table_results.json`, with the torque that resting there needs
or the reason why there is no path. Shapes whose files have not changed since they were folded are
skipped, so the script may be stopped and started again; `--again` folds them, too. A shape that is
not verified with seed 0 is tried with other seeds, and its attempts are counted. Wall times depend
on the load of the machine; processor times depend on it less.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any

from foldback.planner.errors import InputError
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.storage.file_names import ATTEMPTS

HERE = FilePath(__file__).parent
SHAPES, RESULTS, TABLE_RESULTS = (
    HERE / name for name in ("shapes", "results.json", "table_results.json")
)
LARGEST_ON_TABLE = 64
FORMAT = "foldback-results/1"
NO_PATH = "no path"
SEEDS = (0, 1, 2, 3)
PROCESSES = 2


def digest(file: FilePath) -> str:
    """Return the digest that identifies the version of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def fold_once(file: FilePath, seed: int) -> dict[str, Any]:
    """Fold a shape and return its result."""
    start, worked = time.perf_counter(), time.process_time()
    with TemporaryDirectory(prefix="foldback-gallery-") as directory:
        request = FoldRequest(filename=file.name, preset="default", seed=seed)
        Workspace(FilePath(directory)).write_request(request, file.read_bytes())
        summary = run_stages(FilePath(directory))
        attempts = len(json.loads((FilePath(directory) / ATTEMPTS).read_bytes()))
    certificate, playback = summary["certificate"], summary["playback"] or {}
    return {
        "modules": summary["modules"],
        "verified": certificate["verified"],
        "verdict": certificate["verdict"],
        "seed": seed,
        "steps": summary["explosion"]["steps"] + playback.get("steps", 0),
        "seconds": round(time.perf_counter() - start, 2),
        "cpu_seconds": round(time.process_time() - worked, 2),
        "clearance": certificate["min_clearance"],
        "attempts": attempts,
    }


def fold_once_on_table(file: FilePath, seed: int) -> dict[str, Any]:
    """Fold a shape on a table, by any path through its cells, and return its result."""
    start = time.perf_counter()
    with TemporaryDirectory(prefix="foldback-gallery-") as directory:
        request = FoldRequest(filename=file.name, seed=seed, world="table", as_voxels=True)
        Workspace(FilePath(directory)).write_request(request, file.read_bytes())
        try:
            summary = run_stages(FilePath(directory))
        except InputError as error:
            return {
                "verified": False,
                "verdict": NO_PATH,
                "seed": seed,
                "reason": error.detail,
                "attempts": 0,
            }
        attempts = len(json.loads((FilePath(directory) / ATTEMPTS).read_bytes()))
    certificate = summary["certificate"]
    table = certificate.get("table") or {}
    return {
        "modules": summary["modules"],
        "verified": certificate["verified"],
        "verdict": certificate["verdict"],
        "seed": seed,
        "torque_wp": table.get("torque"),
        "torque_nm": table.get("torque_nm"),
        "friction": table.get("friction"),
        "seconds": round(time.perf_counter() - start, 2),
        "clearance": certificate["min_clearance"],
        "attempts": attempts,
    }


def fold_shape(file: FilePath, world: str = "floating") -> dict[str, Any]:
    """Fold a shape with one seed after the other until it is verified, or has no path."""
    result: dict[str, Any] = {}
    attempts = 0
    for seed in SEEDS:
        result = (fold_once if world == "floating" else fold_once_on_table)(file, seed)
        attempts += result["attempts"]
        result |= {"attempts": attempts, "digest": digest(file)}
        if result["verified"] or result["verdict"] == NO_PATH:
            break
    return result


def results_in(world: str) -> FilePath:
    """Return the path of the results for a world."""
    return RESULTS if world == "floating" else TABLE_RESULTS


def known(world: str = "floating") -> dict[str, dict[str, Any]]:
    """Return the stored results by the shape's name."""
    path = results_in(world)
    return json.loads(path.read_bytes())["shapes"] if path.exists() else {}


def suited(file: FilePath, world: str) -> bool:
    """Return True if a shape can be folded in a world."""
    if world == "floating":
        return True
    content = json.loads(file.read_bytes())
    return len(content.get("cells", ())) in range(1, LARGEST_ON_TABLE + 1)


def write(results: dict[str, dict[str, Any]], world: str = "floating") -> None:
    """Write the results, one shape per line."""
    path = results_in(world)
    rows = [f"    {json.dumps(name)}: {json.dumps(results[name])}" for name in sorted(results)]
    head = f'{{\n  "format": "{FORMAT}",\n  "preset": "default",\n  "shapes": {{\n'
    partial_path = path.with_suffix(".aside")
    partial_path.write_text(head + ",\n".join(rows) + "\n  }\n}\n", encoding="utf-8")
    partial_path.replace(path)


def main(names: list[str], world: str, *, repeats: bool) -> None:
    """Fold the named shapes, or all; without ``repeats``, those whose files have changed."""
    files = {file.stem: file for file in sorted(SHAPES.glob("*.json")) if suited(file, world)}
    results = {name: result for name, result in known(world).items() if name in files}
    waiting = [
        file
        for name, file in files.items()
        if (
            name in names
            if names
            else repeats or results.get(name, {}).get("digest") != digest(file)
        )
    ]
    waiting.sort(key=lambda file: file.stat().st_size)
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(fold_shape, file, world): file.stem for file in waiting}
        for done, job in enumerate(as_completed(jobs), start=1):
            name, result = jobs[job], job.result()
            results[name] = result
            write(results, world)
            counts = ", ".join(
                f"{k} {v}" for k, v in result.items() if k not in ("digest", "verdict")
            )
            print(f"{done}/{len(waiting)} {name}: {result['verdict']}, {counts}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", choices=("floating", "table"), default="floating")
    parser.add_argument("--again", action="store_true", help="fold unchanged shapes, too")
    parser.add_argument("names", nargs="*", metavar="NAME")
    options = parser.parse_args()
    main(options.names, options.world, repeats=options.again)
