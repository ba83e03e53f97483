"""The scene of a fold in a viser server; test_show.py compares poses and colours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import viser
from viser import _messages as messages

from planner.chain.chain import Chain
from planner.chain.rotations import matrix_from_wxyz
from web.pictures.camera import framing
from web.pictures.colours import UNKNOWN_ERROR_RGB
from web.timeline.view import TimelineView
from web.viser.recording import look
from web.viser.scene import Scene


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def sent(server: viser.ViserServer, kind: type) -> list[messages.Message]:
    """What a client that connected now would be sent."""
    buffer = server._websock_server.get_message_buffer()
    return [m for m in buffer.message_from_id.values() if isinstance(m, kind)]


def test_scene_marks_both_ends_above_the_ground_and_moves_all_cameras(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    scene = Scene(server, chain)
    straight = TimelineView(timeline_path).snapshot(99)
    scene.show(straight, np.tile(np.array(UNKNOWN_ERROR_RGB, np.uint8), (len(chain), 1)))
    ends = np.asarray(scene._ends.batched_positions) / scene.pitch
    way = straight.positions[1] - straight.positions[0]
    assert (ends[0] - straight.positions[0]) @ way == pytest.approx(-0.465, abs=1e-3)
    assert (ends[1] - straight.positions[-1]) @ way == pytest.approx(0.465, abs=1e-3)
    out = matrix_from_wxyz(np.asarray(scene._ends.batched_wxyzs, np.float64))[:, :, 0] @ way
    assert out == pytest.approx([-1.0, 1.0], abs=1e-3)

    while scene.move_ground(0.1):
        pass
    lowest = (straight.positions[:, 2].min() - 0.5) * scene.pitch
    assert scene._floor.position[2] < lowest

    view = framing(scene.points(straight), radius=scene.radius)
    look(server, view)
    (position,) = sent(server, messages.SetCameraPositionMessage)
    (target,) = sent(server, messages.SetCameraLookAtMessage)
    assert np.allclose(position.position, view.position)
    assert np.allclose(target.look_at, view.target)
    assert not position.initial
