"""Makes sure of an OpenGL that draws without a screen, for the tests of movies; says which.

One that is there is taken; else Debian's packages are installed when this is root on a Debian. When
nothing works it says so and fails: tests of movies are never skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys

from tests.debian import install

BACKENDS = ("egl", "osmesa")
PACKAGES = ("libegl1", "libgl1", "libgl1-mesa-dri")


class NoUsableGLError(RuntimeError):
    """There is no OpenGL, and none could be got."""


def draws(backend: str) -> bool:
    """Whether a window can be opened with a backend; tried in a process of its own."""
    code = f"from mujoco.{backend} import GLContext; GLContext(64, 64).make_current()"
    answer = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "MUJOCO_GL": backend},
        capture_output=True,
        timeout=120,
        check=False,
    )
    return answer.returncode == 0


def find() -> str | None:
    """The first backend that draws, or None."""
    return next((backend for backend in BACKENDS if draws(backend)), None)


def ensure() -> str:
    """A backend that draws, got first when there is none.

    Raises:
        NoUsableGLError: Saying what to do.
    """
    if found := find():
        return found
    if install(*PACKAGES) and (found := find()):
        return found
    raise NoUsableGLError(
        "The tests of movies need an OpenGL that draws without a screen; found none. Install the "
        f"packages {', '.join(PACKAGES)}."
    )


if __name__ == "__main__":
    try:
        print(f"OpenGL for the tests of movies: {ensure()}")
    except NoUsableGLError as error:
        sys.exit(str(error))
