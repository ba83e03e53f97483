"""Searches for a path on a table, for shapes with and without one."""

from typing import Any

from numpy.typing import ArrayLike

from foldback.planner.table_paths.no_table_path_proofs import NoPath, no_path_error
from foldback.planner.table_paths.table_paths import TablePath, paths_or_reasons


def table_paths(cells: ArrayLike, **options: Any) -> tuple[TablePath, ...]:
    """Return the paths through a shape, the most promising first.

    Raises:
        InputError: If there is no path; the error states the most informative reason.
    """
    paths, reasons = paths_or_reasons(cells, **options)
    if not paths:
        raise no_path_error(reasons)
    return paths


def reasons_for_no_path(cells: ArrayLike, **options: Any) -> tuple[NoPath, ...]:
    """Return the reasons, one per side, why a shape has no path; empty if it has one."""
    paths, reasons = paths_or_reasons(cells, max_paths=1, **options)
    return () if paths else reasons
