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
from web.pictures.colours import UNKNOWN_ERROR_RGB, instance_colours
from web.timeline.view import TimelineView
from web.viser.recording import look
from web.viser.scene import Scene


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def grey(chain: Chain) -> np.ndarray:
    """Colours that say that nothing is known."""
    return np.tile(np.array(UNKNOWN_ERROR_RGB, np.uint8), (len(chain), 1))


def sent(server: viser.ViserServer, kind: type) -> list[messages.Message]:
    """What a client that connected now would be sent."""
    buffer = server._websock_server.get_message_buffer()
    return [m for m in buffer.message_from_id.values() if isinstance(m, kind)]


def test_modules_are_where_the_timeline_has_them(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    timeline = TimelineView(timeline_path)
    scene = Scene(server, chain)
    shown = timeline.snapshot(40)
    scene.show(shown, grey(chain))
    modules = scene._modules
    assert np.allclose(modules.batched_positions, shown.positions * scene.pitch)
    assert np.allclose(modules.batched_wxyzs, shown.wxyzs)


def test_colours_are_sent_as_linear_light(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    timeline = TimelineView(timeline_path)
    scene = Scene(server, chain)
    scene.show(timeline.snapshot(0), grey(chain))
    linear = instance_colours(np.array([UNKNOWN_ERROR_RGB], np.uint8))[0]
    assert (np.asarray(scene._modules.batched_colors) == linear).all()


def test_the_ends_are_marked_outside_the_chain(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    scene = Scene(server, chain)
    shown = TimelineView(timeline_path).snapshot(99)  # straight
    scene.show(shown, grey(chain))
    ends = np.asarray(scene._ends.batched_positions) / scene.pitch
    way = shown.positions[1] - shown.positions[0]
    assert (ends[0] - shown.positions[0]) @ way == pytest.approx(-0.465, abs=1e-3)
    assert (ends[1] - shown.positions[-1]) @ way == pytest.approx(0.465, abs=1e-3)
    out = matrix_from_wxyz(np.asarray(scene._ends.batched_wxyzs, np.float64))[:, :, 0] @ way
    assert out == pytest.approx([-1.0, 1.0], abs=1e-3)


def test_the_ground_lies_below_the_chain(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    scene = Scene(server, chain)
    shown = TimelineView(timeline_path).snapshot(0)
    scene.show(shown, grey(chain))
    while scene.move_ground(0.1):
        pass
    height = scene._floor.position[2]
    assert height < (shown.positions[:, 2].min() - 0.5) * scene.pitch


def test_the_camera_goes_to_all_clients_with_the_poses(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    scene = Scene(server, chain)
    shown = TimelineView(timeline_path).snapshot(0)
    view = framing(scene.points(shown), radius=scene.radius)
    look(server, view)
    (position,) = sent(server, messages.SetCameraPositionMessage)
    (target,) = sent(server, messages.SetCameraLookAtMessage)
    assert np.allclose(position.position, view.position)
    assert np.allclose(target.look_at, view.target)
    assert not position.initial
