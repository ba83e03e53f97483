"""Gallery and meshes with five seeds each: fractions verified, and verified at first attempt.

``python -m bench.success_map.seeds`` runs the cases that are missing in ``out/seeds-….jsonl``, a
file for each version of the planner. It can be stopped at any time and continues where it stopped.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from bench.meshes import MESHES
from bench.sections import Section
from bench.success_map.stored import judge, run_missing, version_of
from examples.run_gallery import SHAPES
from foldback.planner.errors import InputError
from foldback.planner.pipeline.request import FoldRequest

OUT: Final = Path(__file__).parents[2] / "out"
SEEDS_PER_SHAPE: Final = 5
"""Number of random seeds with which each shape is folded."""
MESH_MODULES: Final = 240
"""Number of modules that is requested when a triangle mesh is turned into a chain, which consists
of some thirty 2×2×2 blocks."""
MIN_VERIFIED_AT_ONCE: Final = 0.98
"""Target of the benchmark: at least this fraction of the folds of the gallery's shapes, and
likewise of meshes, is verified at the first attempt, over all seeds. Below it the target is
reported as not met."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One fold: a shape of the gallery, or a mesh that becomes a path by blocks."""

    kind: str
    shape: str
    seed: int


def cases() -> Iterator[Case]:
    """Yield all cases, those with the first seed first."""
    for seed in range(SEEDS_PER_SHAPE):
        for shape in sorted(file.stem for file in SHAPES.glob("*.json")):
            yield Case(kind="gallery", shape=shape, seed=seed)
        for shape in MESHES:
            yield Case(kind="mesh", shape=shape, seed=seed)


def run(case: Case) -> dict[str, Any]:
    """Return the row of one case; ``first`` is the reason why its first attempt failed."""
    start_s = time.process_time()
    with tempfile.TemporaryDirectory(prefix="foldback-seeds-") as place:
        directory = Path(place)
        try:
            certificate = judge(directory, *_input(case))
            verified, verdict = certificate["verified"], certificate["verdict"]
            modules = json.loads((directory / "chain.json").read_bytes())["modules"]
            attempts = json.loads((directory / "attempts.json").read_bytes())
        except InputError as error:
            modules, verified, verdict, attempts = 0, False, f"refused: {error.code}", [{}]
    first, last = attempts[0], attempts[-1]
    code = (first.get("refusal") or {}).get("code") or (first.get("diagnosis") or {}).get(
        "kind", ""
    )
    return {
        **asdict(case),
        "modules": modules,
        "verified": verified,
        "verdict": verdict,
        "attempts": len(attempts),
        "strategy": last.get("strategy"),
        "first": "" if len(attempts) == 1 else code,
        "cpu s": round(time.process_time() - start_s, 2),
    }


def _input(case: Case) -> tuple[FoldRequest, bytes]:
    if case.kind == "gallery":
        file = SHAPES / f"{case.shape}.json"
        return FoldRequest(filename=file.name, seed=case.seed), file.read_bytes()
    mesh: Any = MESHES[case.shape]()
    request = FoldRequest(
        filename=f"{case.shape}.stl", seed=case.seed, modules=MESH_MODULES, method="blocks"
    )
    return request, mesh.export(file_type="stl")


def runs() -> Path:
    """Return the file with the rows of this version of the planner."""
    return OUT / f"seeds-{version_of('planner')}.jsonl"


def seeds(reference_seconds: float) -> Section:
    """Fold every shape with every seed."""
    del reference_seconds
    return section_of(run_missing(runs(), cases(), run))


def section_of(rows: list[dict[str, Any]]) -> Section:
    """Return the figures of all rows, and the rows not verified at the first attempt."""
    section = Section(name="seeds")
    section.rows = [row for row in rows if row["attempts"] > 1 or not _verified(row)]
    for kind in dict.fromkeys(row["kind"] for row in rows):
        of_kind = [row for row in rows if row["kind"] == kind]
        verified = [row for row in of_kind if _verified(row)]
        at_once = sum(row["attempts"] == 1 for row in verified)
        share = at_once / len(of_kind)
        text = f"{at_once} of {len(of_kind)} ({100 * share:.1f} %)"
        bar = f"at least {100 * MIN_VERIFIED_AT_ONCE:.0f} %"
        section.add(f"{kind}: verified at once", text, bar, share >= MIN_VERIFIED_AT_ONCE)
        section.add(
            f"{kind}: verified with the portfolio",
            f"{len(verified)} of {len(of_kind)}",
            "all",
            len(verified) == len(of_kind),
        )
        spent = sorted(row["cpu s"] for row in of_kind)
        section.add(
            f"{kind}: processor, median and most",
            f"{spent[len(spent) // 2]:.1f} s, {spent[-1]:.1f} s",
            "reported",
        )
    return section


def _verified(row: dict[str, Any]) -> bool:
    return row["verified"]


def main() -> None:
    """Run what is missing, then print all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    rows = run_missing(runs(), cases(), run, minutes=options.minutes, workers=options.workers)
    section_of(rows).show(Console(width=160))


if __name__ == "__main__":
    main()
