"""``foldback doctor``: checks of the service's requirements, with remedies."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from foldback.server.ops.logs import escaped


def doctor(
    host: Annotated[str | None, typer.Option(help="Address to listen on.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on.")] = None,
    data_dir: Annotated[Path | None, typer.Option(help="Data directory of the service.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Check that this machine meets the requirements; exits with 1 if there is a problem."""
    from foldback.server.doctor.doctor import examined

    results = examined({"host": host, "port": port, "data_dir": data_dir})
    if as_json:
        typer.echo(json.dumps([asdict(finding) for finding in results], indent=2))
    else:
        for finding in results:
            typer.echo(escaped(finding.line))
    if any(finding.verdict == "problem" for finding in results):
        raise typer.Exit(1)
