"""Map of a sweep: shares of verified folds as a picture, and a page whose cells lead to rows.

A cell is filled in proportion to the verified folds, from below: first those that were simulated,
then those verified by kinematics only. A cross marks a cell without verified folds, so that the
picture is readable without colours.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.storage.files import write_whole
from foldback.planner.sweeps.case import Row, Value
from foldback.planner.sweeps.cases import PLANS_DIR
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.table import column_names

CELL_PX: Final = 24
"""Width and height of a cell with its margin, in SVG pixels."""
LABELS_PX: Final = 76
"""Least width of the column with the names of rows, in SVG pixels."""
LETTER_PX: Final = 7
"""Width of a letter of a name, in SVG pixels."""
GAP_PX: Final = 18
"""Gap between two fields, in SVG pixels."""
FIELDS_PER_ROW: Final = 4
"""Maximum number of fields side by side."""
HEAD_PX: Final = 64
"""Height of the heading of a field, in SVG pixels: its name and the slanted names of columns."""
MAX_LABEL_CHARS: Final = 28
MAX_COLUMN_CHARS: Final = 9
"""Maximum numbers of characters of the names of rows and columns; longer ones are cut off."""
MAX_ROWS: Final = 300
MAX_COLUMNS: Final = 60
"""Maximum numbers of rows and columns of a field; further ones are left out."""
NOT_COUNTED: Final = "refused: strategy-differs"
"""Verdict on folds by a method that is not for their kind of chain; the map leaves them out."""
PAGE: Final = "index.html"
PLAYERS_DIR: Final = "players"
"""Name of the directory, in that of a sweep, with pages that play kept plans."""
PAGE_OF_PLAN: Final = f"{PLAYERS_DIR}/folds/{{}}.html"
"""Path, from the directory of a sweep, of the page that plays the plan with a key."""
PICTURE: Final = "map.svg"
MAP_PERIOD_S: Final = 30
"""Time between two versions of the page while a sweep runs, s."""
MAX_PAGE_ROWS: Final = 20_000
"""Maximum number of rows of the page, those that are not verified first; the tables have all."""
HIDDEN_COLUMNS: Final = frozenset(
    {"key", "shape_digest", "planner_digest", "verified", "started_at"}
)
"""Columns that the page leaves out."""
STYLE: Final = """
svg { background: #faf9f7; }
text { fill: #2a2e35; font: 12px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
.name { font-weight: 600; font-size: 13px; }
.size { font-size: 10.5px; fill: #545a63; }
.ground { fill: #faf9f7; }
.cell { fill: #f3dcc0; }
.good { fill: #1f5f9e; }
.kinematics { fill: #a5c6e6; stroke: #1f5f9e; stroke-width: 1.5; }
.none { fill: none; stroke: #c9c5bc; }
.cross { stroke: #9a4a00; stroke-width: 2; }
@media (prefers-color-scheme: dark) {
  svg { background: #15181d; }
  text { fill: #eceef1; }
  .size { fill: #a3aab4; }
  .ground { fill: #15181d; }
  .cell { fill: #4a3620; }
  .good { fill: #62a8ea; }
  .kinematics { fill: #24425f; stroke: #62a8ea; }
  .none { stroke: #3a414b; }
  .cross { stroke: #ffb35c; }
}
"""
"""Styles of the picture, for light and dark pages."""

Place = tuple[Value, Value, Value]
"""Values of a cell: those of its field, row and column."""


@dataclass(frozen=True, slots=True)
class Share:
    """Number of folds of a cell, and numbers of those verified in two ways."""

    simulated: int = 0
    by_kinematics: int = 0
    folds: int = 0

    def with_row(self, row: Row) -> Share:
        """Return the share with another fold."""
        simulated, verified = bool(row.get("simulated")), bool(row.get("verified"))
        return Share(
            self.simulated + (verified and simulated),
            self.by_kinematics + (verified and not simulated),
            self.folds + 1,
        )

    @property
    def text(self) -> str:
        """The numbers in words."""
        if not self.by_kinematics:
            suffix = " (simulated)" if self.simulated else ""
            return f"{self.simulated} of {self.folds} verified{suffix}"
        if not self.simulated:
            return f"{self.by_kinematics} of {self.folds} verified (kinematics only)"
        return (
            f"{self.simulated} of {self.folds} verified (simulated), "
            f"{self.by_kinematics} (kinematics only)"
        )


@dataclass(frozen=True, slots=True)
class SweepMap:
    """Shares of verified folds.

    Attributes:
        axes: Columns of the table: those of fields, rows and columns of the map.
        values: Values of each axis, in their order.
        shares: Shares by values of the axes; no entry where nothing was folded.
    """

    axes: tuple[str, str, str]
    values: tuple[list[Value], list[Value], list[Value]]
    shares: dict[Place, Share]

    @classmethod
    def of(cls, spec: SweepSpec, rows: Sequence[Row]) -> SweepMap:
        """Return the map of a sweep.

        Raises:
            InputError: ``unknown-column``.
        """
        axes = spec.map_axes()
        columns = column_names(rows)
        for axis in axes if rows else ():
            if axis not in columns:
                near = get_close_matches(axis, columns, n=3, cutoff=0.4) or columns
                raise InputError(
                    "unknown-column",
                    f"got the unknown column {axis!r} for the map, expected {' or '.join(near)}.",
                )
        shares: dict[Place, Share] = {}
        for row in rows:
            if row.get("verdict") != NOT_COUNTED:
                place = place_of(row, axes)
                shares[place] = shares.get(place, Share()).with_row(row)
        stated = {"method": [*spec.methods], "group": [*spec.shapes]}
        limits = (MAX_COLUMNS, MAX_ROWS, MAX_COLUMNS)
        values: list[list[Value]] = [
            [*stated.get(axis, ())] or sorted({place[k] for place in shares}, key=_order)
            for k, axis in enumerate(axes)
        ]
        cut = [entries[:limit] for entries, limit in zip(values, limits, strict=True)]
        return cls(axes, (cut[0], cut[1], cut[2]), shares)

    def picture(self, *, links: bool = False) -> str:
        """Return the map as SVG: a field for each value of the first axis.

        Args:
            links: True to link each cell to ``#cell-…`` with its number in ``shares``.
        """
        fields, rows, columns = self.values
        labels = LETTER_PX * min(MAX_LABEL_CHARS, max((len(_text(row)) for row in rows), default=0))
        labels = max(LABELS_PX, labels + 20)
        name_px = max((len(_text(name)) for name in fields), default=0) * (LETTER_PX + 1)
        wide = max(len(columns) * CELL_PX, name_px) + GAP_PX
        tall = HEAD_PX + len(rows) * CELL_PX + GAP_PX
        # The key follows the last field, in the same row if there is room.
        across = min(FIELDS_PER_ROW, len(fields) + 1)
        width = labels + across * wide + 8 + max(0, 170 - wide)
        key_tall = HEAD_PX + 5 * (CELL_PX + 4) - 4
        last = len(fields) // across
        bottom = max(tall if len(fields) % across else 0, key_tall)
        height = last * tall + bottom + 8
        by, row_axis, column_axis = map(escape, self.axes)
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" role="img">',
            f"<title>Share of verified folds by {by}, {row_axis} and {column_axis}</title>",
            f"<style>{STYLE}</style>",
            f'<rect class="ground" width="{width}" height="{height}"/>',
        ]
        for number, name in enumerate(fields):
            x, y = labels + number % across * wide, number // across * tall
            parts.append(f'<text class="name" x="{x}" y="{y + 20}">{escape(_text(name))}</text>')
            parts += self._field(name, x, y + HEAD_PX, links=links)
            if number % across == 0:
                parts += [
                    f'<text x="{labels - 8}" y="{y + HEAD_PX + k * CELL_PX + 16}" '
                    f'text-anchor="end">{_label(row, MAX_LABEL_CHARS)}</text>'
                    for k, row in enumerate(rows)
                ]
        parts.append(_key(labels + len(fields) % across * wide, last * tall + HEAD_PX))
        return "\n".join([*parts, "</svg>\n"])

    def _field(self, name: Value, x: int, y: int, *, links: bool) -> Iterable[str]:
        _, rows, columns = self.values
        numbers = {place: k for k, place in enumerate(self.shares)}
        for k, column in enumerate(columns):
            x0 = x + k * CELL_PX
            label = _label(column, MAX_COLUMN_CHARS)
            yield (
                f'<text class="size" transform="translate({x0 + 13} {y - 6}) rotate(-50)">'
                f"{label}</text>"
            )
            for index, row in enumerate(rows):
                place = name, row, column
                share = self.shares.get(place)
                cell = _cell(share, x0, y + index * CELL_PX)
                words = "not run" if share is None else share.text
                group = f"<g><title>{words}</title>{cell}</g>"
                if links and share is not None:
                    words, number = ", ".join(map(_text, place)) + f": {words}", numbers[place]
                    group = (
                        f'<a id="cell-{number}" href="#cell-{number}" aria-label="{escape(words)}">'
                        f"<title>{escape(words)}</title>{cell}</a>"
                    )
                yield group


def write_map(
    directory: Path, spec: SweepSpec, rows: Mapping[str, Row], left: int, *, is_running: bool
) -> None:
    """Write the map as a picture and as a page with the rows of the newest planner.

    Args:
        directory: Directory of the sweep.
        spec: Its specification.
        rows: Newest rows by key, in the order in which they were written.
        left: Number of folds that are still to be computed.
        is_running: True while they are computed.

    Raises:
        InputError: ``unknown-column``, if an axis is none of the table.
    """
    newest = [*rows.values()][-1]["planner_digest"] if rows else None
    current = [row for row in rows.values() if row["planner_digest"] == newest]
    sweep_map = SweepMap.of(spec, current)
    numbers = {place: number for number, place in enumerate(sweep_map.shares)}
    current.sort(key=lambda row: bool(row.get("verified")))
    shown = current[:MAX_PAGE_ROWS]
    columns = [
        name
        for name in column_names(shown)
        if name == "verdict"
        or (name not in HIDDEN_COLUMNS and len({row.get(name) for row in shown}) > 1)
    ]
    keys = {str(row["key"]) for row in shown}
    plan_keys = keys & {path.name for path in directory.glob(f"{PLANS_DIR}/*")}
    played = {path.stem for path in directory.glob(PAGE_OF_PLAN.format("*"))}
    data = {
        "columns": columns,
        "cells": [", ".join(map(_text, place)) for place in sweep_map.shares],
        "rows": [
            [row["key"], numbers.get(place_of(row, sweep_map.axes), -1), bool(row.get("verified"))]
            + [row.get(name) for name in columns]
            for row in shown
        ],
        "plans": {key: PAGE_OF_PLAN.format(key) if key in played else "" for key in plan_keys},
    }
    verified = sum(bool(row.get("verified")) for row in current)
    summary = f"{len(current)} folds computed, {verified} verified"
    summary += f", {left} left." if left else "."
    if is_running:
        summary += f" This page shows new ones every {MAP_PERIOD_S} s."
    if len(shown) < len(current):
        summary += f" This page has {len(shown)} of the rows; the tables have all."
    page = Template(
        files(__package__ or "").joinpath("page.html").read_text(encoding="utf-8")
    ).substitute(
        title=escape(directory.resolve().name),
        summary=summary,
        refresh=f'<meta http-equiv="refresh" content="{MAP_PERIOD_S}">' if is_running else "",
        picture=sweep_map.picture(links=True),
        # A name with </script> must not end the element.
        data=json.dumps(data).replace("<", "\\u003c"),
    )
    write_whole(directory / PAGE, page.encode())
    write_whole(directory / PICTURE, sweep_map.picture().encode())


def place_of(row: Row, axes: tuple[str, str, str]) -> Place:
    """Return the values of the cell that a row belongs to."""
    return row.get(axes[0]), row.get(axes[1]), row.get(axes[2])


def _order(value: Value) -> tuple[bool, float, str]:
    """Return the key by which values are sorted: numbers first, then texts."""
    is_number = isinstance(value, int | float)
    return not is_number, float(value) if is_number else 0.0, str(value)


def _text(value: Value) -> str:
    return "–" if value is None or value == "" else str(value)


def _label(value: Value, max_chars: int) -> str:
    text = _text(value)
    if len(text) <= max_chars:
        return escape(text)
    return f"{escape(text[: max_chars - 1])}…<title>{escape(text)}</title>"


def _cell(share: Share | None, x: float, y: float) -> str:
    """Draw a cell, filled in proportion to verified folds; with a cross if there are none."""
    side = CELL_PX - 3
    box = f'x="{x}" width="{side}" rx="3"'
    if share is None:
        return f'<rect class="none" {box} y="{y}" height="{side}"/>'
    parts = [f'<rect class="cell" {box} y="{y}" height="{side}"/>']
    below = 0.0
    for name, good in (("good", share.simulated), ("kinematics", share.by_kinematics)):
        if good:
            high = side * good / share.folds
            below += high
            parts.append(
                f'<rect class="{name}" {box} y="{y + side - below:.1f}" height="{high:.1f}"/>'
            )
    if not below:
        across = side - 12
        parts.append(
            f'<path class="cross" d="M{x + 6} {y + 6}l{across} {across}m{-across} 0l{across} '
            f'{-across}"/>'
        )
    return "".join(parts)


def _key(x: int, y: int) -> str:
    words = (
        (Share(1, 0, 1), "verified, simulated"),
        (Share(0, 1, 1), "kinematics only"),
        (Share(1, 0, 2), "some"),
        (Share(0, 0, 1), "none"),
        (None, "not run"),
    )
    return "\n".join(
        f"{_cell(share, x, y + k * (CELL_PX + 4))}"
        f'<text x="{x + 30}" y="{y + k * (CELL_PX + 4) + 15}">{text}</text>'
        for k, (share, text) in enumerate(words)
    )
