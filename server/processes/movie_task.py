"""Filming: makes movies in child processes, since a broken OpenGL driver may end its process."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from server.processes.children import Child, ChildError
from server.processes.limits import ChildLimits

BACKENDS: Final = ("egl", "osmesa")
GL_SETTING: Final = "MUJOCO_GL"
OFF: Final = ("disable", "disabled", "off", "false", "0")
NO_GL: Final = (
    "no OpenGL is there that draws without a screen. Install one on the machine of the service: on "
    "Debian or Ubuntu 'apt-get install libegl1 libgl1 libgl1-mesa-dri' (or 'libosmesa6')"
)


def run_movie(
    place: Path,
    limits: ChildLimits,
    *,
    wall_s: float,
    on_progress: Callable[[dict[str, Any]], None],
    cancelled: Callable[[], bool],
) -> bool:
    """Makes the movie that ``request.json`` in a directory asks for; False when cancelled.

    Each backend of OpenGL gets a process of its own: they cannot be changed within one.

    Raises:
        InputError: When the movie cannot be made of that timeline.
        ChildError: When there is no OpenGL (``no-gl``), or something went wrong.
    """
    said: list[str] = []
    for backend in backends():
        child = Child("movies", limits, environment={GL_SETTING: backend})
        try:
            result = child.call(
                backend, place, wall_s=wall_s, on_progress=on_progress, cancelled=cancelled
            )
        finally:
            child.close()
        match result["status"]:
            case "done":
                return True
            case "cancelled":
                return False
            case "no-gl":
                said.append(str(result["reason"]))
            case code:
                raise ChildError(code, f"the movie could not be made: {result['reason']}")
    found = "; ".join(said)[:300] or f"it is switched off by {GL_SETTING}"
    raise ChildError("no-gl", f"{NO_GL}. Found: {found}.")


def backends() -> tuple[str, ...]:
    """Those to try: the one that the operator has set, or all."""
    chosen = os.environ.get(GL_SETTING, "").lower().strip()
    if chosen in OFF:
        return ()
    return (chosen,) if chosen in BACKENDS else BACKENDS
