"""Forgeries: plans that state something false, and how many of them a checker proves.

``python -m bench.clearance.forgeries [COUNT] [--seed SEED]`` forges plans of small folds: angles,
frames, order, sizes, bounds, exempt pairs, windows, names. A changed motion counts as forged only
if two modules are certainly nearer than claimed: by the exact distance of their hulls at a moment.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import nnls

import foldback_check
from bench.tables import Section
from examples.run_gallery import PROCESSES, SHAPES
from planner.clearance.sweep import sweep
from planner.file_names import PLAN
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.warm_up import warm_up
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan

Random = np.random.Generator
Arrays = dict[str, NDArray[Any]]
Told = dict[str, Any]
SOURCES: Final = {
    "wrench-24": FoldRequest(),
    "tetra-letter-f": FoldRequest(),
    "mallet-24": FoldRequest(strategy="peel"),
    "box-4x4x4": FoldRequest(strategy="blocks"),
}
SURE: Final = 1e-6
"""Pitches by which modules are nearer than claimed in a motion that counts as forged."""
BATCH: Final = 100


def bent(random: Random, arrays: Arrays, told: Told) -> None:
    """Some hinges are off for a while, most at its middle."""
    name = "angles_rad" if "angles_rad" in arrays else "joint_angles_rad"
    q = arrays[name]
    if q.ndim == 1:
        where = random.integers(0, len(q), 8)
        q[where] += random.uniform(-1.0, 1.0, len(where)).astype(q.dtype)
        return
    start = int(random.integers(1, max(2, len(q) - 12)))
    stop = min(len(q) - 1, start + int(random.integers(2, 40)))
    hinges = random.integers(0, q.shape[1], int(random.integers(1, 5)))
    shape = np.sin(np.linspace(0.0, np.pi, stop - start))[:, None]
    q[start:stop, hinges] += shape * random.uniform(-1.5, 1.5, len(hinges))


def fewer(random: Random, arrays: Arrays, told: Told) -> None:
    """Frames are left out, so that what lies between the others is another motion."""
    if "first" in arrays:
        return bent(random, arrays, told)
    frames = len(arrays["time_s"])
    kept = np.sort(random.choice(frames - 2, int(random.integers(1, 8)), replace=False)) + 1
    kept = np.concatenate([[0], kept, [frames - 1]])
    for name, array in arrays.items():
        if array.shape[:1] == (frames,):
            arrays[name] = array[kept]
    told["certificate"] |= {"frames": len(kept), "max_joint_step_rad": 9.0}


def mixed(random: Random, arrays: Arrays, told: Told) -> None:
    """Two frames change places."""
    if "first" in arrays:
        return bent(random, arrays, told)
    q = arrays["joint_angles_rad"]
    one, other = random.choice(len(q) - 2, 2, replace=False) + 1
    q[[one, other]] = q[[other, one]]
    told["certificate"]["max_joint_step_rad"] = 9.0


def claimed(random: Random, arrays: Arrays, told: Told) -> None:
    """More clearance is claimed."""
    told["certificate"]["clearance_bound"] *= float(random.uniform(1.0, 3.0))


def grown(random: Random, arrays: Arrays, told: Told) -> None:
    """Modules are larger."""
    size = told["certificate"]["module_size"]
    told["certificate"]["module_size"] = float(random.uniform(size, 1.0))


def structural(random: Random, arrays: Arrays, told: Told) -> str:
    """Change one thing that makes a plan false, whatever its motion; return its name."""
    certificate, hinges = told["certificate"], len(arrays["joint_names"])
    module = told["claim"]["module"]
    k = int(random.integers(0, hinges))

    def windows() -> None:
        if "first" in arrays:
            arrays["first"] = arrays["first"] + int(random.choice([-hinges, hinges]))
        else:
            arrays["joint_angles_rad"] = arrays["joint_angles_rad"][:, :-1]

    changes: dict[str, Callable[[], Any]] = {
        "apart": lambda: certificate["exempt_pairs"].update(apart=int(random.integers(3, 99))),
        "count": lambda: certificate["exempt_pairs"].update(count=int(random.integers(999, 9999))),
        "module size": lambda: certificate.update(module_size=float(random.uniform(1.01, 2))),
        "no size": lambda: certificate.update(module_size=float(random.uniform(-1, 0))),
        "bound": lambda: certificate.update(clearance_bound=float(random.choice([0.0, -1.0, 1e9]))),
        "verdict": lambda: certificate.update(verdict="failed: overlap"),
        "frames": lambda: certificate.update(frames=int(random.integers(1, 9))),
        "corners": lambda: module["corners"][0].__setitem__(0, float(random.uniform(-0.4, 0.4))),
        "turns": lambda: module["turns"][0][0].__setitem__(1, float(random.uniform(0.1, 1.0))),
        "limit": lambda: module.update(limit_rad=float(random.uniform(2.0, 3.0))),
        "module apart": lambda: module.update(apart=int(random.integers(3, 9))),
        "kind": lambda: told["chain"].update(
            module="tetrahedron" if told["chain"]["module"] == "cube" else "cube"
        ),
        "modules": lambda: told["chain"].update(modules=int(told["chain"]["modules"] + 1)),
        "folded": lambda: told["chain"]["folded_rad"].__setitem__(k, float(random.uniform(3, 4))),
        "names": lambda: arrays.update(joint_names=np.roll(arrays["joint_names"], 1 + k % 7)),
        "start": lambda: told.update(start={"folded_rad": [float(random.uniform(1, 2))] * hinges}),
        "times": lambda: arrays["time_s"].__setitem__(len(arrays["time_s"]) // 2, -1.0),
        "digest": lambda: told["claim"].update(angles_sha256=random.bytes(32).hex()),
        "windows": windows,
    }
    name = str(random.choice(list(changes)))
    changes[name]()
    return name


MOTIONS: Final = (bent, fewer, mixed, claimed, grown)


def certainly_false(path: FilePath) -> bool:
    """Return True if two modules of a plan are nearer than it claims, at some sampled moment."""
    plan = Plan.load(path)
    claim, size = plan.certificate.clearance_bound, plan.certificate.module_size
    found = sweep(plan.chain, plan.motion, size=size, share=0.0)
    if claim is None or found.modules is None or found.clearance >= claim - SURE:
        return False
    if found.clearance < -SURE:
        return True
    before = int(found.frame)
    after = min(before + 1, len(plan.motion) - 1)
    one, other = (plan.motion.angles_at(plan.chain, k) for k in (before, after))
    angles = one + (found.frame - before) * (other - one)
    poses = plan.chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    corners = plan.chain.module.vertices * size
    hulls = [poses.positions[k] + corners @ poses.rotations[k].T for k in found.modules]
    return distance(*hulls) < claim - SURE


def distance(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the distance of two convex hulls, whose points are combinations of their corners."""
    weight = 1e4
    left = np.vstack([one.T, np.full(len(one), weight), np.zeros(len(one))])
    right = np.vstack([-other.T, np.zeros(len(other)), np.full(len(other), weight)])
    return float(nnls(np.hstack([left, right]), np.array([0.0, 0.0, 0.0, weight, weight]))[1])


