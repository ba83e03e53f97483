"""Limits: resources and environment of a computing process."""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from foldback.server.settings import Settings


@dataclass(frozen=True, slots=True, kw_only=True)
class ChildLimits:
    """Resource limits and priority of one computing process.

    Attributes:
        memory_bytes: Maximum resident memory, bytes.
        cpu_s: Maximum processor time of its whole life, s.
        niceness: Niceness (POSIX).
        folders: Directories in which it processes its requests; if empty, the directory of its
            first request.
    """

    memory_bytes: int
    cpu_s: float
    niceness: int = 0
    folders: tuple[str, ...] = ()

    @classmethod
    def of(cls, settings: Settings, *, awaited: bool = False) -> ChildLimits:
        """Return the limits of the settings.

        Args:
            settings: The settings.
            awaited: True if a page waits for the result, which then has priority over folds.
        """
        niceness = settings.child_niceness
        folders = (str(settings.uploads_dir), str(settings.previews_dir))
        return cls(
            memory_bytes=settings.child_memory_bytes,
            cpu_s=settings.stage_cpu_seconds,
            niceness=min(niceness, 5) if awaited else niceness,
            folders=folders if awaited else (),
        )


READER_PROCESSES: Final = 2
"""Number of processes that read uploaded files, and equal number of those that compute previews of
shapes; one visitor uses at most one of each at a time."""
INTERACTIVE_CHILDREN: Final = 2 * READER_PROCESSES + 3
"""Number of computing processes of the web process: those that read uploads, those that compute
previews, one that computes trajectories, one that computes the figures of a fold, and one that
draws pictures."""
PR_SET_DUMPABLE: Final = 4
"""Option of prctl(2) that decides if other processes of the same user may read a process's memory
(linux/prctl.h)."""
CHILD_VARIABLES: Final = re.compile(
    r"PATH|HOME|USER|LOGNAME|LANG|LANGUAGE|LC_[A-Z]+|TZ|TMPDIR|TEMP|TMP|VIRTUAL_ENV|DISPLAY"
    r"|(PYTHON|OPENBLAS|LD|DYLD|XDG|CONDA|MUJOCO|IMAGEIO|FFMPEG|COVERAGE"
    r"|PYOPENGL|MESA|LIBGL|GALLIUM|GBM|EGL|__EGL|__GLX|CUDA|NVIDIA)_?[A-Z0-9_]*"
)
"""Matches the names of environment variables that a computing process inherits; all others are
withheld, as they may contain passwords and keys."""


def environment_of_child(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables that a computing process needs.

    It reads files of strangers, so it must not see keys of databases and storage.
    """
    return {name: value for name, value in environment.items() if CHILD_VARIABLES.fullmatch(name)}


def keep_secrets() -> None:
    """Prevent other processes of the same user from reading this one's memory.

    Otherwise a computing process could read in ``/proc`` the variables that its own environment
    lacks. New files and sockets become inaccessible to other users.
    """
    os.umask(0o077)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_DUMPABLE, 0, 0, 0, 0)


def memory_words(limit_bytes: int) -> str:
    """Return the message for a fold that exceeds its memory limit."""
    return (
        f"the fold exceeded its limit of {limit_bytes // 2**20} MiB of memory; try a smaller shape."
    )
