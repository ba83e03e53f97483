"""Open files: the numbers of connections that the limit of open files carries."""

from __future__ import annotations

import resource
from dataclasses import dataclass
from typing import Final, Self

from foldback.server.settings import Settings

OTHER_FILES: Final = 192
"""Number of file descriptors that the web process needs besides one for each connection: about 70
when it is idle, 64 for spare connections that reach ``/health`` only, and those of uploads."""
BACKLOG: Final = 2048
"""Number of new connections that wait for the web process, and that it accepts at once, if there
are enough file descriptors."""
MIN_BACKLOG: Final = 32
"""The same number if there are few file descriptors. Connections that are accepted at once take
some before they can be refused."""
MIN_CONNECTIONS: Final = 16
"""Minimum number of connections, also if there are too few file descriptors for them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenFiles:
    """Numbers of connections, as far as the limit of open files permits.

    Attributes:
        files: The limit of open files.
        connections: Maximum number of open connections.
        backlog: Number of connections that may wait to be accepted.
    """

    files: int
    connections: int
    backlog: int

    @classmethod
    def of(cls, settings: Settings, hard: int) -> Self:
        """Return the numbers for a hard limit of open files."""
        needed = settings.max_connections + OTHER_FILES + BACKLOG
        if hard == resource.RLIM_INFINITY or hard >= needed:
            return cls(files=needed, connections=settings.max_connections, backlog=BACKLOG)
        max_connections = max(hard - OTHER_FILES - MIN_BACKLOG, MIN_CONNECTIONS)
        connections = min(settings.max_connections, max_connections)
        return cls(files=hard, connections=connections, backlog=MIN_BACKLOG)

    @classmethod
    def take(cls, settings: Settings) -> Self:
        """Raise this process's limit of open files as far as permitted; return the numbers."""
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        budget = cls.of(settings, hard)
        if soft != resource.RLIM_INFINITY and soft < budget.files:
            resource.setrlimit(resource.RLIMIT_NOFILE, (budget.files, hard))
        return budget
