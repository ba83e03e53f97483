"""``foldback export``: write a finished fold in the formats of other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from cli.inputs import make_directory, refuse
from cli.options import AsJson, FoldDirectory
from planner.errors import InputError
from planner.exports.export import Export
from planner.exports.formats import EXPORTS, export_named, exports_of
from planner.file_names import PLAN
from planner.files import write_whole
from planner.plan.plan import Plan


def export(
    directory: FoldDirectory,
    out: Annotated[Path, typer.Option(help="Directory for the files; created if missing.")],
    formats: Annotated[
        str | None,
        typer.Option(
            "--as",
            metavar="NAMES",
            help=f"Formats, separated by commas: {', '.join(e.name for e in EXPORTS)}. "
            "Default: all.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Export a finished fold as URDF, MCAP, an animated scene and more."""
    try:
        chosen = None if formats is None else _chosen(formats)
        plan = Plan.load(directory / PLAN)
        exports = chosen or exports_of(moving=len(plan.time_s) > 0)
        make_directory(out)
        sizes = {one.filename: _written(one, plan, out) for one in exports}
    except InputError as error:
        refuse(error, as_json)
    if as_json:
        print(json.dumps({"directory": str(out), "bytes": sizes}), flush=True)
        return
    table = Table(box=None, show_header=False, pad_edge=False)
    for one in exports:
        table.add_row(str(out / one.filename), f"{sizes[one.filename] / 1e6:.2f} MB", one.hint)
    Console(soft_wrap=True, highlight=False).print(table)


def _chosen(formats: str) -> tuple[Export, ...]:
    names = dict.fromkeys(name.strip() for name in formats.split(","))
    return tuple(export_named(name) for name in names)


def _written(one: Export, plan: Plan, out: Path) -> int:
    """Return the size of the file that was written.

    Raises:
        InputError: If the file cannot be made or written.
    """
    path = out / one.filename
    data = one.write(plan)
    try:
        write_whole(path, data)
    except OSError as error:
        raise InputError(
            "no-file", f"the file cannot be written ({error.strerror}).", where=str(path)
        ) from error
    return len(data)
