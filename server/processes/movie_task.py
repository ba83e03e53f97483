"""Movie task: renders movies in child processes, because faulty OpenGL drivers can crash them."""

from __future__ import annotations

import ctypes.util
import json
import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

from foldback.server.processes.children import Child, ChildError
from foldback.server.processes.limits import ChildLimits
from foldback.web.movies.encoding import formats

GL_LIBRARIES: Final = {"egl": "EGL", "osmesa": "OSMesa"}
"""Names of the libraries that MuJoCo loads, by the OpenGL backend."""
GL_BACKENDS: Final = tuple(GL_LIBRARIES)
GL_SETTING: Final = "MUJOCO_GL"
OFF_WORDS: Final = ("disable", "disabled", "off", "false", "0")
NO_GL: Final = (
    "The OpenGL libraries that draw without a screen are missing. Install them on the service's "
    "machine, on Debian or Ubuntu with 'apt-get install libegl1 libgl1 libgl1-mesa-dri' (or "
    "'libosmesa6')"
)
NO_FFMPEG: Final = (
    "MP4 needs ffmpeg with x264: install it (Debian: apt install ffmpeg) or run pip install "
    "'foldback[movies]'. GIF needs no other program: name a file that ends in .gif"
)


def movie_formats() -> tuple[str, ...]:
    """Return the formats in which this machine can make movies; empty if it cannot draw."""
    return formats() if _drawing_problem() is None else ()


def check_movie(format_: str) -> None:
    """Check that this machine has the programs for a movie, before a process is started.

    Raises:
        ChildError: If OpenGL (``no-gl``) or the encoder (``no-encoder``) is missing.
    """
    if (problem := _drawing_problem()) is not None:
        raise ChildError("no-gl", f"{problem}.")
    if format_ not in formats():
        raise ChildError("no-encoder", f"{NO_FFMPEG}.")


def _drawing_problem() -> str | None:
    """Return why this machine cannot draw, without a full stop; None if it may be able to."""
    if not (allowed := backends()):
        return f"Drawing is switched off by {GL_SETTING}; unset {GL_SETTING}"
    return None if any(_is_installed(GL_LIBRARIES[name]) for name in allowed) else NO_GL


@cache
def _is_installed(library: str) -> bool:
    """Return False if a library is missing; True if that is unknown, too."""
    try:
        return ctypes.util.find_library(library) is not None
    except OSError:  # the search needs a directory for temporary files
        return True


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

    Call ``check_movie`` first. Each OpenGL backend gets its own process, because a process cannot
    change its backend.

    Raises:
        InputError: If the timeline cannot be used.
        ChildError: If OpenGL (``no-gl``) or ffmpeg (``no-encoder``) is missing, or another error
            occurred.
    """
    messages: list[str] = []
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
                messages.append(str(result["reason"]))
            case "no-encoder":
                raise ChildError("no-encoder", f"{NO_FFMPEG}.")
            case code:
                raise ChildError(code, f"the movie could not be created: {result['reason']}")
    raise ChildError("no-gl", f"{NO_GL}. Reason: {'; '.join(messages)[:300]}.")


def backends() -> tuple[str, ...]:
    """Return the backends to try: the one that the operator has set, or all."""
    backend_name = os.environ.get(GL_SETTING, "").lower().strip()
    if backend_name in OFF_WORDS:
        return ()
    return (backend_name,) if backend_name in GL_BACKENDS else GL_BACKENDS
