"""Recording: a fold as a ``.viser`` file, which viser's own client plays and scrubs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from foldback.web.palette import error_colours
from foldback.web.pictures.camera import View, framing
from foldback.web.pictures.table_top import TableTop
from foldback.web.timeline.view import TimelineView
from foldback.web.viser.scene_bundle import viser_scene

if TYPE_CHECKING:
    import viser
    from viser._messages import Message

RECORDING_S: Final = 24.0
"""Duration for which a file for the viser player plays at normal speed, in s."""


def recording_of(timeline: TimelineView, table: TableTop | None = None) -> bytes:
    """Return a recording of ``RECORDING_S`` seconds; of long timelines frames are left out.

    Raises:
        TimelineError: If the timeline is being replaced.
    """
    max_frames = max(2, min(1200, 12_000_000 // (8 * len(timeline.chain))))
    frames = np.unique(
        np.linspace(0, len(timeline) - 1, min(max_frames, len(timeline))).round().astype(int)
    )
    with viser_scene(timeline.chain, timeline.stretch, table) as (server, scene):
        record = server.get_scene_serializer()
        for frame in frames:
            snapshot = timeline.snapshot(float(frame))
            scene.show(snapshot, error_colours(snapshot.module_error_rad, timeline.error_scale_rad))
            scene.move_ground(RECORDING_S / len(frames))
            look(server, framing(scene.points(snapshot), radius=scene.radius))
            record.insert_sleep(RECORDING_S / len(frames))
        return record.serialize()


def look(server: viser.ViserServer, view: View) -> None:
    """Move the camera of all clients.

    The messages are broadcast in order with the poses. viser sends messages to a single client
    separately, so that chain and camera would not move together.
    """
    from viser._messages import SetCameraLookAtMessage, SetCameraPositionMessage

    with server.atomic():
        x, y, z = (float(v) for v in view.position)
        _broadcast(server, SetCameraPositionMessage((x, y, z)))
        x, y, z = (float(v) for v in view.target)
        _broadcast(server, SetCameraLookAtMessage((x, y, z)))


def _broadcast(server: viser.ViserServer, message: Message) -> None:
    """Send a message to all clients of a server, in order with those of its scene."""
    websocket: Any = server._websock_server  # pyright: ignore[reportPrivateUsage]
    websocket.queue_message(message)
