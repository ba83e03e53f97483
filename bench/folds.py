"""The paper's shapes with the default preset: verdicts and times of the whole command."""

from __future__ import annotations

from typing import Any

from bench.command import Run, fold
from bench.sections import Section
from bench.sweep_sections import PAPER_STEPS

SHAPES = (
    "mallet-64",
    "wrench-94",
    "wrench-160",
    "mallet-160",
    "mallet-192",
    "box-4x4x4",
    "box-6x6x6",
)
"""Shapes of the paper, and two boxes."""
SEEDS = (0, 1, 2)
"""Seeds with which each shape is folded."""
SIZES = ("0.95", "0.98")
"""Module sizes as fractions of the pitch, as the command line takes them. The bars hold for the
first one."""


def folds(reference_seconds: float) -> Section:
    """Fold all shapes with all seeds at two module sizes; add details of the wrench of 160."""
    section = Section(name="folds")
    fold("wrench-24")
    for size in SIZES:
        runs = {
            (shape, seed): fold(shape, "--seed", str(seed), "--module-size", size)
            for shape in SHAPES
            for seed in SEEDS
        }
        section.rows += [_row(shape, seed, size, run) for (shape, seed), run in runs.items()]
        _figures(section, size, list(runs.values()))
        if size == SIZES[0]:
            _wrench(section, [runs["wrench-160", seed] for seed in SEEDS], reference_seconds)
    return section


def _row(shape: str, seed: int, size: str, run: Run) -> dict[str, Any]:
    summary = run.summary
    certificate, playback = summary["certificate"], summary["playback"] or {}
    return {
        "shape": shape,
        "seed": seed,
        "size": size,
        "verdict": certificate["verdict"],
        "clearance": certificate["min_clearance"],
        "in playback": certificate["min_clearance_playback"],
        "rms": playback.get("rms_position_error"),
        "joint error": playback.get("max_angle_error_rad"),
        "steps": summary["explosion"]["steps"] + playback.get("steps", 0),
        "peak N·m": certificate["peak_torque_nm"],
        "wall s": run.wall_s,
        "MB": run.peak_mb,
    }


def _figures(section: Section, size: str, runs: list[Run]) -> None:
    verified = sum(run.code == 0 for run in runs)
    plans = [run.summary["certificate"] for run in runs]
    playbacks = [run.summary["playback"] or {} for run in runs]

    def least(name: str) -> float:
        return min(-1.0 if plan[name] is None else plan[name] for plan in plans)

    def most(name: str) -> float:
        return max(playback.get(name, float("inf")) for playback in playbacks)

    is_met = {"0.95": True}.get(size)
    section.add(
        f"verified at size {size}",
        f"{verified} of {len(runs)}",
        "21 of 21" if is_met else "",
        verified == len(runs) if is_met else None,
    )
    for name, key in (
        ("least clearance of the plan", "min_clearance"),
        ("least clearance of the simulated playback", "min_clearance_playback"),
    ):
        value = least(key)
        section.add(
            f"{name}, size {size}",
            f"{value:.4f} pitch",
            "≥ 0" if is_met else "",
            value >= 0 if is_met else None,
        )
    if is_met:
        rms, error = most("rms_position_error"), most("max_angle_error_rad")
        section.add("final RMS position error", f"{rms:.1e} pitch", "≤ 1e-3", rms <= 1e-3)
        section.add("largest joint error", f"{error:.1e} rad", "≤ 2e-3", error <= 2e-3)


def _wrench(section: Section, runs: list[Run], reference_seconds: float) -> None:
    seconds = [
        run.summary["explosion"]["seconds"]
        + run.summary["playback"]["seconds"]
        + run.summary["certificate"]["seconds"]
        for run in runs
    ]
    middle = sorted(seconds)[len(seconds) // 2]
    wall = sorted(run.wall_s for run in runs)[len(runs) // 2]
    steps = max(
        run.summary["explosion"]["steps"] + run.summary["playback"]["steps"] for run in runs
    )
    peak = max(run.peak_mb for run in runs)
    section.add(
        "160 wrench: explosion + playback + certificate",
        f"{middle:.2f} s ({middle / reference_seconds:.1f} × reference)",
        "< 6 s, target 3 s",
        middle < 6,
    )
    section.add("160 wrench: whole command, imports included", f"{wall:.2f} s")
    section.add(
        "160 wrench: steps",
        f"{steps} ({PAPER_STEPS / steps:.0f} × fewer than published)",
        "≤ 5000",
        steps <= 5000,
    )
    section.add("160 wrench: peak memory", f"{peak:.0f} MB", "< 400 MB", peak < 400)
