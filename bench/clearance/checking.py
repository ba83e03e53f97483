"""Checking: plans proved by ``foldback_check.py``, compared with the planner's certificates.

``python -m bench.clearance.checking [SEED …]`` checks the gallery with other seeds than 0.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any, Final

from rich.console import Console

from bench.command import fold
from bench.machine import machine
from bench.processes import each_of
from bench.scaling import CASES
from bench.sections import Section
from bench.shape_files import SHAPES
from foldback import foldback_check
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.storage.file_names import PLAN

MAX_CHECK_S: Final = {
    "wrench-160": 2.0,
    "simultaneous-512": 60.0,
    "ball-1000": 30.0,
    "ball-10000": 600.0,
}
"""Maximum seconds for the checker, start of Python included, to prove the plan of each case."""


def checking(reference_seconds: float) -> Section:
    """Check and time four plans of 160 to 10 000 modules, then check the gallery with seed 0."""
    section = Section(name="checking")
    for name, bar_s in MAX_CHECK_S.items():
        row = _timed(name, reference_seconds)
        section.rows.append(row)
        is_met = row["verdict"] == "proved" and row["s"] <= bar_s
        section.add(
            f"{name}: checker", f"{row['verdict']}, {row['s']:.1f} s", f"≤ {bar_s:g} s", is_met
        )
    gallery(section, (0,))
    return section


def gallery(section: Section, seeds: Sequence[int]) -> None:
    """Fold and check all shapes of the gallery with some seeds."""
    runs = [(path, seed) for seed in seeds for path in sorted(SHAPES.glob("*.json"))]
    rows = list(each_of(_folded_and_checked, runs))
    section.rows += [row for row in rows if row["verdict"] != "proved" or not row["verified"]]
    agree = sum(row["verified"] == (row["verdict"] == "proved") for row in rows)
    proved = sum(row["verdict"] == "proved" for row in rows)
    seconds = sorted(row["s"] for row in rows)
    section.add(
        f"gallery, seeds {', '.join(map(str, seeds))}: proved at the certificate's own bound",
        f"{proved} of {len(rows)}",
        "all",
        proved == len(rows),
    )
    section.add("verdicts that differ", str(len(rows) - agree), "0", agree == len(rows))
    section.add(
        "seconds of one check, median and most",
        f"{seconds[len(seconds) // 2]:.2f}, {seconds[-1]:.2f}",
    )


def _timed(name: str, reference_seconds: float) -> dict[str, Any]:
    case = CASES[name]
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        shape, out = case.shape, FilePath(folder) / "fold"
        if case.data is not None:
            file = FilePath(folder) / shape
            file.write_bytes(case.data())
            shape = str(file)
        run = fold(shape, *case.options, out=out)
        command = [sys.executable, foldback_check.__file__, str(out / PLAN), "--json"]
        start_s = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - start_s
        values = json.loads(done.stdout)
    bound = run.summary["certificate"]["clearance_bound"]
    return {
        "plan": name,
        "verified": run.code == 0,
        "verdict": values["verdict"],
        "modules": values["modules"],
        "frames": values["frames"],
        "certificate's bound": bound,
        "rounding": values.get("rounding"),
        "looks at pairs": values.get("looks"),
        "s": seconds,
        "references": seconds / reference_seconds,
        "reason": values.get("reason", ""),
    }


def _folded_and_checked(run: tuple[FilePath, int]) -> dict[str, Any]:
    path, seed = run
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        request = FoldRequest(filename=path.name, seed=seed)
        Workspace(FilePath(folder)).write_request(request, path.read_bytes())
        summary = run_stages(FilePath(folder))
        result = foldback_check.check(FilePath(folder) / PLAN, end=path)
    return {
        "plan": f"{path.stem}, seed {seed}",
        "verified": summary["status"] == "verified",
        "verdict": result["verdict"],
        "modules": result.get("modules"),
        "frames": result.get("frames"),
        "certificate's bound": summary["certificate"]["clearance_bound"],
        "rounding": result.get("rounding"),
        "looks at pairs": result.get("looks"),
        "s": result["seconds"],
        "references": None,
        "reason": result.get("reason", ""),
    }


def main() -> None:
    """Check the gallery with the seeds of the command line."""
    section = Section(name="checking")
    gallery(section, [int(seed) for seed in sys.argv[1:]] or (0,))
    console = Console(width=160)
    console.print(machine())
    section.show(console)


if __name__ == "__main__":
    main()