def forged(source: FilePath, path: FilePath, random: Random) -> str | None:
    """Write a forged plan and return its kind; None if it may be true after all."""
    with np.load(source) as file:
        arrays = {name: array.copy() for name, array in file.items()}
    told = json.loads(str(arrays.pop("plan")))
    if random.random() < 0.3:
        kind = structural(random, arrays, told)
        if kind != "digest":
            del told["claim"]["angles_sha256"]
    else:
        change = MOTIONS[int(random.integers(len(MOTIONS)))]
        change(random, arrays, told)
        kind = change.__name__
        del told["claim"]["angles_sha256"]  # a forger knows how to work it out
    np.savez(path, plan=np.array(json.dumps(told)), **arrays)
    return kind if change_is_sure(kind, path) else None


def change_is_sure(kind: str, path: FilePath) -> bool:
    """Return True if a plan with this kind of change is certainly false."""
    return kind not in {change.__name__ for change in MOTIONS} or certainly_false(path)


def batch(task: tuple[FilePath, int, int]) -> tuple[Counter[str], list[str]]:
    """Forge plans of one source; return their kinds, and the descriptions of those proved."""
    source, seed, count = task
    random, kinds, proved = np.random.default_rng(seed), Counter[str](), []
    with tempfile.TemporaryDirectory(prefix="foldback-forged-") as folder:
        path = FilePath(folder) / PLAN
        while kinds.total() < count:
            kind = forged(source, path, random)
            if kind is None:
                continue
            kinds[kind] += 1
            try:
                verdict = foldback_check.check(path)["verdict"]
            except ValueError:
                verdict = "no plan"
            if verdict == "proved":
                proved.append(f"{source.parent.name}, seed {seed}, {kind} {kinds[kind]}")
    return kinds, proved


def forgeries(count: int, seed: int = 0) -> Section:
    """Forge so many plans and check them."""
    warm_up()
    section = Section(name="forgeries")
    with tempfile.TemporaryDirectory(prefix="foldback-forgeries-") as folder:
        sources: list[FilePath] = []
        for name, request in SOURCES.items():
            place = FilePath(folder) / name
            place.mkdir()
            Workspace(place).write_request(request, (SHAPES / f"{name}.json").read_bytes())
            run_stages(place)
            sources.append(place / PLAN)
        tasks = [(sources[k % len(sources)], seed + k, BATCH) for k in range(-(-count // BATCH))]
        with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(batch, tasks))
    kinds = sum((each[0] for each in found), Counter[str]())
    proved = [line for each in found for line in each[1]]
    section.rows = [{"kind": kind, "forged": number} for kind, number in kinds.most_common()]
    section.add("forged plans wrongly proved", f"{len(proved)} of {kinds.total()}", "0", not proved)
    for line in proved[:20]:
        section.add("wrongly proved", line)
    return section


def main() -> None:
    """Forge and check plans as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    forgeries(options.count, options.seed).show(Console(width=120))


if __name__ == "__main__":
    main()
