"""``foldback export``: write a finished fold in the formats of other programs."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.inputs import read_plan, refuse
from foldback.cli.options import AsJson, FoldDirectory
from foldback.planner.errors import InputError
from foldback.planner.exports.export import Export
from foldback.planner.exports.formats import EXPORTS, export_named, exports_of
from foldback.planner.pipeline.fold_layout import holds_fold
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.rests import rest_frames
from foldback.planner.storage.file_names import PLAN
from foldback.planner.storage.files import write_whole
from foldback.planner.storage.output_directory import replacing_listed
from foldback.planner.twist_chains.folded_chains import has_code


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
        selected = None if formats is None else _chosen(formats)
        plan = read_plan(directory)
        exports = selected or exports_of(
            moving=len(plan.time_s) > 0,
            resting=bool(rest_frames(plan.playback)),
            coded=has_code(plan.chain),
        )
        _check_directory(out, directory)
        with replacing_listed(out, sha256((directory / PLAN).read_bytes()).hexdigest()) as place:
            sizes = {
                exported.filename: _written(exported, plan, place, out) for exported in exports
            }
    except InputError as error:
        refuse(error, as_json)
    if as_json:
        print(json.dumps({"directory": str(out), "bytes": sizes}), flush=True)
        return
    table = Table(box=None, show_header=False, pad_edge=False)
    for exported in exports:
        table.add_row(
            str(out / exported.filename), f"{sizes[exported.filename] / 1e6:.2f} MB", exported.hint
        )
    console = Console(soft_wrap=True, highlight=False)
    console.print(table)
    missing = [export.name for export in EXPORTS if not export.is_available]
    if selected is None and missing:
        console.print(
            f"Left out: {', '.join(missing)}. They need packages that are not installed; install "
            "them with pip install 'foldback[exports]'.",
            markup=False,
        )


def _chosen(formats: str) -> tuple[Export, ...]:
    names = dict.fromkeys(name.strip() for name in formats.split(","))
    return tuple(export_named(name) for name in names)


def _check_directory(out: Path, directory: Path) -> None:
    """Refuse to write files of one fold into the directory of another one.

    Raises:
        InputError: ``another-fold``.
    """
    if holds_fold(out) and not out.samefile(directory):
        raise InputError(
            "another-fold",
            "got a folder with another fold for the exported files. Choose another folder.",
            where=str(out),
        )


def _written(exported: Export, plan: Plan, place: Path, out: Path) -> int:
    """Return the size of a file that was written in a place, for the directory ``out``.

    Raises:
        InputError: If the file cannot be made or written.
    """
    data = exported.write(plan)
    try:
        write_whole(place / exported.filename, data)
    except OSError as error:
        raise InputError(
            "no-file",
            f"the file cannot be written ({error.strerror}).",
            where=str(out / exported.filename),
        ) from error
    return len(data)
