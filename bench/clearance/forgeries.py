"""Forgeries: count the plans with false statements that a checker wrongly proves.

``python -m bench.clearance.forgeries [COUNT] [--seed SEED] [--node]`` forges plans of small folds
(``tests.planner.verification.forged_plans``): angles, frames, order, sizes, bounds, exempt pairs,
windows, names. A changed motion counts as forged only if the exact distance of two hulls at some
moment is certainly smaller than claimed. With ``--node`` the pages' scripts check the plans,
otherwise ``foldback_check.py`` does.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import nnls

from bench.processes import PROCESSES, each_of
from bench.sections import Section
from bench.shape_files import SHAPES
from foldback import foldback_check
from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.storage.file_names import PLAN
from tests.planner.verification.forged_plans import MOTIONS, forge
from tests.web.node import JavaScriptChecker

SOURCES: Final = {
    "wrench-24": FoldRequest(),
    "tetra-letter-f": FoldRequest(),
    "mallet-24": FoldRequest(strategy="peel"),
    "box-4x4x4": FoldRequest(strategy="blocks"),
}
"""Shapes of the gallery and options of the folds that are forged."""
MIN_VIOLATION_PITCH: Final = 1e-6
"""Minimum difference between the clearance that a forged plan claims and the true distance of its
modules, in pitches, from which on its claim counts as certainly false, so that a checker must
reject it. A smaller value could count rounding errors as violations."""
FORGERIES_PER_TASK: Final = 100
"""Number of forged plans that one task of the process pool makes from one genuine plan and
checks."""


def certainly_false(path: FilePath) -> bool:
    """Return True if two modules of a plan are closer than it claims at some sampled moment."""
    try:
        plan = Plan.load(path)
    except InputError:  # such as windows beyond the chain
        return True
    claim, size = plan.certificate.clearance_bound, plan.certificate.module_size
    computed_sweep = sweep(plan.chain, plan.motion, module_size=size, share=0.0)
    if (
        claim is None
        or computed_sweep.modules is None
        or computed_sweep.clearance >= claim - MIN_VIOLATION_PITCH
    ):
        return False
    if computed_sweep.clearance < -MIN_VIOLATION_PITCH:
        return True
    before = int(computed_sweep.frame)
    after = min(before + 1, len(plan.motion) - 1)
    before_angles, after_angles = (plan.motion.angles_at(plan.chain, k) for k in (before, after))
    angles = before_angles + (computed_sweep.frame - before) * (after_angles - before_angles)
    poses = plan.chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    parts = [
        [
            poses.positions[k] + size * part.corners @ poses.rotations[k].T
            for part in plan.chain.module.piece(k).parts
        ]
        for k in computed_sweep.modules
    ]
    nearest = min(distance(one, other) for one in parts[0] for other in parts[1])
    return nearest < claim - MIN_VIOLATION_PITCH


def distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Compute the distance of two convex hulls by non-negative least squares."""
    weight = 1e4
    constraints = np.vstack([first.T, np.full(len(first), weight), np.zeros(len(first))])
    right = np.vstack([-second.T, np.zeros(len(second)), np.full(len(second), weight)])
    return float(
        nnls(np.hstack([constraints, right]), np.array([0.0, 0.0, 0.0, weight, weight]))[1]
    )


def in_python(path: FilePath) -> dict[str, bool]:
    """Return the result of ``foldback_check.py`` in the form of ``JavaScriptChecker``."""
    try:
        return {"proved": foldback_check.check(path)["verdict"] == "proved"}
    except ValueError:
        return {"proved": False}


def batch(task: tuple[FilePath, int, int, bool]) -> tuple[Counter[str], list[str]]:
    """Forge plans of one source; return the number by kind, and descriptions of those proved."""
    source, seed, count, node = task
    random, kinds, proved = np.random.default_rng(seed), Counter[str](), []
    with (
        tempfile.TemporaryDirectory(prefix="foldback-forged-") as folder,
        JavaScriptChecker() if node else nullcontext(in_python) as check,
    ):
        path = FilePath(folder) / PLAN
        while kinds.total() < count:
            kind = forge(source, path, random)
            if kind in MOTIONS and not certainly_false(path):
                continue
            kinds[kind] += 1
            if check(path)["proved"]:
                proved.append(f"{source.parent.name}, seed {seed}, {kind} {kinds[kind]}")
    return kinds, proved


def forgeries(count: int, seed: int, node: bool, processes: int) -> Section:
    """Forge plans and check them.

    Args:
        count: Number of forged plans, rounded up to a multiple of ``FORGERIES_PER_TASK``.
        seed: Seed of the first task.
        node: True to check with the scripts of pages.
        processes: Number of processes that forge and check.
    """
    section = Section(name="forgeries")
    with tempfile.TemporaryDirectory(prefix="foldback-forgeries-") as folder:
        sources: list[FilePath] = []
        for name, request in SOURCES.items():
            place = FilePath(folder) / name
            place.mkdir()
            Workspace(place).write_request(request, (SHAPES / f"{name}.json").read_bytes())
            run_stages(place)
            sources.append(place / PLAN)
        tasks = [
            (sources[k % len(sources)], seed + k, FORGERIES_PER_TASK, node)
            for k in range(-(-count // FORGERIES_PER_TASK))
        ]
        kinds, proved = Counter[str](), list[str]()
        for forged, wrong in each_of(batch, tasks, processes):
            kinds, proved = kinds + forged, proved + wrong
            print(f"{len(proved)} of {kinds.total()} wrongly proved", flush=True)
    section.rows = [{"kind": kind, "forged": number} for kind, number in kinds.most_common()]
    section.add("forged plans wrongly proved", f"{len(proved)} of {kinds.total()}", "0", not proved)
    for line in proved[:20]:
        section.add("wrongly proved", line)
    return section


def main() -> None:
    """Forge and check plans as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--node", action="store_true", help="check with the scripts of pages")
    parser.add_argument("--processes", type=int, default=PROCESSES)
    forgeries(**vars(parser.parse_args())).show(Console(width=120))


if __name__ == "__main__":
    main()
