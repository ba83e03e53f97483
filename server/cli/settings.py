"""``foldback settings``: what ``fold --preset paper --set`` takes."""

from __future__ import annotations

import json
from dataclasses import asdict

import typer
from rich.console import Console
from rich.table import Table

from planner.pipeline.paper_settings import NO_LIMIT
from server.cli.options import AsJson
from server.pages.setting_words import ROWS, SOURCES


def settings(as_json: AsJson = False) -> None:
    """List the published method's settings, for `fold --preset paper --set NAME=NUMBER`."""
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in ROWS]))
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("Setting", "Default", "Value is", "Meaning"):
        table.add_column(heading, no_wrap=heading == "Setting")
    for row in ROWS:
        value = row.default if row.default == NO_LIMIT else f"{row.default} {row.unit}".rstrip()
        table.add_row(row.name, value, row.source, row.meaning)
    console = Console(highlight=False)
    console.print(table)
    console.print()
    for source, meaning in SOURCES.items():
        console.print(f"{source}: {meaning}", markup=False)
