"""``foldback module``: check a module file, or read a module out of a URDF file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from foldback.cli.inputs import bytes_of, refuse
from foldback.cli.options import AsJson
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_checks import check_module, module_notes
from foldback.planner.chain.module_file import read_module
from foldback.planner.errors import InputError
from foldback.planner.readers.own_module import read_module_file
from foldback.planner.readers.urdf_module import read_urdf


def module(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A module file, or a URDF file with two links and the joint between them.",
        ),
    ],
    mesh: Annotated[
        list[Path] | None,
        typer.Option(help="A collision mesh that the URDF file names; repeatable."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Module file to write, for example from a URDF file.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a module for faults, or read a module out of a URDF file.

    Exits with 0 if the module has no faults, and with 2 otherwise.
    """
    try:
        checked = _read(source, mesh or [])
    except InputError as error:
        refuse(error, as_json)
    if out is not None:
        text = json.dumps(checked.document, indent=1, ensure_ascii=False)
        out.write_text(f"{text}\n", encoding="utf-8")
    notes = module_notes(checked)
    if as_json:
        print(json.dumps({"status": "checked", "name": checked.name, "notes": notes}))
        return
    console = Console(soft_wrap=True, highlight=False)
    pieces, hinges = len(checked.pieces), checked.hinges_per_joint
    console.print(
        f"The module {checked.name} has no faults: {pieces} "
        f"piece{'' if pieces == 1 else 's'}, {hinges} hinge"
        f"{'' if hinges == 1 else 's'} in each joint.",
        markup=False,
    )
    for note in notes:
        console.print(note, markup=False)


def _read(source: Path, meshes: list[Path]) -> Module:
    """Return the module of a file, without faults."""
    data = bytes_of(source)
    if data.lstrip()[:1] != b"<":
        return read_module_file(data)
    module = read_module(read_urdf(data, {path.name: bytes_of(path) for path in meshes}))
    check_module(module)
    return module
