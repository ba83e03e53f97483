"""``foldback verify``: a second look at a plan, from its files alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from planner.errors import InputError, TimelineError
from planner.request import Request
from planner.verification import verify as verify_files
from server.command_inputs import refuse


def verify(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="What `fold` has written.")],
    module_size: Annotated[
        str | None, typer.Option(metavar="FLOAT", help="Another size than the plan's own.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object as the last line.")
    ] = False,
) -> None:
    """Check a plan anew, by exact kinematics and by a replay in plain MuJoCo."""
    try:
        request = Request.of(module_size=module_size)
        request.check()
        found = verify_files(directory, module_size=request.module_size)
    except InputError as error:
        refuse(error, as_json)
    except TimelineError as error:
        refuse(InputError("no-timeline", str(error)), as_json)
    if as_json:
        print(json.dumps(found.as_dict()), flush=True)
    else:
        console = Console(soft_wrap=True, highlight=False)
        for line in found.problems or (found.certificate.verdict,):
            console.print(line, markup=False)
        if found.replay is not None:
            console.print(
                f"plain MuJoCo, {found.replay.frames} configurations: poses agree to "
                f"{found.replay.pose_difference:.1g} pitch, deepest overlap "
                f"{found.replay.overlap:.2g} pitch"
            )
    if not found.verified:
        raise typer.Exit(3)
