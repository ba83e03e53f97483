"""Preview: one visitor's look at a shape before it is folded.

Messages are those of ``web.player`` in kind. In: ``{"do": "show", "key": …}`` draws the report of
that key, ``{"do": "layers", "solid": true, "cells": true, "path": true}`` any of them,
``{"do": "select", "module": …}`` highlights one module, or with null none. Out: ``shown`` with the
key, ``picked`` with the module that was clicked and its cell, null for a click beside, ``viewing``
when a browser has connected to the scene, ``problem``.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import viser

from web.camera import WIDE, framing
from web.player import Listener, Message
from web.preview_scene import AZIMUTH_RAD, ELEVATION_RAD, Layers, PreviewScene

ReportSource = Callable[[str], Mapping[str, Any] | None]


class PreviewPlayer:
    """See the module's description. Safe to use from several threads."""

    def __init__(self, server: viser.ViserServer, source: ReportSource) -> None:
        self._server = server
        self._source = source
        self._lock = threading.RLock()
        self._listeners: list[Listener] = []
        self._scene = PreviewScene(server)
        self._layers = Layers()
        self._report: Mapping[str, Any] | None = None
        self._key: str | None = None
        self._connections = 0
        self._aspect = 0.0
        self._touched = False
        self._selected: int | None = None
        server.on_client_connect(self._connected)
        self._scene.on_pick(self._picked)

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Sends every message out to ``listener`` too, beginning with how things are."""
        with self._lock:
            self._listeners.append(listener)
            if self._key is not None:
                listener({"is": "shown", "key": self._key})
            if self._connections:
                listener({"is": "viewing"})

        def leave() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return leave

    def handle(self, message: Message) -> None:
        """Does what a message says; tells ``problem`` when it makes no sense."""
        with self._lock:
            try:
                self._do(message)
                self._server.flush()
            except (KeyError, TypeError, ValueError) as error:
                self._tell({"is": "problem", "detail": f"got {str(message)[:200]}: {error}"})

    def tick(self, now: float) -> None:
        """Keeps the shape in view of a window that changes, until somebody turned it."""
        del now
        with self._lock:
            if self._touched or self._report is None:
                return
            for client in self._server.get_clients().values():
                aspect = round(float(client.camera.aspect), 3)
                if aspect > 0 and aspect != self._aspect:
                    self._aspect = aspect
                    self._frame()
                    self._server.flush()
                    return

    def _do(self, message: Message) -> None:
        verb = message["do"]
        if verb == "show":
            key = message["key"]
            report = self._source(key) if isinstance(key, str) else None
            if report is None:
                raise ValueError("expected the key of a preview")
            first = self._report is None
            self._report, self._key, self._selected = report, key, None
            self._scene.show(report, self._layers)
            if first:
                self._frame()
            self._tell({"is": "shown", "key": key})
        elif verb == "layers":
            for name in ("solid", "cells", "path"):
                if name in message:
                    if not isinstance(message[name], bool):
                        raise TypeError(f"expected true or false for {name}")
                    self._layers = replace(self._layers, **{name: message[name]})
            if self._report is not None:
                self._scene.show(self._report, self._layers)
                self._scene.select(self._selected)
        elif verb == "select":
            module = message["module"]
            if module is not None and (type(module) is not int or not self._has(module)):
                raise ValueError("expected the number of a module, or null")
            self._select(module)
        elif verb == "set":
            self._touched = True
        elif verb != "ping":
            raise ValueError(f"expected a known verb, not {verb!r}")

    def _has(self, module: int) -> bool:
        return self._report is not None and 0 <= module < len(self._report["cells"])

    def _select(self, module: int | None) -> None:
        self._selected = module
        self._scene.select(module)
        cell = None if module is None or self._report is None else self._report["cells"][module]
        self._tell({"is": "picked", "module": module, "cell": cell})

    def _picked(self, module: int | None) -> None:
        with self._lock:
            self._select(module)
            self._server.flush()

    def _frame(self) -> None:
        self._scene.look(
            framing(
                self._scene.points,
                radius=self._scene.radius,
                aspect=self._aspect or WIDE,
                azimuth_rad=AZIMUTH_RAD,
                elevation_rad=ELEVATION_RAD,
                margin=(0.84, 0.76),
            )
        )

    def _connected(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._connections += 1
            self._touched = False
            self._aspect = round(float(client.camera.aspect), 3)
            if self._report is not None:
                self._frame()
            self._tell({"is": "viewing"})

    def _tell(self, message: Message) -> None:
        for listener in list(self._listeners):
            listener(message)


__all__ = ["PreviewPlayer"]
