"""Quality of motions: default folds, the same smoothed, and those of ``--prefer calm``.

``python -m bench.motion_quality [SHAPE …]`` prints the named shapes of the gallery.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from rich.console import Console

from bench.machine import processor_seconds
from bench.sections import Section
from bench.shape_files import SHAPES
from foldback.planner.pipeline.fold import smooth_plan
from foldback.planner.pipeline.preference import CALM, COMPUTING, PlanFigures, Preference
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan

NAMES: Final = (
    *("wrench-24", "mallet-24", "tetra-ring", "snake-swan", "box-4x4x4", "letter-f", "mallet-64"),
    *("four", "wrench-80", "letter-s", "wrench-94", "letter-a", "cross-3d", "tetra-letter-f"),
    *("hammer", "key", "bolt", "tetra-frame", "axe", "wrench-160"),
)
"""Gallery shapes of 12 to 160 modules of three kinds that are folded."""
MIN_TRAVEL: Final = 1.05
"""Travel of a default fold, relative to the least, from which smoothing is expected to shorten it;
shorter ones are mostly turns, whose hinges go straight to their goals."""
COMPARED: Final = ("travel", "reversals", "moving mean", "fold s", "torque", "bound", "cpu s")
"""Figures whose medians are stated."""


def motion_quality(reference_seconds: float, shapes: tuple[str, ...] = NAMES) -> Section:
    """Fold shapes by default, smooth these plans, and fold them again for the calmest motion."""
    del reference_seconds
    section = Section(name="motion-quality")
    runs: dict[str, list[dict[str, Any]]] = {"default": [], "smooth": [], CALM: []}
    for shape in shapes:
        plain, row = _measured(shape, "default", lambda shape=shape: _folded(shape, COMPUTING))
        in_s = plain.certificate.fold_time_s or 1.0
        default_torque = plain.certificate.peak_torque_nm or 1.0
        smoothed, smooth_row = _measured(shape, "smooth", lambda plain=plain: smooth_plan(plain))
        calm, calm_row = _measured(shape, CALM, lambda shape=shape: _folded(shape, CALM))
        for name, plan, line in zip(
            runs, (plain, smoothed, calm), (row, smooth_row, calm_row), strict=True
        ):
            torque = PlanFigures.of(plan.certificate.as_dict()).torque_in(in_s) or 0.0
            runs[name].append(line | {"torque": torque / default_torque})
        section.rows += [runs[name][-1] for name in runs]
    for figure in COMPARED:
        medians = {
            name: float(np.median([row[figure] for row in rows])) for name, rows in runs.items()
        }
        text = ", ".join(f"{name} {value:.3g}" for name, value in medians.items())
        section.add(f"{figure}, median", text)
    _judge(section, runs)
    return section


def _judge(section: Section, runs: dict[str, list[dict[str, Any]]]) -> None:
    """Add the figures that have bars."""
    rows = [row for manner in runs.values() for row in manner]
    verified = sum(row["verified"] for row in rows)
    section.add("verified", f"{verified} of {len(rows)}", "all", verified == len(rows))
    long = [
        (plain, smooth)
        for plain, smooth in zip(runs["default"], runs["smooth"], strict=True)
        if plain["travel"] >= MIN_TRAVEL
    ]
    for figure, bar, share in (
        ("travel", "all", 1.0),
        ("reversals", "all", 1.0),
        ("torque", "9 of 10", 0.9),
    ):
        fewer = sum(smooth[figure] < plain[figure] for plain, smooth in long)
        text = f"{fewer} of {len(long)} with a travel of at least {MIN_TRAVEL}"
        section.add(f"{figure}, smooth below default", text, bar, fewer >= share * len(long))
    removed = [
        (plain["travel"] - smooth["travel"]) / (plain["travel"] - 1.0) for plain, smooth in long
    ]
    section.add("travel beyond the least that smoothing removes", f"{np.median(removed):.0%}")
    calmer = sum(
        calm["score"] >= plain["score"]
        for plain, calm in zip(runs["default"], runs[CALM], strict=True)
    )
    count = len(runs[CALM])
    section.add("calm not worse than default", f"{calmer} of {count}", "all", calmer == count)


def _folded(shape: str, prefer: Preference) -> Plan:
    with TemporaryDirectory() as scratch:
        directory = Path(scratch)
        request = FoldRequest(filename="path.json", prefer=prefer)
        Workspace(directory).write_request(request, (SHAPES / f"{shape}.json").read_bytes())
        run_stages(directory, workers=1)
        return Plan.load(directory / "plan.npz")


def _measured(shape: str, name: str, fold: Callable[[], Plan]) -> tuple[Plan, dict[str, Any]]:
    before_s = processor_seconds()
    plan = fold()
    certificate = plan.certificate
    return plan, {
        "shape": shape,
        "modules": len(plan.chain),
        "manner": name,
        "strategy": (plan.explosion or {}).get("strategy"),
        "verified": certificate.verified,
        "travel": certificate.travel_ratio,
        "reversals": certificate.reversals_mean,
        "moving mean": certificate.hinges_moving_mean,
        "moving max": certificate.hinges_moving_most,
        "fold s": certificate.fold_time_s,
        "bound": certificate.clearance_bound,
        "score": PlanFigures.of(certificate.as_dict()).score(CALM),
        "cpu s": round(processor_seconds() - before_s, 2),
    }


def main() -> None:
    """Print the shapes of the command line."""
    motion_quality(0.0, tuple(sys.argv[1:]) or NAMES).show(Console(width=220))


if __name__ == "__main__":
    main()
