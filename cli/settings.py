"""``foldback settings``: list the settings of ``fold --set``."""

from __future__ import annotations

import json
from dataclasses import asdict

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.options import AsJson
from foldback.planner.parameters.settings_text import NO_LIMIT
from foldback.words.settings import PAPER_ROWS, ROBOT_ROWS, SOURCE_LABELS, TABLE_ROWS


def settings(as_json: AsJson = False) -> None:
    """List the settings for `fold --set NAME=VALUE`."""
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in (*PAPER_ROWS, *ROBOT_ROWS, *TABLE_ROWS)]))
        return
    console = Console(highlight=False)
    for title, rows in (
        ("Simulated robots", ROBOT_ROWS),
        ("Folding on a table, with --world table", TABLE_ROWS),
        ("Method of the published paper, with --preset paper", PAPER_ROWS),
    ):
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for heading in ("Setting", "Default", "Values", "Meaning"):
            table.add_column(heading, no_wrap=heading == "Setting")
        for row in rows:
            value = row.default if row.default == NO_LIMIT else f"{row.default} {row.unit}".rstrip()
            table.add_row(row.name, value, row.source, row.meaning)
        console.print(table)
        console.print()
    for source, meaning in SOURCE_LABELS.items():
        console.print(f"{source}: {meaning}", markup=False)
