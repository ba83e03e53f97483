"""Runner: the child processes in which a worker computes its folds."""

from __future__ import annotations

import threading

from foldback.server.jobs.execution import Execution
from foldback.server.jobs.queue import FoldClaim
from foldback.server.processes.children import Children
from foldback.server.processes.fork_server import ForkServer
from foldback.server.processes.limits import ChildLimits
from foldback.server.settings import Settings
from foldback.server.store.folds import Store


class Runner:
    """Child processes of running folds, one for each.

    Args:
        settings: The settings.
        store: Rows and files.
    """

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._fork_server = ForkServer(["stages"])
        self._children = Children("stages", ChildLimits.of(settings), self._fork_server)
        self._stopping = threading.Event()

    def prewarm(self) -> None:
        """Load the libraries for the first fold, unless the settings forbid it."""
        if self._settings.prewarm:
            self._fork_server.start()

    def execution(self, claim: FoldClaim) -> Execution:
        """Return the execution of a claimed fold."""
        return Execution(
            claim,
            store=self._store,
            children=self._children,
            stage_seconds=self._settings.stage_seconds,
            stopping=self._stopping,
        )

    def stop(self) -> None:
        """Stop all children; their folds continue elsewhere or after the next start."""
        self._stopping.set()
        self._children.close()
        self._fork_server.close()
