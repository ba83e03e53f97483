"""Following: the camera of one visitor's scene, led so that the whole chain stays in view."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import viser

from web.camera import (
    ELEVATION_RAD,
    TURN_RAD_S,
    WIDE,
    Follower,
    View,
    angles_of,
    blended,
    distance_needed,
    framing,
)
from web.film import Film, Snapshot
from web.scene import Scene

GOAL_EVERY: Final = 12
GOALS_ASIDE: Final = 4
GOAL_SPREAD: Final = 1.8
MOST_GOALS: Final = 4000
ROOM: Final = 1.08
"""How much farther than needed the camera stays, so that nothing touches the edge."""
STEEPEST_RAD: Final = 1.2


class Following:
    """Looks ahead and back along the film, so that the camera moves evenly and in time."""

    def __init__(self, server: viser.ViserServer, film: Film, scene: Scene) -> None:
        self._server = server
        self._film = film
        self._scene = scene
        self._follower = Follower()
        self._aspect = WIDE
        self._direction: tuple[float, float] | None = None
        self._goals: dict[object, View] = {}

    @property
    def view(self) -> View | None:
        """Where the camera is."""
        return self._follower.view

    def window(self, aspect: float) -> None:
        """Frames for a window of that width by height, until a browser connects with its own."""
        if not self._server.get_clients():
            self._aspect = aspect
            self._follower = Follower()

    def begin(self, client: viser.ClientHandle) -> None:
        """Jumps to where the camera should be, for a browser that has just connected."""
        self._aspect = _aspect(client) or WIDE
        self._follower = Follower()

    def aim(self, shown: Snapshot, *, turn: bool = False) -> None:
        """Sets where the camera should go to show a snapshot."""
        azimuth = None
        if turn and self._follower.view is not None:
            azimuth = self._follower.view.azimuth_rad
        goal = self._framing(shown, azimuth)
        here = shown.frame / GOAL_EVERY
        end = max(len(self._film) - 1, 0) / GOAL_EVERY
        last = int(end)
        # Towards both ends of a whole film it looks less far, and at rest there it frames exactly.
        reach = GOALS_ASIDE if self._film.growing else min(GOALS_ASIDE, here, end - here)
        low, high = round(here) - GOALS_ASIDE, round(here) + GOALS_ASIDE
        around = range(max(low, 0), min(high, last) + 1)
        if around and reach > 1e-6 and not turn:
            weights = np.exp(-(((np.array(around) - here) / reach * GOAL_SPREAD) ** 2))
            views = [goal, *(self._goal(k) for k in around)]
            goal = blended(views, np.concatenate([[1.0], weights]), nearest=goal)
        goal = replace(goal, distance=max(goal.distance, ROOM * self._needed(shown, goal)))
        first = self._follower.view is None
        self._follower.aim(goal, at_once=first)
        if first:
            self._scene.look(goal)

    def move(self, seconds: float, shown: Snapshot, *, turn: bool = False) -> bool:
        """Glides on for some time; True while the camera moves."""
        if self._window_changed():
            self.aim(shown, turn=turn)
        view = self._follower.view
        if turn and view is not None:
            spun = replace(view, azimuth_rad=view.azimuth_rad + TURN_RAD_S * seconds)
            self._follower.view = spun
            self.aim(shown, turn=True)
        moved = self._follower.move(seconds) or turn
        view = self._follower.view
        if moved and view is not None:
            least = self._needed(shown, view)
            if view.distance < least:
                self._follower.view = view = replace(view, distance=least)
            self._scene.look(view)
        return moved

    def take_over(self) -> None:
        """Goes on from where the visitor has turned the camera, and keeps that direction."""
        for client in self._server.get_clients().values():
            position, target = np.array(client.camera.position), np.array(client.camera.look_at)
            azimuth, elevation = angles_of(position, target)
            self._direction = (azimuth, float(np.clip(elevation, -STEEPEST_RAD, STEEPEST_RAD)))
            self._follower.view = View(
                target=target,
                azimuth_rad=azimuth,
                elevation_rad=elevation,
                distance=float(np.linalg.norm(position - target)),
            )

    def _needed(self, shown: Snapshot, view: View) -> float:
        points = self._scene.points(shown)
        return distance_needed(points, view, radius=self._scene.radius, aspect=self._aspect)

    def _window_changed(self) -> bool:
        for client in self._server.get_clients().values():
            aspect = _aspect(client)
            if aspect > 0 and aspect != self._aspect:
                self._aspect = aspect
                return True
        return False

    def _goal(self, index: int) -> View:
        key = (index, self._aspect, self._direction, self._film.version)
        found = self._goals.get(key)
        if found is None:
            if len(self._goals) > MOST_GOALS:
                self._goals.clear()
            found = self._framing(self._film.snapshot(float(index * GOAL_EVERY)), None)
            self._goals[key] = found
        return found

    def _framing(self, snapshot: Snapshot, azimuth: float | None) -> View:
        direction, elevation = self._direction or (None, ELEVATION_RAD)
        return framing(
            self._scene.points(snapshot),
            radius=self._scene.radius,
            aspect=self._aspect,
            azimuth_rad=direction if azimuth is None else azimuth,
            elevation_rad=elevation,
        )


def _aspect(client: viser.ClientHandle) -> float:
    return round(float(client.camera.aspect), 3)
