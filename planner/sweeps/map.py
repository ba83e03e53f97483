"""Map of a sweep: shares of verified folds as a picture, and a page whose cells lead to rows."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from foldback.planner.chain.display_names import escaped
from foldback.planner.errors import InputError
from foldback.planner.storage.files import write_whole
from foldback.planner.sweeps.case import Row, Value
from foldback.planner.sweeps.rows import column_names
from foldback.planner.sweeps.spec import SweepSpec

if TYPE_CHECKING:
    from jinja2 import Environment

MAX_ROWS: Final = 300
MAX_COLUMNS: Final = 60
"""Maximum numbers of rows and columns of a field; further ones are left out."""
NOT_COUNTED: Final = "refused: strategy-differs"
"""Verdict on folds by a method that is not for their kind of chain; the map leaves them out."""
PAGE: Final = "index.html"
PICTURE: Final = "map.svg"
PLANS_DIR: Final = "plans"
"""Name of the directory, in that of a sweep, with the directories of kept folds."""
PLAYERS_DIR: Final = "players"
"""Name of the directory, in that of a sweep, with pages that play kept plans."""
PAGE_OF_PLAN: Final = f"{PLAYERS_DIR}/folds/{{}}.html"
"""Path, from the directory of a sweep, of the page that plays the plan with a key."""
MAP_PERIOD_S: Final = 30
"""Time between two versions of the page while a sweep runs, s."""
MAX_PAGE_ROWS: Final = 20_000
"""Maximum number of rows of the page, those that are not verified first; the tables have all."""
HIDDEN_COLUMNS: Final = frozenset(
    {"key", "shape_digest", "planner_digest", "verified", "started_at"}
)
"""Columns that the page leaves out."""

CellValues = tuple[Value, Value, Value]
"""Values of a cell: those of its field, row and column."""


@dataclass(slots=True)
class Share:
    """Number of folds of a cell, and numbers of those verified in two ways.

    Attributes:
        number: Number of the cell, in the order of the first rows.
    """

    number: int
    folds: int = 0
    simulated: int = 0
    by_kinematics: int = 0

    def add(self, row: Row) -> None:
        """Count another fold."""
        self.folds += 1
        self.simulated += bool(row.get("verified") and row.get("simulated"))
        self.by_kinematics += bool(row.get("verified") and not row.get("simulated"))


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
    shares: dict[CellValues, Share]

    @classmethod
    def of(cls, spec: SweepSpec, rows: Sequence[Row]) -> SweepMap:
        """Return the map of a sweep.

        Raises:
            InputError: ``unknown-column``.
        """
        axes = spec.map_axes()
        check_axes(axes, rows)
        shares: dict[CellValues, Share] = {}
        for row in rows:
            if row.get("verdict") != NOT_COUNTED:
                shares.setdefault(_cell_values(row, axes), Share(len(shares))).add(row)
        stated: dict[str, list[Value]] = {"method": [*spec.methods], "group": [*spec.shapes]}
        limits = (MAX_COLUMNS, MAX_ROWS, MAX_COLUMNS)
        values = [
            (stated.get(axis) or sorted({values[k] for values in shares}, key=_order))[: limits[k]]
            for k, axis in enumerate(axes)
        ]
        return cls(axes, (values[0], values[1], values[2]), shares)

    def number_of(self, row: Row) -> int:
        """Return the number of the cell of a row; -1 if the map leaves it out."""
        share = self.shares.get(_cell_values(row, self.axes))
        return -1 if share is None else share.number

    def picture(self) -> str:
        """Return the map as SVG: a field for each value of the first axis."""
        return _templates().get_template("map.svg.jinja").render(map=self, has_links=False)


def check_axes(axes: Iterable[str], rows: Collection[Row]) -> None:
    """Refuse axes that are no columns of rows, unless there are no rows yet.

    Raises:
        InputError: ``unknown-column``.
    """
    columns = column_names(rows)
    for axis in axes if rows else ():
        if axis not in columns:
            near = get_close_matches(axis, columns, n=3, cutoff=0.4) or columns
            raise InputError(
                "unknown-column",
                f"got the unknown column {axis!r} for the map, expected {' or '.join(near)}.",
            )


def write_map(
    directory: Path, spec: SweepSpec, rows: Mapping[str, Row], remaining: int, *, is_running: bool
) -> None:
    """Write the map as a picture and as a page with the rows of the newest planner.

    Args:
        directory: Directory of the sweep.
        spec: Its specification.
        rows: Newest rows by key, in the order in which they were written.
        remaining: Number of folds that are still to be computed.
        is_running: True while they are computed.

    Raises:
        InputError: ``unknown-column``, if an axis is none of the table.
    """
    newest = [*rows.values()][-1].get("planner_digest") if rows else None
    current = [row for row in rows.values() if row.get("planner_digest") == newest]
    sweep_map = SweepMap.of(spec, current)
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
        "cells": [_cell_name(values) for values in sweep_map.shares],
        "rows": [
            [row["key"], sweep_map.number_of(row), bool(row.get("verified"))]
            + [row.get(name) for name in columns]
            for row in shown
        ],
        "plans": {key: PAGE_OF_PLAN.format(key) if key in played else "" for key in plan_keys},
    }
    page = _templates().get_template("page.html.jinja")
    text = page.render(
        title=directory.resolve().name,
        folds=len(current),
        verified=sum(bool(row.get("verified")) for row in current),
        left=remaining,
        period_s=MAP_PERIOD_S if is_running else None,
        map=sweep_map,
        data=data,
    )
    write_whole(directory / PAGE, text.encode())
    write_whole(directory / PICTURE, sweep_map.picture().encode())


def _cell_values(row: Row, axes: tuple[str, str, str]) -> CellValues:
    """Return the values of the cell that a row belongs to."""
    return row.get(axes[0]), row.get(axes[1]), row.get(axes[2])


@cache
def _templates() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # of the extra ``sweep``

    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    filters = cast("dict[str, Any]", templates.filters)
    filters.update(text=_text, longest=_longest, cell_name=_cell_name)
    return templates


def _order(value: Value) -> tuple[bool, float, str]:
    """Return the key by which values are sorted: numbers first, then texts."""
    is_number = isinstance(value, int | float)
    return not is_number, float(value) if is_number else 0.0, str(value)


def _text(value: Value) -> str:
    return "–" if value is None or value == "" else escaped(str(value))


def _longest(values: Iterable[Value]) -> int:
    """Return the number of letters of the longest value."""
    return max((len(_text(value)) for value in values), default=0)


def _cell_name(values: CellValues) -> str:
    return ", ".join(map(_text, values))
