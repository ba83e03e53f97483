"""``foldback worker``: starts an additional worker."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from foldback.server.ops.startup_errors import settings_of
from foldback.server.processes.limits import keep_secrets


def worker(
    data_dir: Annotated[Path | None, typer.Option(help="Data directory of the service.")] = None,
) -> None:
    """Compute folds for a service, using the service's data directory or database."""
    from foldback.server.jobs.worker import work

    keep_secrets()
    work(settings_of(data_dir=data_dir))
