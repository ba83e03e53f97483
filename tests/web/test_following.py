from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import viser
from viser import _messages as messages

from tests.web.test_camera import seen
from web.camera import WIDE, View, angles_of, framing
from web.film import Film
from web.following import Following
from web.scene import Scene


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def camera(server: viser.ViserServer) -> View:
    """Where all clients have been told to look from."""
    found = server._websock_server.get_message_buffer().message_from_id.values()
    position = np.array(
        next(m.position for m in found if isinstance(m, messages.SetCameraPositionMessage))
    )
    target = np.array(
        next(m.look_at for m in found if isinstance(m, messages.SetCameraLookAtMessage))
    )
    azimuth, elevation = angles_of(position, target)
    return View(
        target=target,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        distance=float(np.linalg.norm(position - target)),
    )


def test_nothing_is_ever_cut_off(server: viser.ViserServer, timeline_path: Path) -> None:
    film = Film(timeline_path)
    scene = Scene(server, film.chain)
    following = Following(server, film, scene)
    # Playing at once through all, then leaps as somebody scrubs.
    for frame in (*range(0, 200, 5), 0, 100, 0, 199, 90):
        shown = film.snapshot(frame)
        following.aim(shown)
        following.move(1 / 30, shown)
        spots = seen(scene.points(shown), camera(server), WIDE)
        assert np.abs(spots).max() <= 1.0 + 1e-6


def test_it_rests_with_room_to_spare(server: viser.ViserServer, timeline_path: Path) -> None:
    film = Film(timeline_path)
    scene = Scene(server, film.chain)
    following = Following(server, film, scene)
    for frame in (0, 60, 99, 130):
        shown = film.snapshot(frame)
        following.aim(shown)
        steps = 0
        while following.move(1 / 30, shown):
            steps += 1
            assert steps < 300, "the camera never rests"
        spots = seen(scene.points(shown), camera(server), WIDE)
        assert 0.45 < np.abs(spots).max() < 0.96


def test_turning_never_rests(server: viser.ViserServer, timeline_path: Path) -> None:
    film = Film(timeline_path)
    following = Following(server, film, Scene(server, film.chain))
    shown = film.snapshot(0)
    following.aim(shown)
    before = camera(server).azimuth_rad
    for _ in range(30):
        assert following.move(1 / 30, shown, turn=True)
    assert camera(server).azimuth_rad > before + 0.02


def test_both_ends_of_a_whole_film_fill_the_window(
    server: viser.ViserServer, timeline_path: Path
) -> None:
    film = Film(timeline_path)
    scene = Scene(server, film.chain)
    following = Following(server, film, scene)
    for frame in (0, len(film) - 1):
        shown = film.snapshot(frame)
        following.aim(shown)
        while following.move(1 / 30, shown):
            pass
        exact = framing(scene.points(shown), radius=scene.radius)
        found = camera(server)
        assert found.target == pytest.approx(exact.target, abs=0.05)
        assert found.distance == pytest.approx(exact.distance, rel=0.02)
