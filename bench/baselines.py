"""Baselines: direct servoing, which usually fails, and the preset with published parameters."""

from __future__ import annotations

from typing import Any

from bench.command import fold
from bench.folds import PAPER_STEPS
from bench.sections import Section

DIRECT_SHAPES = (
    "wrench-24",
    "mallet-24",
    "mallet-64",
    "wrench-80",
    "mallet-80",
    "wrench-94",
    "wrench-160",
    "mallet-160",
    "mallet-192",
)
"""Shapes of the gallery that direct servoing tries; reverse explosion folds all of them."""
PAPER_SHAPES = ("mallet-24", "mallet-64")
"""Shapes of the gallery that are folded with the published parameters."""


def direct(reference_seconds: float) -> Section:
    """Fold shapes by direct servoing to the target; reverse explosion can fold all of them."""
    del reference_seconds
    return _runs("direct", DIRECT_SHAPES, "direct")


def paper(reference_seconds: float) -> Section:
    """Fold two shapes with the published parameters."""
    del reference_seconds
    section = _runs("paper", PAPER_SHAPES, "paper")
    section.add("published, 160 modules", f"about {PAPER_STEPS} steps")
    return section


def _runs(name: str, shapes: tuple[str, ...], preset: str) -> Section:
    section = Section(name=name)
    folded = 0
    for shape in shapes:
        run = fold(shape, "--preset", preset)
        folded += run.code == 0
        section.rows.append(_row(shape, run.summary, run.wall_s))
    section.add(f"verified with {preset}", f"{folded} of {len(shapes)}", "reported")
    return section


def _row(shape: str, summary: dict[str, Any], wall_s: float) -> dict[str, Any]:
    certificate, playback = summary["certificate"], summary["playback"] or {}
    return {
        "shape": shape,
        "verdict": certificate["verdict"],
        "rms": playback.get("rms_position_error"),
        "overlap": certificate["min_clearance_playback"],
        "steps": summary["explosion"]["steps"] + playback.get("steps", 0),
        "wall s": wall_s,
    }
