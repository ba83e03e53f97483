"""The published algorithm on random paths of 160 modules, and on five shapes of the paper.

``python -m bench.success_map.published`` runs the cases that are missing in
``out/published-….jsonl``, a file for each version of the planner. It can be stopped at any time and
continues where it stopped.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.sections import Section
from bench.success_map.stored import run_missing, version_of
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.pathfinding.block_merging import block_path
from foldback.planner.pathfinding.lattice import STEPS
from foldback.planner.pipeline.fold import fold
from foldback.planner.readers import read

ROOT: Final = Path(__file__).parents[2]
SHAPES: Final = ("mallet-64", "wrench-94", "wrench-160", "mallet-160", "mallet-192")
"""Shapes of the paper's figures and tables."""
RANDOM_PATHS: Final = 20
"""Number of random paths that the benchmark folds by the published algorithm, one to three minutes
each."""
BLOCKS_PER_PATH: Final = 20
"""Number of 2×2×2 blocks of cells of which each random path consists: 160 modules, as in the
paper's wrench."""
MIN_VERIFIED: Final = 24
"""Target of the benchmark: at least this number of 25 folds by the published algorithm (20 random
paths and 5 shapes of the paper) is verified. Below it the target is reported as not met."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One fold: ``shape`` of the gallery, or ``random`` with the seed of its path."""

    shape: str
    seed: int


def cases() -> list[Case]:
    """Return all cases, the paper's shapes first."""
    return [
        *(Case(shape=shape, seed=0) for shape in SHAPES),
        *(Case(shape="random", seed=seed) for seed in range(RANDOM_PATHS)),
    ]


def random_blocks(rng: np.random.Generator) -> NDArray[np.int64]:
    """Return (``BLOCKS_PER_PATH``, 3) blocks, each next to one of those before it."""
    blocks = [(0, 0, 0)]
    while len(blocks) < BLOCKS_PER_PATH:
        beside = np.add(blocks[int(rng.integers(len(blocks)))], STEPS[int(rng.integers(6))])
        x, y, z = beside.tolist()
        if (x, y, z) not in blocks:
            blocks.append((x, y, z))
    return np.array(blocks, dtype=np.int64)


def run(case: Case) -> dict[str, Any]:
    """Return the figures of one fold."""
    if case.shape == "random":
        rng = np.random.default_rng(case.seed)
        cells = block_path(random_blocks(rng), rng, tree="random")
        path = CellPath.from_cells(cells, name=f"random-{case.seed}")
    else:
        file = ROOT / "examples" / "shapes" / f"{case.shape}.json"
        result = read(file.read_bytes(), filename=file.name)
        assert isinstance(result, CellPath)
        path = result
    start_s = time.process_time()
    plan = fold(path, preset="paper", seed=case.seed)
    certificate = plan.certificate
    return {
        **asdict(case),
        "modules": len(plan.chain),
        "verified": certificate.verified,
        "verdict": certificate.verdict,
        "reason": certificate.reason and str(certificate.reason.code),
        "clearance": certificate.min_clearance,
        "record": certificate.min_clearance_record,
        "cpu s": round(time.process_time() - start_s, 1),
    }


def published(reference_seconds: float) -> Section:
    """Run the missing cases; return the table of all."""
    del reference_seconds
    section = Section(name="published")
    path = ROOT / "out" / f"published-{version_of('planner')}.jsonl"
    section.rows = run_missing(path, cases(), run)
    verified = sum(row["verified"] for row in section.rows)
    section.add(
        "verified with the published recipe",
        f"{verified} of {len(section.rows)}",
        f"≥ {MIN_VERIFIED}",
        verified >= MIN_VERIFIED,
    )
    return section


def main() -> None:
    """Run missing cases for some minutes, then print all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=float("inf"))
    options = parser.parse_args()
    path = ROOT / "out" / f"published-{version_of('planner')}.jsonl"
    for row in run_missing(path, cases(), run, minutes=options.minutes):
        Console().print(row)


if __name__ == "__main__":
    main()
