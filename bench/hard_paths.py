"""Hard paths: folds that succeed, their computing time, and the time of a robot for them.

``python -m bench.hard_paths`` runs the cases without a row of this version of the planner in
``out/hard``. It can be stopped at any time and continues where it stopped. Each fold runs to its
end and writes its files, with one explosion per core.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console

from bench.held_out_meshes import HELD_OUT, tube
from bench.meshes import Mesh
from bench.sections import Section
from bench.shape_files import path_file, path_of
from foldback.planner.errors import InputError
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.progress import Cancelled
from foldback.planner.sweeps.case import Case, Limits, Row
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.planner_digest import planner_digest
from foldback.planner.sweeps.rows import Rows
from foldback.planner.sweeps.run import run_cases
from foldback.planner.verification.plan_failure import reason_of

OUT: Final = Path(__file__).parents[1] / "out" / "hard"
LIMITS: Final = Limits(cpu_s=7200.0, wall_s=14_400.0, memory_bytes=16 * 2**30)
"""Limits of each fold, which only a hang exceeds."""
SIDES: Final = {
    144: (4, 6, 6),
    288: (6, 6, 8),
    512: (8, 8, 8),
    1000: (10, 10, 10),
    1152: (8, 12, 12),
    4096: (16, 16, 16),
    9600: (20, 20, 24),
}
"""Sides of the boxes, in cells, by number of modules."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """One fold.

    Attributes:
        group: Name of the group whose bar it counts for.
        shape: Kind of the path through a box, or name of a mesh.
        modules: Number of modules of the box, or requested for the mesh.
        seed: Seed of the path and of the fold.
        prefer, strategy: Options of the fold.
    """

    group: str
    shape: str
    modules: int
    seed: int = 0
    prefer: str = "computing"
    strategy: str = "auto"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """Required results of a group.

    Attributes:
        least: Minimum number of verified folds.
        seconds: Maximum wall time of each fold, s; None if times are only reported.
        robot_s: Maximum duration of each folding at the joints' speed limit, s; None if only
            reported.
    """

    least: int
    seconds: float | None = None
    robot_s: float | None = None


BARS: Final = {
    "random 288": Bar(least=10, seconds=15.0),
    "random 512": Bar(least=9, seconds=45.0),
    "random 1152": Bar(least=0, seconds=300.0),
    "block 1152": Bar(least=5, seconds=60.0),
    "exact 1152": Bar(least=5, seconds=60.0),
    "block 1000": Bar(least=5, seconds=60.0),
    "all at once, 4096": Bar(least=0),
    "knotted tubes": Bar(least=0),
    "held-out meshes, 2000": Bar(least=10),
    "layered, quickest for a robot": Bar(least=4, robot_s=6.0),
    "layered, 4096 in parallel": Bar(least=1, robot_s=40.0),
    "layered, 9600 in parallel": Bar(least=1, robot_s=90.0),
}
STRICT: Final = "peeled, whatever comes"
"""Group of folds that must be peeled. Some are refused, and their reasons are checked."""


def cases() -> list[Fold]:
    """Return all cases, the fastest first."""
    computed_cases = [
        Fold(group="layered, quickest for a robot", shape="snake", modules=n, prefer="time")
        for n in (144, 288, 512, 1152)
    ]
    computed_cases += [
        Fold(group="random 288", shape="random", modules=288, seed=s) for s in range(10)
    ]
    computed_cases += [
        Fold(group="random 512", shape="random", modules=512, seed=s) for s in range(10)
    ]
    for seed in range(5):
        for shape, modules in (("block", 1000), ("block", 1152), ("exact", 1152)):
            group = f"{shape} {modules}"
            computed_cases.append(Fold(group=group, shape=shape, modules=modules, seed=seed))
    for modules in (4096, 9600):
        group = f"layered, {modules} in parallel"
        computed_cases.append(Fold(group=group, shape="snake", modules=modules, strategy="blocks"))
    computed_cases += [
        Fold(group="knotted tubes", shape=name, modules=n) for n in (500, 1000) for name in KNOTS
    ]
    computed_cases += [
        Fold(group="held-out meshes, 2000", shape=name, modules=2000) for name in HELD_OUT
    ]
    computed_cases += [
        Fold(group="random 1152", shape="random", modules=1152, seed=s) for s in range(5)
    ]
    computed_cases += [
        Fold(group=STRICT, shape=shape, modules=modules, seed=seed, strategy="peel")
        for shape, modules, seeds in (("random", 288, 5), ("random", 512, 2), ("block", 512, 3))
        for seed in range(seeds)
    ]
    computed_cases += [
        Fold(group="all at once, 4096", shape=shape, modules=4096) for shape in ("block", "exact")
    ]
    return computed_cases


def torus_knot(p: int, q: int) -> Callable[[], Mesh]:
    """Return a function that makes a tube along the (p, q) torus knot."""

    def made() -> Mesh:
        t = np.linspace(0.0, 2.0 * np.pi, 480, endpoint=False)
        out = 2.0 + np.cos(q * t)
        curve = np.column_stack([out * np.cos(p * t), out * np.sin(p * t), -np.sin(q * t)])
        return tube(3.0 * curve, np.full(len(t), 1.1))

    return made


def figure_eight() -> Mesh:
    """Return a tube along the figure-eight knot, which has four crossings."""
    t = np.linspace(0.0, 2.0 * np.pi, 480, endpoint=False)
    out = 2.0 + np.cos(2 * t)
    curve = np.column_stack([out * np.cos(3 * t), out * np.sin(3 * t), np.sin(4 * t)])
    return tube(3.0 * curve, np.full(len(t), 1.0))


KNOTS: Final[dict[str, Callable[[], Mesh]]] = {
    "trefoil tube": torus_knot(2, 3),
    "figure-eight tube": figure_eight,
    "(2,5) torus knot tube": torus_knot(2, 5),
}


def run(case: Fold, cancelled: Cancelled) -> Row:
    """Fold one case and return the figures of its row."""
    data, options = _input(case)
    with tempfile.TemporaryDirectory(prefix="foldback-hard-") as place:
        directory = Path(place)
        request = FoldRequest(
            seed=case.seed,
            prefer=case.prefer,
            strategy=case.strategy,
            **options,  # type: ignore[arg-type]
        )
        Workspace(directory).write_request(request, data)
        try:
            summary = run_stages(directory, cancelled=cancelled, workers=os.cpu_count() or 1)
        except InputError as error:
            return {"verified": False, "verdict": f"refused: {error.code}"}
        plan = Plan.load(directory / "plan.npz")
        reason = reason_of(directory, plan, [])
    certificate = plan.certificate
    return {
        "chain": len(plan.chain),
        "verified": certificate.verified,
        "verdict": certificate.verdict,
        "reason": (summary.get("stuck") or {}).get("words", ""),
        "kind": reason and reason.kind,
        "confirmed": reason and reason.confirmed,
        "fold_time_s": certificate.fold_time_s,
        "clearance_bound": certificate.clearance_bound,
        "attempts": ", ".join(f"{a['strategy']} {a['status']}" for a in plan.attempts),
    }


def _input(case: Fold) -> tuple[bytes, dict[str, Any]]:
    mesh = {**KNOTS, **HELD_OUT}.get(case.shape)
    if mesh is not None:
        exported: Any = mesh().export(file_type="stl")
        return exported, {"filename": f"{case.shape}.stl", "modules": case.modules}
    cells = path_of(case.shape, SIDES[case.modules], case.seed)
    assert cells is not None, f"a box has {case.shape} paths"
    return path_file(cells), {}


def hard_paths(reference_seconds: float) -> Section:
    """Run all cases and compare them with their bars."""
    return section_of(run_missing(cases()), reference_seconds)


def run_missing(selected: list[Fold]) -> list[Row]:
    """Run those that have no row yet; return the rows of all."""
    stored = Rows(OUT)
    keys = {f"{planner_digest()} {path}": path for path in selected}
    rows = {key: row for key, row in stored.read().items() if row["verdict"] != "error"}
    cases = [
        Case(key=key, columns=asdict(path), task=partial(run, path), limits=LIMITS)
        for key, path in keys.items()
        if key not in rows
    ]
    with stored.writing() as add, executor_on(Place(workers=1)) as executor:
        for row in run_cases(cases, add, executor, at_once=executor.at_once):
            rows[str(row["key"])] = row
    return [rows[key] for key in keys]


def section_of(rows: Sequence[Mapping[str, Any]], reference_seconds: float) -> Section:
    """Return the figures of some rows; seconds also as multiples of the reference."""
    section = Section(name="hard")
    section.rows = [dict(row) for row in rows]
    for group, bar in BARS.items():
        of_group = [row for row in rows if row["group"] == group]
        if not of_group:
            continue
        verified = [row for row in of_group if row.get("verified")]
        slowest = max((row["wall_s"] for row in verified), default=0.0)
        robot = max((row["fold_time_s"] or 0.0 for row in verified), default=0.0)
        in_time = bar.seconds is None or slowest <= bar.seconds
        quick = bar.robot_s is None or robot <= bar.robot_s
        section.add(
            group,
            f"{len(verified)} of {len(of_group)} verified, {slowest:.0f} s at most "
            f"({slowest / reference_seconds:.0f} r), folds in {robot:.1f} s at most",
            f"{bar.least}"
            + ("" if bar.seconds is None else f", each within {bar.seconds:.0f} s")
            + ("" if bar.robot_s is None else f", folding in {bar.robot_s:.0f} s"),
            len(verified) >= bar.least and in_time and quick,
        )
    reasons = Counter(row["kind"] for row in rows if row.get("kind"))
    if reasons:
        confirmed = sum(bool(row.get("confirmed")) for row in rows)
        section.add(
            "reasons of refusals confirmed by other code",
            f"{confirmed} of {reasons.total()}: "
            + ", ".join(f"{count} {kind}" for kind, count in reasons.most_common()),
            "all",
            confirmed == reasons.total(),
        )
    return section


def main() -> None:
    """Run what is missing, then print all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", help="groups, by how they begin")
    options = parser.parse_args()
    from bench.machine import machine  # imported late: it takes a second

    selected = [c for c in cases() if not options.only or c.group.startswith(tuple(options.only))]
    section_of(run_missing(selected), machine()["reference_seconds"]).show(Console(width=160))


if __name__ == "__main__":
    # Imported by name: the processes of folds cannot unpickle what is in __main__.
    from bench.hard_paths import main as begin

    begin()
