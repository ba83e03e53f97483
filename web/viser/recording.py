"""Recording: a fold as a ``.viser`` file, which viser's own client plays and scrubs."""

from __future__ import annotations

from typing import Final

import numpy as np

from web.pictures.camera import framing
from web.timeline.view import TimelineView
from web.viser.scene_bundle import viser_scene

MOST_FRAMES: Final = 1200
MOST_NUMBERS: Final = 12_000_000
"""Frames times modules times the numbers of a pose: a recording holds each pose in full."""
SECONDS: Final = 24.0


def recording_of(timeline: TimelineView) -> bytes:
    """The timeline as a recording of ``SECONDS`` seconds, thinned where it is long.

    Raises:
        TimelineError: When the timeline is being replaced.
    """
    most = max(2, min(MOST_FRAMES, MOST_NUMBERS // (8 * len(timeline.chain))))
    frames = np.unique(
        np.linspace(0, len(timeline) - 1, min(most, len(timeline))).round().astype(int)
    )
    with viser_scene(timeline.chain, timeline.stretch) as (server, scene):
        record = server.get_scene_serializer()
        for frame in frames:
            snapshot = timeline.snapshot(float(frame))
            scene.show(snapshot, scale_rad=timeline.error_scale_rad)
            scene.move_ground(SECONDS / len(frames))
            scene.look(framing(scene.points(snapshot), radius=scene.radius))
            record.insert_sleep(SECONDS / len(frames))
        return record.serialize()
