"""Sandbox: restricts a process to its working directory and its own program files."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from foldback.server.processes import landlock, seccomp
from foldback.server.processes.landlock import Allowed

OWN_PACKAGES: Final = ("foldback", "foldback.planner", "foldback.web", "foldback.server")
SYSTEM_PATHS: Final = (
    *("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin"),
    *("/etc/ld.so.cache", "/etc/ld.so.preload", "/etc/localtime", "/etc/alternatives"),
    *("/dev/urandom", "/dev/random", "/dev/zero"),
    *("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/filesystems"),
    *("/proc/sys/vm/overcommit_memory", "/sys/devices/system"),
)
"""Paths that programs and libraries of the machine read; a confined computing process keeps read
access to them."""
OPENGL_PATHS: Final = (
    *("/etc/glvnd", "/etc/egl", "/etc/drirc", "/etc/vulkan", "/etc/OpenCL", "/etc/nvidia"),
    *("/proc/driver/nvidia", "/proc/modules", "/proc/devices", "/sys"),
)
"""Paths that OpenGL drivers read; a confined computing process that draws keeps read access to
them."""
PYTHON_PATHS: Final = ("bin", "lib", "lib64", "lib32", "share", "pyvenv.cfg")
GPU_DEVICES: Final = ("/dev/dri", "/dev/kfd", "/dev/dxg")
PATH_VARIABLES: Final = (
    *("LD_LIBRARY_PATH", "IMAGEIO_FFMPEG_EXE"),
    *("__EGL_VENDOR_LIBRARY_DIRS", "__EGL_VENDOR_LIBRARY_FILENAMES", "LIBGL_DRIVERS_PATH"),
)
"""Environment variables with colon-separated paths that libraries read; a confined computing
process keeps read access to these paths."""
PACKAGE_DIRS: Final = ("site-packages", "dist-packages")
"""Names of directories that contain only installed Python packages; a confined computing
process may read them even if the service's data lie below them."""
THREAD_EXIT_S: Final = 5.0
"""Maximum time to wait for other threads to end before a computing process is confined, in s.
Landlock confines the calling thread only."""


def confine(work: Allowed, *, drawing: bool = False) -> None:
    """Confine this process, and threads that it starts later, to its files and programs.

    Restrictions that the kernel does not support are skipped; ``foldback doctor`` reports them.

    Args:
        work: Its files. Temporary files go to the first writable directory.
        drawing: True if it draws with OpenGL.
    """
    _keep_temporary_files(work.writable[0])
    end_threads()
    if landlock.version():
        landlock.restrict(_with_programs(work, drawing=drawing))
    with suppress(OSError):  # the kernel lacks seccomp, or a container forbids it
        seccomp.restrict(drawing=drawing)


def confine_thread(place: Path) -> None:
    """Confine the calling thread to one directory.

    This keeps a parser of one upload away from other uploads. It does not confine an attacker who
    has taken over the process.
    """
    _keep_temporary_files(place)
    if landlock.version():
        landlock.restrict(_with_programs(Allowed(writable=(place,)), drawing=False))


def _keep_temporary_files(place: Path) -> None:
    tempfile.tempdir = os.environ["TMPDIR"] = str(place)


def end_threads() -> None:
    """Wait for the end of all other threads, which would not be confined.

    Raises:
        RuntimeError: If other threads remain.
    """
    for thread in threading.enumerate():
        if thread is not threading.current_thread():
            thread.join(THREAD_EXIT_S)
    tasks = Path("/proc/self/task")
    deadline = time.monotonic() + THREAD_EXIT_S
    while tasks.is_dir() and (thread_count := len(list(tasks.iterdir()))) > 1:
        # After Python has joined a thread, the kernel needs another moment to end it.
        if time.monotonic() > deadline:
            raise RuntimeError(
                f"got {thread_count} threads, expected 1, because the sandbox confines only one "
                "thread."
            )
        time.sleep(0.001)


def _with_programs(work: Allowed, *, drawing: bool) -> Allowed:
    readable = [Path(place) for place in (*SYSTEM_PATHS, *(OPENGL_PATHS if drawing else ()))]
    devices = [Path("/dev/null")]
    if drawing:
        readable += _ffmpeg()
        devices += [*map(Path, GPU_DEVICES), *Path("/dev").glob("nvidia*")]
    return Allowed(
        readable=(*readable, *_programs(work), *work.readable),
        writable=(*devices, *work.writable),
    )


def _programs(work: Allowed) -> list[Path]:
    """Return the paths of Python, its packages, and this service."""
    parents = [
        Path(str(sys.modules[name].__file__)).parent for name in OWN_PACKAGES if name in sys.modules
    ]
    prefixes = {sys.prefix, sys.exec_prefix, sys.base_prefix, sys.base_exec_prefix}
    python = [Path(prefix) / part for prefix in prefixes for part in PYTHON_PATHS]
    named = [
        place for name in PATH_VARIABLES for place in os.environ.get(name, "").split(os.pathsep)
    ]
    # A checkout may contain the service's data as well, so it is not readable as a whole.
    closed = [path.resolve() for path in work.writable]
    added = [
        place
        for place in map(Path, filter(None, (*sys.path, *named)))
        if place.name in PACKAGE_DIRS or not any(p.is_relative_to(place.resolve()) for p in closed)
    ]
    return [*parents, *python, *added]


def _ffmpeg() -> list[Path]:
    """Return the paths of ffmpeg and its libraries, which may be outside of ``/usr``."""
    program = shutil.which("ffmpeg")
    if program is None:
        return []
    path = Path(program).resolve()
    return [path, *([path.parents[1] / "lib"] if path.parent.name == "bin" else [])]
