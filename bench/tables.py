"""Tables of figures against their bars."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One measured figure.

    Attributes:
        name: What was measured.
        value: As measured.
        bar: What it should be, in words.
        met: Whether it is; None where there is no bar.
    """

    name: str
    value: str
    bar: str = ""
    met: bool | None = None


@dataclass(slots=True, kw_only=True)
class Section:
    """A part of the benchmark.

    Attributes:
        name: Its name, as ``--only`` takes it.
        figures: The figures against their bars.
        rows: All single runs, as plain values.
    """

    name: str
    figures: list[Figure] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, name: str, value: str, bar: str = "", met: bool | None = None) -> None:
        """Adds a figure."""
        judged = None if met is None else bool(met)  # comparisons of arrays are no plain ones
        self.figures.append(Figure(name=name, value=value, bar=bar, met=judged))

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "name": self.name,
            "figures": [asdict(figure) for figure in self.figures],
            "rows": self.rows,
        }

    def show(self, console: Console) -> None:
        """Prints the rows and the figures."""
        if self.rows:
            table = Table(title=f"{self.name}: runs", title_justify="left")
            for name in self.rows[0]:
                table.add_column(name, overflow="fold")
            for row in self.rows:
                table.add_row(*(_text(value) for value in row.values()))
            console.print(table)
        table = Table(title=f"{self.name}: figures", title_justify="left")
        for name in ("figure", "measured", "bar", ""):
            table.add_column(name)
        marks = {True: "met", False: "NOT MET", None: ""}
        for figure in self.figures:
            table.add_row(figure.name, figure.value, figure.bar, marks[figure.met])
        console.print(table)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write_sections(
    sections: Iterable[Section], machine: dict[str, Any], out: Path
) -> list[Section]:
    """Prints each section as soon as it is there, and writes all there are so far as JSON."""
    console = Console(width=max(160, Console().width))
    console.print(machine)
    found: list[Section] = []
    out.parent.mkdir(parents=True, exist_ok=True)
    for section in sections:
        section.show(console)
        found.append(section)
        told = [each.as_dict() for each in found]
        about = {"machine": machine, "date": time.strftime("%Y-%m-%d"), "sections": told}
        out.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    return found
