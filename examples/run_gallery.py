"""Folds the shapes of the gallery: `python examples/run_gallery.py [NAME …]`.

Writes `results.json`: what came of each with the default preset. Shapes whose files are as they
were when they were folded are left alone, so it may be stopped and started again. A shape that is
not verified with seed 0 is tried with other seeds, and its attempts are counted. The seconds depend
on what else the machine does; those of the processor less so.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any

from planner.pipeline.fold_directory import write_request
from planner.pipeline.request import Request
from planner.pipeline.stages import run_stages
from planner.pipeline.warm_up import warm_up

HERE = FilePath(__file__).parent
SHAPES, RESULTS = HERE / "shapes", HERE / "results.json"
FORMAT = "foldback-results/1"
SEEDS = (0, 1, 2, 3)
PROCESSES = 2


def digest(file: FilePath) -> str:
    """Tells one version of a file from another."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def fold_once(file: FilePath, seed: int) -> dict[str, Any]:
    """Folds a shape and tells what came of it."""
    begun, worked = time.perf_counter(), time.process_time()
    with TemporaryDirectory(prefix="foldback-gallery-") as directory:
        request = Request(filename=file.name, preset="default", seed=seed)
        write_request(FilePath(directory), request, file.read_bytes())
        summary = run_stages(FilePath(directory))
        attempts = len(json.loads((FilePath(directory) / "attempts.json").read_bytes()))
    certificate, playback = summary["certificate"], summary["playback"] or {}
    return {
        "modules": summary["modules"],
        "verdict": certificate["verdict"],
        "seed": seed,
        "steps": summary["explosion"]["steps"] + playback.get("steps", 0),
        "seconds": round(time.perf_counter() - begun, 2),
        "cpu_seconds": round(time.process_time() - worked, 2),
        "clearance": certificate["min_clearance"],
        "attempts": attempts,
    }


def fold_shape(file: FilePath) -> dict[str, Any]:
    """Folds a shape with one seed after the other until it is verified."""
    result: dict[str, Any] = {}
    attempts = 0
    for seed in SEEDS:
        result = fold_once(file, seed)
        attempts += result["attempts"]
        result |= {"attempts": attempts, "digest": digest(file)}
        if result["verdict"].startswith("verified"):
            break
    return result


def known() -> dict[str, dict[str, Any]]:
    """The results that are there, by the shape's name."""
    return json.loads(RESULTS.read_bytes())["shapes"] if RESULTS.exists() else {}


def write(results: dict[str, dict[str, Any]]) -> None:
    """Writes the results, a shape a line."""
    rows = [f"    {json.dumps(name)}: {json.dumps(results[name])}" for name in sorted(results)]
    head = f'{{\n  "format": "{FORMAT}",\n  "preset": "default",\n  "shapes": {{\n'
    aside = RESULTS.with_suffix(".aside")
    aside.write_text(head + ",\n".join(rows) + "\n  }\n}\n", encoding="utf-8")
    aside.replace(RESULTS)


def main(names: list[str]) -> None:
    """Folds the shapes named, or all whose files have changed since."""
    files = {file.stem: file for file in sorted(SHAPES.glob("*.json"))}
    results = {name: result for name, result in known().items() if name in files}
    waiting = [
        file
        for name, file in files.items()
        if (name in names if names else results.get(name, {}).get("digest") != digest(file))
    ]
    waiting.sort(key=lambda file: file.stat().st_size)
    with ProcessPoolExecutor(
        PROCESSES, mp_context=get_context("spawn"), initializer=warm_up
    ) as pool:
        jobs = {pool.submit(fold_shape, file): file.stem for file in waiting}
        for done, job in enumerate(as_completed(jobs), start=1):
            name, result = jobs[job], job.result()
            results[name] = result
            write(results)
            print(
                f"{done}/{len(waiting)} {name}: {result['verdict']}, {result['modules']} modules, "
                f"{result['steps']} steps, {result['cpu_seconds']} s, attempt {result['attempts']}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
