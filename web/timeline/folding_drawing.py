"""The moving drawing of a recorded fold."""

from __future__ import annotations

import numpy as np

from foldback.web.pictures.moving_drawing import SAMPLED_FRAMES, folding_svg, frames_of_motion
from foldback.web.timeline.view import TimelineView


def folding_drawing(timeline: TimelineView) -> str:
    """Return an SVG file in which the chain folds as recorded; empty if it cannot be drawn.

    Raises:
        TimelineError: If the timeline is damaged.
    """
    folding = [part for part in timeline.outline()["phases"] if part["name"] == "playback"]
    modules = len(timeline.chain)
    if not folding or not frames_of_motion(SAMPLED_FRAMES, modules):
        return ""
    first, stop = folding[-1]["from"], folding[-1]["to"]
    frames = np.unique(np.rint(np.linspace(first, stop - 1, SAMPLED_FRAMES)).astype(int))
    snapshots = (timeline.snapshot(frame) for frame in frames.tolist())
    positions = [snapshot.positions.astype(np.float64) for snapshot in snapshots]
    return folding_svg(timeline.chain, positions) if len(positions) > 1 else ""
