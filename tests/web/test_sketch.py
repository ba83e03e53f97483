from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from planner.modules import MODULES
from web.camera import FIELD_OF_VIEW_RAD
from web.film import Film
from web.meshes import SHOWN_SIZE
from web.player import Player
from web.sketch import sketch_outline


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.mark.parametrize("name", sorted(MODULES))
def test_the_drawn_hull_is_closed_and_turns_outwards(name: str) -> None:
    module = MODULES[name]
    outline = sketch_outline(module, 2)
    corners = np.array(outline["corners"])
    np.testing.assert_allclose(corners, module.vertices * SHOWN_SIZE)
    edges: list[tuple[int, int]] = []
    for face, normal in zip(outline["faces"], outline["normals"], strict=True):
        ring = corners[face]
        turning = np.cross(ring[1] - ring[0], ring[2] - ring[1])
        np.testing.assert_allclose(turning / np.linalg.norm(turning), normal, atol=1e-9)
        np.testing.assert_allclose(ring @ normal, (corners @ normal).max(), atol=1e-9)
        edges += zip(face, face[1:] + face[:1], strict=True)
    # Every edge is passed once each way: there is no hole.
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)


class Watch:
    """Somebody who watches a player, and what came."""

    def __init__(self, player: Player) -> None:
        self.outlines: list[dict[str, Any]] = []
        self.frames: list[bytes] = []
        self.leave = player.watch(self._take)

    def _take(self, message: dict[str, Any] | bytes) -> None:
        if isinstance(message, bytes):
            self.frames.append(message)
        else:
            self.outlines.append(message)

    def last(self, modules: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Head (8,), poses (n, 7) and colours (n, 3) of the last frame."""
        numbers = np.frombuffer(self.frames[-1], "<f4", 8 + 7 * modules)
        colours = np.frombuffer(self.frames[-1], np.uint8, offset=numbers.nbytes)
        return numbers[:8], numbers[8:].reshape(-1, 7), colours.reshape(-1, 3)


def test_a_sketch_shows_what_the_scene_shows(
    server: viser.ViserServer, timeline_path: Path
) -> None:
    film = Film(timeline_path)
    n = len(film.chain)
    player = Player(server, lambda: film)
    early = Watch(player)
    assert not early.frames  # there is no timeline yet
    player.tick(0.0)
    assert early.outlines[0]["modules"] == n
    assert early.outlines[0]["field_of_view_rad"] == pytest.approx(FIELD_OF_VIEW_RAD)
    player.handle({"do": "seek", "frame": 70})
    head, poses, colours = early.last(n)
    snapshot = film.snapshot(70.0)
    assert head[0] == 70.0
    np.testing.assert_array_equal(poses[:, :3], snapshot.positions)
    np.testing.assert_array_equal(poses[:, 3:], snapshot.wxyzs)
    assert colours.shape == (n, 3)
    assert head[7] < snapshot.positions[:, 2].min()  # the ground is below the chain

    player.handle({"do": "select", "module": 3})
    player.tick(1.0)
    player.handle({"do": "step", "by": 1})
    _, _, selected = early.last(n)
    assert (selected[3] != colours[3]).any()

    late = Watch(player)
    assert len(late.outlines) == len(late.frames) == 1
    early.leave()
    count = len(early.frames)
    player.handle({"do": "seek", "frame": 10})
    assert len(early.frames) == count
    assert late.last(n)[0][0] == 10.0


def test_a_narrow_window_is_looked_at_from_farther(
    server: viser.ViserServer, timeline_path: Path
) -> None:
    film = Film(timeline_path)
    far: list[float] = []
    for aspect in (2.0, 0.5):
        player = Player(server, lambda: film)
        watch = Watch(player)
        player.handle({"do": "set", "aspect": aspect})
        player.tick(0.0)
        head = watch.last(len(film.chain))[0]
        far.append(float(np.linalg.norm(head[1:4] - head[4:7])))
    assert far[1] > 1.3 * far[0]
