"""Runner: the child processes in which a worker computes its folds."""

from __future__ import annotations

import threading

from foldback.planner.progress import COMPILING
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
        self._fork_server = ForkServer(["stages"], warm=settings.prewarm, directory=settings.root)
        self._children = Children("stages", ChildLimits.of(settings), self._fork_server)
        self._stopping = threading.Event()

    def prewarm(self) -> None:
        """Load libraries and kernels for the first fold, unless the settings forbid it."""
        if self._settings.prewarm:
            self._fork_server.start()

    def compilation(self) -> float | None:
        """Return the compiled fraction of the kernels, 0 to 1; None unless they are compiling.

        It is 0 while the fork server starts, because it is not yet known if kernels must compile.
        """
        message = self._fork_server.told
        if message is None:
            return 0.0 if self._fork_server.starting else None
        return float(message["fraction"]) if message["message"] == COMPILING else None

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
