"""Sweep: all folds of a specification, computed where a row is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import tomli_w

from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.storage.files import write_whole
from foldback.planner.sweeps.case import Row
from foldback.planner.sweeps.cases import SweepCases
from foldback.planner.sweeps.rows import Rows
from foldback.planner.sweeps.simple_run import run_cases
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.table import PARQUET, is_outdated, write_tables

if TYPE_CHECKING:
    import pyarrow as pa

    from foldback.planner.sweeps.shapes import Pattern

SPEC_FILE: Final = "sweep.toml"
"""Name of the file, in the directory of a sweep, with its specification."""
CASES_PER_WORKER: Final = 4
"""Number of cases that are submitted at the same time for each worker, so that none waits."""


class Sweep:
    """Many folds as one table.

        sweep = Sweep(shapes=["gallery:*"], seeds=range(5), methods={"auto": {}})
        table = sweep.run("map")

    Args:
        shapes: Examples (``gallery:*``), files, globs, pairs of a name and bytes; or groups of
            these by name.
        values: Other keys of a spec, as docs/sweeps.md describes them: ``seeds``, ``methods``,
            ``grid``, ``budget``, ``until``, ``keep``, ``map``.

    Raises:
        InputError: If a value cannot be used.
    """

    def __init__(self, shapes: Sequence[Pattern] | Mapping[str, Any] = (), **values: Any) -> None:
        self.spec = SweepSpec.of({"shapes": shapes, **values}, Path.cwd())

    @classmethod
    def of(cls, spec: SweepSpec) -> Sweep:
        """Return the sweep of a specification."""
        sweep = cls.__new__(cls)
        sweep.spec = spec
        return sweep

    def run(self, directory: str | Path, **options: Any) -> pa.Table:
        """Compute what is missing; return the table, with a row for each fold.

        Args:
            directory: Directory of the sweep; created if missing.
            options: Same as for ``rows``.
        """
        import pyarrow.parquet as pq

        for _ in self.rows(directory, **options):
            pass
        return pq.read_table(Path(directory) / PARQUET)

    def rows(
        self,
        directory: str | Path,
        *,
        executor: Executor,
        workers: int | None = None,
        again: Sequence[str] = (),
    ) -> Iterator[Row]:
        """Compute what is missing; yield each new row, which is stored already.

        Args:
            directory: Directory of the sweep; created if missing.
            executor: Computes the folds.
            workers: Number of folds at the same time; the number of cores if None.
            again: Verdicts, or their beginnings, of rows that are computed again.

        Raises:
            InputError: If the directory cannot be used, or a request is invalid.
        """
        directory = Path(directory)
        stored = Rows(directory)
        with stored.writing() as add:
            write_spec(self.spec, directory)
            rows = stored.read()
            repeated = tuple(again)
            settled = {
                key: row
                for key, row in rows.items()
                if not str(row["verdict"]).startswith(repeated)
            }
            cases = SweepCases(self.spec, directory)
            missing = cases.missing(settled)
            first = next(missing, None)
            try:
                for row in (
                    ()
                    if first is None
                    else run_cases(
                        chain([first], missing),
                        add,
                        executor,
                        at_once=CASES_PER_WORKER * (workers or cores()),
                        next_case=lambda case, row: cases.after(case, row, settled),
                    )
                ):
                    rows[str(row["key"])] = row
                    yield row
            finally:
                if is_outdated(directory):
                    write_tables(directory, rows, self.spec.as_dict())


def write_spec(spec: SweepSpec, directory: Path) -> None:
    """Write the specification into a sweep's directory.

    Raises:
        InputError: ``another-sweep``, if the directory holds another one.
    """
    path = directory / SPEC_FILE
    values = spec.as_dict()
    if path.exists():
        stored = SweepSpec.from_toml(path).as_dict()
        different = [
            f"{name} is {stored.get(name)!r} there and {values.get(name)!r} here"
            for name in (*values, *(name for name in stored if name not in values))
            if name != "map" and stored.get(name) != values.get(name)
        ]
        if different:
            raise InputError(
                "another-sweep",
                f"got the directory of another sweep: {'; '.join(different)}. Choose another "
                f"directory, or change its {path.name} to go on with other values.",
                where=str(directory),
            )
    write_whole(path, tomli_w.dumps(values).encode())
