"""Tables of measured figures and their bars."""

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
        name: Name of the measured quantity.
        value: Measured value, with its unit.
        bar: Required value, in words; empty if there is none.
        met: True if the bar is met; None if there is no bar.
    """

    name: str
    value: str
    bar: str = ""
    met: bool | None = None


@dataclass(slots=True, kw_only=True)
class Section:
    """A part of the benchmark.

    Attributes:
        name: Name of the section, as ``--only`` takes it.
        figures: Figures and their bars.
        rows: All individual runs, as plain values.
    """

    name: str
    figures: list[Figure] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, name: str, value: str, bar: str = "", is_met: bool | None = None) -> None:
        """Add a figure."""
        judged = None if is_met is None else bool(is_met)  # comparisons of arrays give numpy.bool
        self.figures.append(Figure(name=name, value=value, bar=bar, met=judged))

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "name": self.name,
            "figures": [asdict(figure) for figure in self.figures],
            "rows": self.rows,
        }

    def show(self, console: Console) -> None:
        """Print the rows and the figures."""
        if self.rows:
            grid = Table(title=f"{self.name}: runs", title_justify="left")
            for name in self.rows[0]:
                grid.add_column(name, overflow="fold")
            for row in self.rows:
                grid.add_row(*(_text(value) for value in row.values()))
            console.print(grid)
        grid = Table(title=f"{self.name}: figures", title_justify="left")
        for name in ("figure", "measured", "bar", ""):
            grid.add_column(name)
        marks = {True: "met", False: "NOT MET", None: ""}
        for figure in self.figures:
            grid.add_row(figure.name, figure.value, figure.bar, marks[figure.met])
        console.print(grid)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write_sections(
    sections: Iterable[Section], machine: dict[str, Any], out: Path
) -> list[Section]:
    """Print each section as soon as it is measured, and write all sections so far as JSON."""
    console = Console(width=max(160, Console().width))
    console.print(machine)
    measured: list[Section] = []
    out.parent.mkdir(parents=True, exist_ok=True)
    for section in sections:
        section.show(console)
        measured.append(section)
        plain = [section_so_far.as_dict() for section_so_far in measured]
        about = {"machine": machine, "date": time.strftime("%Y-%m-%d"), "sections": plain}
        out.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    return measured
