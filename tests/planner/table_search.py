"""Searches for a path on a table that expect to find one, or to find none."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.table_paths.infeasibility import NoPath, most_telling
from planner.table_paths.table_paths import TablePath, paths_or_reasons


def table_paths(cells: ArrayLike, **how: Any) -> tuple[TablePath, ...]:
    """The paths through a shape, the most promising first.

    Raises:
        InputError: With the most telling reason, when there is none.
    """
    paths, reasons = paths_or_reasons(cells, **how)
    if not paths:
        raise InputError(*most_telling(reasons))
    return paths


def why_none(cells: ArrayLike, **how: Any) -> tuple[NoPath, ...]:
    """The reason for each side of a shape without a path for a table; none if it has one."""
    paths, reasons = paths_or_reasons(cells, most=1, **how)
    return () if paths else reasons
