"""Rows of a sweep on disk: JSON lines, one file for each run of the command."""

from __future__ import annotations

import fcntl
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec

from foldback.planner.errors import InputError
from foldback.planner.sweeps.case import Row

ROWS_DIR: Final = "rows"
"""Name of the directory, in that of a sweep, with the files of its rows."""
LOCK: Final = ".lock"
"""Name of the file, in the directory of a sweep, that the command locks while it writes rows."""


def with_shared_texts(row: Row) -> Row:
    """Return a row whose texts are one object with equal texts of other rows.

    Most texts of a sweep's rows are the same. 100 000 rows take 120 MB so, and 350 MB as Dask
    returns them.
    """
    return {
        sys.intern(name): sys.intern(value) if isinstance(value, str) else value
        for name, value in row.items()
    }


class Rows:
    """Rows in the directory of a sweep.

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
