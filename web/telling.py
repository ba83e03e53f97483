"""Telling: what the page is told about a film, a moment of it, and a module."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planner.modules import CUBE
from web.film import Film, Snapshot

Message = dict[str, Any]


def outline_of(film: Film) -> Message:
    """What the bar draws."""
    chain = film.chain
    return {
        "is": "outline",
        **film.outline(),
        "modules": len(chain),
        "joints": len(chain) - 1 - chain.module.rigid_links,
    }


def moment_of(shown: Snapshot | None) -> Message:
    """Time, phase and largest error of what is shown."""
    if shown is None:
        return {"time_s": 0.0, "phase": None, "error_rad": None}
    errors = shown.module_error_rad
    largest = float(np.nanmax(errors)) if np.isfinite(errors).any() else math.nan
    return {
        "time_s": round(shown.time_s, 4),
        "phase": shown.phase,
        "error_rad": _finite(largest),
    }


def module_of(film: Film, shown: Snapshot, index: int) -> Message:
    """A module, where it belongs, and its joint now."""
    chain = film.chain
    hinges = chain.module.hinges_per_joint
    first = (index - chain.module.rigid_links) * hinges
    columns = range(first, first + hinges) if 0 <= first < len(chain.folded_rad) else ()
    # Only cubes fill cells; what others are rounded to means nothing.
    cell = None
    if chain.module is CUBE:
        cell = [round(float(c)) for c in film.folded_positions[index]]
    return {
        "is": "module",
        "index": index,
        "modules": len(chain),
        "cell": cell,
        "error_rad": _finite(float(shown.module_error_rad[index])),
        "joints": [
            {
                "name": chain.joint_names[j],
                "angle_rad": round(float(shown.joint_angles_rad[j]), 6),
                "target_rad": round(float(chain.folded_rad[j]), 6),
                "error_rad": _finite(float(shown.joint_error_rad[j])),
            }
            for j in columns
        ],
    }


def _finite(value: float) -> float | None:
    return float(f"{value:.4g}") if math.isfinite(value) else None
