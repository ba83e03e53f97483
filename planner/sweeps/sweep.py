"""Sweep: all folds of a specification, computed where a row is missing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.storage.files import write_whole
from foldback.planner.storage.plain_values import to_plain
from foldback.planner.sweeps.case import Row
from foldback.planner.sweeps.cases import SweepCases
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.map import MAP_PERIOD_S, write_map
from foldback.planner.sweeps.rows import Rows, with_shared_texts
from foldback.planner.sweeps.run import CASES_PER_WORKER, run_cases
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.table import PARQUET, is_outdated, write_tables

if TYPE_CHECKING:
    import pyarrow as pa

    from foldback.planner.sweeps.shapes import Pattern

SPEC_FILE: Final = "sweep.toml"
"""Name of the file, in the directory of a sweep, with its specification."""


@dataclass(frozen=True, slots=True)
class SweepState:
    """State of a sweep in its directory.

    Attributes:
        cases: All cases.
        rows: Newest rows by key.
        settled: Rows whose cases are not computed again.
    """

    cases: SweepCases
    rows: dict[str, Row]
    settled: dict[str, Row]

    @classmethod
    def of(cls, spec: SweepSpec, directory: Path, again: Sequence[str] = ()) -> SweepState:
        """Return the state of a sweep.

        Args:
            spec: Its specification.
            directory: Its directory, which may be missing.
            again: Verdicts, or their beginnings, of rows that are computed again.
        """
        rows, repeated = Rows(directory).read(), tuple(again)
        settled = {
            k: row for k, row in rows.items() if not str(row["verdict"]).startswith(repeated)
        }
        return cls(SweepCases(spec, directory), rows, settled if repeated else rows.copy())


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
        on: str | Place = "",
        executor: Executor | None = None,
        workers: int | None = None,
        again: Sequence[str] = (),
        begun: Callable[[SweepState], None] = lambda _: None,
    ) -> Iterator[Row]:
        """Compute what is missing; yield each new row, which is stored already.

        Args:
            directory: Directory of the sweep; created if missing.
            on: Where the folds are computed: the address or scheduler file of a Dask cluster, or a
                place; empty for all cores of this machine.
            executor: Instead of it, any executor.
            workers: Number of folds at the same time; the number of cores if None.
            again: Verdicts, or their beginnings, of rows that are computed again.
            begun: Called with the state before the first fold.

        Raises:
            InputError: If the directory cannot be used, or a request is invalid.
        """
        import tomli_w  # of the extra ``sweep``

        directory = Path(directory)
        with Rows(directory).writing() as add, ExitStack() as opened:
            check_spec(self.spec, directory)
            state = SweepState.of(self.spec, directory, again)
            write_whole(directory / SPEC_FILE, tomli_w.dumps(self.spec.as_dict()).encode())
            settled, cases, left = state.settled, state.cases, state.cases.left(state.settled)
            begun(state)
            opened.callback(lambda: write_results(self.spec, directory, state.rows, left))
            missing = cases.missing(settled)
            if (first := next(missing, None)) is None:
                return
            at_once: int | Callable[[], int] = CASES_PER_WORKER * (workers or cores())
            if executor is None:
                place = on if isinstance(on, Place) else Place(on=on, workers=workers)
                executor = opened.enter_context(executor_on(place))
                at_once = executor.at_once
            drawn_s = float("-inf")
            for row in run_cases(
                chain([first], missing),
                add,
                executor,
                at_once=at_once,
                next_case=lambda case, row: cases.after(case, row, settled),
            ):
                state.rows.pop(str(row["key"]), None)
                state.rows[str(row["key"])] = with_shared_texts(row)
                left -= 1
                if time.monotonic() - drawn_s > MAP_PERIOD_S:
                    write_map(directory, self.spec, state.rows, left, is_running=True)
                    drawn_s = time.monotonic()
                yield row


def write_results(
    spec: SweepSpec, directory: Path, rows: Mapping[str, Row], left: int, *, redraw: bool = False
) -> None:
    """Write the tables and the map, if there are newer rows.

    Args:
        spec: The specification.
        directory: Directory of the sweep.
        rows: Newest rows by key.
        left: Number of folds that are still to be computed.
        redraw: True to write them in any case.
    """
    if redraw or is_outdated(directory):
        write_tables(directory, rows, spec.as_dict())
        write_map(directory, spec, rows, left, is_running=False)


def check_spec(spec: SweepSpec, directory: Path) -> None:
    """Refuse a directory with the specification of another sweep.

    Raises:
        InputError: ``another-sweep``.
    """
    path = directory / SPEC_FILE
    if not path.exists():
        return
    values, stored = SweepSpec.of(spec.as_dict(), Path()), SweepSpec.from_toml(path)
    pairs = [
        (name, getattr(stored, name), getattr(values, name))
        for name in SweepSpec.__struct_fields__
        if name != "map"
    ]
    different = [
        f"{name} is {to_plain(there)!r} there and {to_plain(here)!r} here"
        for name, there, here in pairs
        if there != here
    ]
    if different:
        raise InputError(
            "another-sweep",
            f"got the directory of another sweep: {'; '.join(different)}. Choose another "
            f"directory, or remove its {path.name} to go on with other values; its rows stay.",
            where=str(directory),
        )
