"""Command under faults: a sweep of cheap cases on a Dask cluster, as ``foldback sweep --on``."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Final

from bench.sweeps.tasks import NoteStart
from foldback.planner.sweeps.case import Case
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.rows import Rows
from foldback.planner.sweeps.run import run_cases

NUMBER_FILE: Final = "number"
"""Name of the file with the number of cases; until it is there, cases are added."""
WITNESS_FILE: Final = "starts"
"""Name of the file with a line for each start of a case."""
CASE_S: Final = 0.3
"""Time that a case takes, s."""


def missing(directory: Path, stored: set[str]) -> Iterator[Case]:
    """Yield cases without a row until the number of cases is reached."""
    number = directory / NUMBER_FILE
    for index in count():
        if number.exists() and index >= int(number.read_text()):
            return
        if (key := str(index)) not in stored:
            yield Case(key=key, columns={}, task=NoteStart(directory / WITNESS_FILE, key, CASE_S))


def main() -> None:
    """Compute cases in a directory at an address until there are enough."""
    directory, address = Path(sys.argv[1]), sys.argv[2]
    rows = Rows(directory)
    with rows.writing() as add, executor_on(Place(on=address)) as executor:
        cases = missing(directory, set(rows.read()))
        for _ in run_cases(cases, add, executor, at_once=16):
            pass


if __name__ == "__main__":
    main()
