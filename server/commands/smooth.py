"""``foldback smooth``: a verified plan made shorter and quieter, without a service."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from planner.errors import InputError
from planner.plan import Plan
from planner.request import Request
from planner.smooth_plan import write_smooth
from planner.stages import STAGES, run_stage
from server.command_inputs import make_directory, refuse
from server.commands.fold import compute, show
from server.smoothing_words import note_of, rows_of


def smooth(
    fold: Annotated[Path, typer.Argument(metavar="DIR", help="What `fold` has written.")],
    out: Annotated[Path, typer.Option(help="Directory for the plan; made if it is not there.")],
    seed: Annotated[
        str, typer.Option(metavar="INTEGER", help="What randomness starts from.")
    ] = "0",
    module_size: Annotated[
        str | None,
        typer.Option(metavar="FLOAT", help="Size at which to verify, if not the plan's own."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object as the last line.")
    ] = False,
) -> None:
    """Make a folding shorter and quieter, as clear as before; exits as `fold` does."""
    try:
        request = Request.of(seed=seed, module_size=module_size)
        request.check()
        plan = Plan.load(fold / "plan.npz")
        make_directory(out)
        if out.samefile(fold):
            raise InputError(
                "smooth-in-place",
                f"got {out} for the smoothed plan, which holds the recorded one; expected another "
                "directory.",
            )
        write_smooth(out, plan, seed=request.seed, module_size=request.module_size)
        run_stage(STAGES[0], out)
    except InputError as error:
        refuse(error, as_json)
    summary = compute(out, 1, explode="Smoothing")
    if as_json:
        print(json.dumps(summary), flush=True)
    else:
        show(summary, out)
        compare(summary)
    raise typer.Exit(0 if summary["status"] == "verified" else 3)


def compare(summary: dict[str, object]) -> None:
    """Prints what smoothing has changed."""
    smoothing = summary["smoothing"]
    assert isinstance(smoothing, dict)
    table = Table("", box=None, pad_edge=False)
    for heading in ("Before", "After", "Ratio"):
        table.add_column(heading, justify="right")
    for told in rows_of(smoothing):
        table.add_row(told.label, told.before, told.after, told.ratio)
    Console().print()
    Console().print(table)
    Console().print(note_of(smoothing))
