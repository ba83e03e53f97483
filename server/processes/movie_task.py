"""Movie task: renders movies in child processes, because faulty OpenGL drivers can crash them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from server.processes.children import Child, ChildError
from server.processes.limits import ChildLimits

GL_BACKENDS: Final = ("egl", "osmesa")
GL_SETTING: Final = "MUJOCO_GL"
OFF_WORDS: Final = ("disable", "disabled", "off", "false", "0")
NO_GL: Final = (
    "The OpenGL libraries that draw without a screen are missing. Install them on the service's "
    "machine, on Debian or Ubuntu with 'apt-get install libegl1 libgl1 libgl1-mesa-dri' (or "
    "'libosmesa6')"
)
NO_FFMPEG: Final = (
    "MP4 needs ffmpeg: install it (Debian: apt install ffmpeg) or run pip install "
    "'foldback[movies]'; otherwise, request a .gif"
)


def ask_for_movie(
    place: Path, wishes: Mapping[str, Any], timeline: Path, part: str, *, on_table: bool
) -> None:
    """Write the ``request.json`` that ``run_movie`` reads.

    Args:
        place: Directory for the file.
        wishes: Fields of a ``web.movies.movie.Movie``.
        timeline: The timeline's directory.
        part: Name of the movie file in ``place``.
        on_table: True if the chain folds on a table.
    """
    request = {"movie": wishes, "timeline": str(timeline), "part": part, "on_table": on_table}
    (place / "request.json").write_text(json.dumps(request))


def run_movie(
    place: Path,
    limits: ChildLimits,
    *,
    wall_s: float,
    on_progress: Callable[[dict[str, Any]], None],
    cancelled: Callable[[], bool],
) -> bool:
    """Create the movie that ``request.json`` describes; return False if cancelled.

    Each OpenGL backend gets its own process, because a process cannot change its backend.

    Raises:
        InputError: If the timeline cannot be used.
        ChildError: If OpenGL (``no-gl``) or ffmpeg (``no-encoder``) is missing, or another error
            occurred.
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
            case "no-encoder":
                raise ChildError("no-encoder", f"{NO_FFMPEG}.")
            case code:
                raise ChildError(code, f"the movie could not be created: {result['reason']}")
    if not said:
        raise ChildError("no-gl", f"Drawing is switched off by {GL_SETTING}; unset {GL_SETTING}.")
    raise ChildError("no-gl", f"{NO_GL}. Reason: {'; '.join(said)[:300]}.")


def backends() -> tuple[str, ...]:
    """Return the backends to try: the one that the operator has set, or all."""
    chosen = os.environ.get(GL_SETTING, "").lower().strip()
    if chosen in OFF_WORDS:
        return ()
    return (chosen,) if chosen in GL_BACKENDS else GL_BACKENDS
