"""The gallery and meshes of blocks with five seeds each: how many fold at once, how many at all.

``python -m tests.benchmarks.seeds`` runs what is missing in ``out/seeds.jsonl``; it can be stopped
at any time and goes on where it was.
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

from examples.run_gallery import SHAPES
from planner.errors import InputError
from planner.request import Request
from planner.stages import run_stages, write_request
from planner.warm_up import warm_up
from tests.benchmarks.meshes import MESHES
from tests.benchmarks.tables import Section

RUNS: Final = Path(__file__).parents[2] / "out" / "seeds.jsonl"
SEEDS: Final = 5
MODULES: Final = 240
"""Of a mesh: some thirty blocks of 2×2×2."""
AT_ONCE: Final = 0.98


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One fold: a shape of the gallery, or a mesh that becomes a path by blocks."""

    kind: str
    shape: str
    seed: int


def cases() -> Iterator[Case]:
    """All of them, the first seed of each first."""
    for seed in range(SEEDS):
        for shape in sorted(file.stem for file in SHAPES.glob("*.json")):
            yield Case(kind="gallery", shape=shape, seed=seed)
        for shape in MESHES:
            yield Case(kind="mesh", shape=shape, seed=seed)


def run(case: Case) -> dict[str, Any]:
    """What came of one case; ``first`` tells why its first attempt was not the last."""
    begun = time.process_time()
    with tempfile.TemporaryDirectory(prefix="foldback-seeds-") as place:
        directory = Path(place)
        try:
            write_request(directory, *_input(case))
            summary = run_stages(directory)
            tried = json.loads((directory / "attempts.json").read_bytes())
        except InputError as error:
            summary = {"modules": 0, "certificate": {"verdict": f"refused: {error.code}"}}
            tried = [{}]
    first, last = tried[0], tried[-1]
    why = first.get("verdict") or (first.get("diagnosis") or {}).get("kind", "")
    return {
        **asdict(case),
        "modules": summary["modules"],
        "verdict": summary["certificate"]["verdict"],
        "attempts": len(tried),
        "strategy": last.get("strategy"),
        "first": "" if len(tried) == 1 else why,
        "cpu s": round(time.process_time() - begun, 2),
    }


def _input(case: Case) -> tuple[Request, bytes]:
    if case.kind == "gallery":
        file = SHAPES / f"{case.shape}.json"
        return Request(filename=file.name, seed=case.seed), file.read_bytes()
    mesh: Any = MESHES[case.shape]()
    request = Request(
        filename=f"{case.shape}.stl", seed=case.seed, modules=MODULES, method="blocks"
    )
    return request, mesh.export(file_type="stl")


def known() -> dict[Case, dict[str, Any]]:
    """The runs that are stored."""
    lines = RUNS.read_text().splitlines() if RUNS.exists() else []
    rows = [json.loads(line) for line in lines]
    return {Case(kind=r["kind"], shape=r["shape"], seed=r["seed"]): r for r in rows}


def run_missing(minutes: float = float("inf")) -> list[dict[str, Any]]:
    """Runs what is not stored yet, for so long; all that is stored then."""
    stored = known()
    RUNS.parent.mkdir(exist_ok=True)
    warm_up()
    until = time.monotonic() + 60.0 * minutes
    for case in cases():
        if case in stored:
            continue
        if time.monotonic() > until:
            break
        stored[case] = run(case)
        with RUNS.open("a") as file:
            file.write(json.dumps(stored[case]) + "\n")
    return list(stored.values())


def seeds(reference_seconds: float) -> Section:
    """Every shape with every seed."""
    del reference_seconds
    return section_of(run_missing())


def section_of(rows: list[dict[str, Any]]) -> Section:
    """The figures of some runs; shown are those that did not fold at once."""
    section = Section(name="seeds")
    section.rows = [row for row in rows if row["attempts"] > 1 or not _verified(row)]
    for kind in dict.fromkeys(row["kind"] for row in rows):
        of_kind = [row for row in rows if row["kind"] == kind]
        verified = [row for row in of_kind if _verified(row)]
        at_once = sum(row["attempts"] == 1 for row in verified)
        share = at_once / len(of_kind)
        told = f"{at_once} of {len(of_kind)} ({100 * share:.1f} %)"
        bar = f"at least {100 * AT_ONCE:.0f} %"
        section.add(f"{kind}: verified at once", told, bar, share >= AT_ONCE)
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
    return row["verdict"].startswith("verified")


def main() -> None:
    """Runs what is missing, then prints all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=float("inf"))
    section_of(run_missing(parser.parse_args().minutes)).show(Console(width=160))


if __name__ == "__main__":
    main()
