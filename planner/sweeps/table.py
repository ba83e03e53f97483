"""Table of a sweep: its rows as Parquet and CSV, with units in the names of the columns."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from foldback.planner.storage.files import written_aside
from foldback.planner.sweeps.case import Row
from foldback.planner.sweeps.rows import Rows

TABLE_FORMAT: Final = "foldback-sweep/1"
PARQUET: Final = "results.parquet"
CSV: Final = "results.csv"
FIRST_COLUMNS: Final = {
    "key": "string",
    "shape": "string",
    "group": "string",
    "shape_digest": "string",
    "module": "string",
    "modules": "int64",
    "method": "string",
    "seed": "int64",
}
"""Columns that identify a fold, with their types in Arrow."""
LAST_COLUMNS: Final = {
    "verdict": "string",
    "verified": "bool",
    "simulated": "bool",
    "reason": "string",
    "clearance_bound_pitch": "float64",
    "min_clearance_pitch": "float64",
    "frames": "int64",
    "steps": "int64",
    "attempts": "int64",
    "strategy": "string",
    "cpu_s": "float64",
    "wall_s": "float64",
    "memory_mb": "float64",
    "host": "string",
    "processor": "string",
    "version": "string",
    "planner_digest": "string",
    "started_at": "string",
    "error": "string",
}
"""Columns of what came of a fold, with their types in Arrow; those of the request's fields that
vary are before them."""


def column_names(rows: Iterable[Row]) -> tuple[str, ...]:
    """Return the columns of rows, in their order in the table."""
    types = FIRST_COLUMNS | LAST_COLUMNS
    others = dict.fromkeys(name for row in rows for name in row if name not in types)
    return (*FIRST_COLUMNS, *others, *LAST_COLUMNS)


def write_tables(directory: Path, rows: Mapping[str, Row], spec: dict[str, Any]) -> None:
    """Write the tables of a sweep.

    Args:
        directory: Directory of the sweep.
        rows: Newest rows by key.
        spec: Specification as plain values, which the table's metadata hold.
    """
    import pyarrow as pa
    import pyarrow.csv as pa_csv
    import pyarrow.parquet as pa_parquet

    types = FIRST_COLUMNS | LAST_COLUMNS
    names = column_names(rows.values())
    arrays = [
        pa.array(
            (row.get(name) for row in rows.values()),
            pa.type_for_alias(types[name]) if name in types else None,
            size=len(rows),
        )
        for name in names
    ]
    metadata = {
        "format": TABLE_FORMAT,
        "foldback": version("foldback"),
        "pyarrow": pa.__version__,
        "spec": json.dumps(spec),
    }
    table = pa.table(arrays, names=list(names)).replace_schema_metadata(metadata)
    with written_aside(directory / PARQUET) as path:
        pa_parquet.write_table(table, path)
    with written_aside(directory / CSV) as path:
        pa_csv.write_csv(table, path)


def is_outdated(directory: Path) -> bool:
    """Return True if rows were written after the tables."""
    newest = max((path.stat().st_mtime_ns for path in Rows(directory).files()), default=0)
    tables = [directory / name for name in (PARQUET, CSV)]
    return not all(path.exists() and path.stat().st_mtime_ns >= newest for path in tables)
