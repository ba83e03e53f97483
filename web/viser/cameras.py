"""Cameras of all clients of a viser server, which keep the chain in view."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from foldback.web.pictures.camera import ELEVATION_RAD, framing

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]


class Cameras:
    """Cameras that show the whole chain, each from the direction that its client chose.

    Attributes:
        following: True if they follow the chain.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self.following = True
        self._server = server
        self._lock = threading.Lock()
        self._points: Array | None = None
        self._radius = 1.0
        self._aspects: dict[int, float] = {}
        server.on_client_connect(self._welcome)

        @server.on_client_disconnect
        def _(client: viser.ClientHandle) -> None:
            self._aspects.pop(client.client_id, None)

    def keep_in_view(self, points: Array, radius: float) -> None:
        """Move all cameras, if they follow.

        Args:
            points: (m, 3) points to keep in view, in the scene's units.
            radius: Radius of a module around its centre.
        """
        if not self.following:
            return
        with self._lock:
            self._points, self._radius = points, radius
            view = framing(points, radius=radius)
            self._server.initial_camera.position = view.position
            self._server.initial_camera.look_at = view.target
            for client in self._server.get_clients().values():
                if client.client_id not in self._aspects:  # it connected before anything was shown
                    self._look(client)
                    continue
                x, y, z = client.camera.position - client.camera.look_at
                azimuth, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
                self._look(client, float(azimuth), float(elevation))

    def _welcome(self, client: viser.ClientHandle) -> None:
        """Aim a new client's camera, and again whenever its window's aspect ratio changes."""

        def fit(camera: viser.CameraHandle) -> None:
            with self._lock:
                if self.following and camera.aspect != self._aspects.get(client.client_id):
                    self._look(client)

        client.camera.on_update(fit)
        fit(client.camera)

    def _look(
        self,
        client: viser.ClientHandle,
        azimuth_rad: float | None = None,
        elevation_rad: float = ELEVATION_RAD,
    ) -> None:
        if self._points is None:
            return
        camera = client.camera
        self._aspects[client.client_id] = camera.aspect
        view = framing(
            self._points,
            radius=self._radius,
            aspect=max(camera.aspect, 0.1),
            azimuth_rad=azimuth_rad,
            elevation_rad=elevation_rad,
        )
        with client.atomic():
            camera.position = view.position
            camera.look_at = view.target
