"""Rows of a sweep on disk: JSON lines as they are computed, and tables as Parquet and CSV."""

from __future__ import annotations

import fcntl
import json
import sys
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import msgspec

from foldback.planner.errors import InputError
from foldback.planner.storage.files import written_aside
from foldback.planner.sweeps.case import Row

ROWS_DIR: Final = "rows"
"""Name of the directory, in that of a sweep, with the files of its rows."""
LOCK: Final = ".lock"
"""Name of the file, in the directory of a sweep, that the command locks while it writes rows."""
TABLE_FORMAT: Final = "foldback-sweep/1"
PARQUET: Final = "results.parquet"
CSV: Final = "results.csv"
COLUMNS: Final = {
    "key": "string",
    "shape": "string",
    "group": "string",
    "shape_digest": "string",
    "module": "string",
    "modules": "int64",
    "method": "string",
    "seed": "int64",
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
"""Columns of the tables, with their types in Arrow and units in their names."""


def with_shared_texts(row: Row) -> Row:
    """Return a row whose texts are one object with equal texts of other rows.

    Most texts of a sweep's rows are the same. 100 000 rows take 120 MB so, and 350 MB as Dask
    returns them.
    """
    return {
        sys.intern(name): sys.intern(value) if isinstance(value, str) and name != "key" else value
        for name, value in row.items()
    }


class Rows:
    """Rows in the directory of a sweep, in one file for each run of the command.

    A line is a row. A last line that a killed command has not completed is ignored.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def files(self) -> list[Path]:
        """Return the files of the rows, the oldest first."""
        return sorted((self._directory / ROWS_DIR).glob("*.jsonl"))

    def read(self) -> dict[str, Row]:
        """Return the newest row of each key, in the order in which they were written.

        Raises:
            InputError: ``damaged-rows``.
        """
        decoder = msgspec.json.Decoder(Row)
        rows: dict[str, Row] = {}
        for path in self.files():
            for number, line in enumerate(path.read_bytes().splitlines(keepends=True), 1):
                if not line.endswith(b"\n"):
                    continue
                try:
                    row = decoder.decode(line)
                    key = str(row["key"])
                except (msgspec.DecodeError, KeyError) as error:
                    raise InputError(
                        "damaged-rows",
                        f"got an unreadable line {number}, expected a JSON object with a key; "
                        "remove the line, and its case is computed again.",
                        where=str(path),
                    ) from error
                rows.pop(key, None)
                rows[key] = with_shared_texts(row)
        return rows

    @contextmanager
    def writing(self) -> Generator[Callable[[Row], None]]:
        """Yield a function that writes a row; no other command may write at the same time.

        Raises:
            InputError: ``in-use``, if another command writes.
        """
        (self._directory / ROWS_DIR).mkdir(parents=True, exist_ok=True)
        with (self._directory / LOCK).open("a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    "in-use",
                    "got a directory that another foldback sweep is writing, expected a free one; "
                    "wait until the other command ends, or stop it.",
                    where=str(self._directory),
                ) from None
            numbers = [int(path.stem) for path in self.files() if path.stem.isdecimal()]
            path = self._directory / ROWS_DIR / f"{max(numbers, default=0) + 1:04}.jsonl"

            def add(row: Row) -> None:
                with path.open("ab") as file:
                    file.write(msgspec.json.encode(row) + b"\n")

            yield add


def column_names(rows: Iterable[Row]) -> tuple[str, ...]:
    """Return the columns of rows; those of options that vary stand before what came of a fold."""
    options = dict.fromkeys(name for row in rows for name in row if name not in COLUMNS)
    names = [*COLUMNS]
    outcome = names.index("verdict")
    return (*names[:outcome], *options, *names[outcome:])


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

    names = column_names(rows.values())
    arrays = [
        pa.array(
            (row.get(name) for row in rows.values()),
            pa.type_for_alias(COLUMNS[name]) if name in COLUMNS else None,
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
