"""Sweep: all folds of a specification, computed where a row is missing."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import islice, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.storage.files import write_whole
from foldback.planner.storage.plain_values import to_plain
from foldback.planner.sweeps.case import LOST, Case, Row
from foldback.planner.sweeps.cases import FoldSeries, series_of
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.map import (
    MAP_PERIOD_S,
    PAGE,
    PAGE_OF_PLAN,
    PICTURE,
    PLANS_DIR,
    check_axes,
    write_map,
)
from foldback.planner.sweeps.planner_digest import planner_digest
from foldback.planner.sweeps.rows import CSV, PARQUET, Rows, with_shared_texts, write_tables
from foldback.planner.sweeps.run import CASES_PER_WORKER, run_cases
from foldback.planner.sweeps.spec import Pattern, SweepSpec

if TYPE_CHECKING:
    import pyarrow as pa

SPEC_FILE: Final = "sweep.toml"
"""Name of the file, in the directory of a sweep, with its specification."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepState:
    """State of a sweep in its directory.

    Attributes:
        spec: Its specification.
        directory: The directory, which may be missing.
        series: All folds, the cheapest first.
        rows: Newest rows by key, in the order in which they were written: those of its folds, and
            of other versions of the planner.
        settled: Rows whose folds are not computed again.
        write: Stores a row.
        handed_out: Folds of which another seed may be needed, by the keys of those being computed.
    """

    spec: SweepSpec
    directory: Path
    series: list[FoldSeries]
    rows: dict[str, Row]
    settled: dict[str, Row]
    write: Callable[[Row], None]
    handed_out: dict[str, FoldSeries] = field(default_factory=dict[str, FoldSeries])

    @classmethod
    def of(
        cls,
        spec: SweepSpec,
        directory: Path,
        again: Sequence[str] = (),
        write: Callable[[Row], None] = lambda _: None,
    ) -> SweepState:
        """Return the state of a sweep, which is only read.

        Args:
            spec: Its specification.
            directory: Its directory, which may be missing.
            again: Verdicts, or their beginnings, of rows that are computed again.
            write: Stores a row.
        """
        series = series_of(spec)
        keys = {folds.key(seed) for folds in series for seed in folds.seeds}
        rows = {
            key: row
            for key, row in Rows(directory).read().items()
            if key in keys or row.get("planner_digest") != planner_digest()
        }
        repeated = (again,) if isinstance(again, str) else tuple(again)
        settled = {
            key: row
            for key, row in rows.items()
            if not (repeated and str(row.get("verdict")).startswith(repeated))
        }
        return cls(
            spec=spec,
            directory=directory,
            series=series,
            rows=rows,
            settled=settled,
            write=write,
        )

    @classmethod
    @contextmanager
    def opened(
        cls, spec: SweepSpec, directory: Path, again: Sequence[str] = ()
    ) -> Generator[SweepState]:
        """Yield the state of a sweep that is computed; write its tables and its map at the end.

        Args:
            spec: Its specification.
            directory: Its directory; created if missing.
            again: Verdicts, or their beginnings, of rows that are computed again.

        Raises:
            InputError: If the directory cannot be used, or a request is invalid.
        """
        import tomli_w  # of the extra ``sweep``

        with Rows(directory).writing() as write:
            check_spec(spec, directory)
            state = cls.of(spec, directory, again, write)
            check_axes(spec.map_axes(), state.rows.values())
            path, text = directory / SPEC_FILE, tomli_w.dumps(spec.as_dict()).encode()
            if not path.exists() or path.read_bytes() != text:
                write_whole(path, text)
            try:
                yield state
            finally:
                state.write_results()

    def add(self, row: Row) -> None:
        """Store the row of a fold, and replace an older one."""
        self.write(row)
        key = str(row["key"])
        self.rows.pop(key, None)
        (self.directory / PAGE_OF_PLAN.format(key)).unlink(missing_ok=True)  # of an earlier plan
        self.rows[key] = self.settled[key] = with_shared_texts(row)

    def remaining_seeds(self, series: FoldSeries) -> Iterator[int]:
        """Yield the seeds without a row; after a verified one, none may be needed."""
        for seed in series.seeds:
            row = self.settled.get(series.key(seed))
            if row is None:
                yield seed
            elif self.spec.until and row.get("verified"):
                return

    def count_remaining(self) -> int:
        """Return the number of folds without a row; seeds that may not be needed count, too."""
        return sum(1 for series in self.series for _ in self.remaining_seeds(series))

    def missing(self) -> Iterator[Case]:
        """Yield the folds without a row: the first seeds of all shapes before the second ones.

        If seeds are tried until one is verified, yield the first ones alone.
        """
        turns = zip_longest(*map(self.remaining_seeds, self.series))
        for seeds in islice(turns, 1) if self.spec.until else turns:
            for series, seed in zip(self.series, seeds, strict=True):
                if seed is not None:
                    yield self._case(series, seed)

    def lost(self) -> int:
        """Return the number of folds that executors have given up."""
        return sum(
            row.get("verdict") == LOST and row.get("planner_digest") == planner_digest()
            for row in self.rows.values()
        )

    def after(self, case: Case) -> Case | None:
        """Return the case with the next seed if seeds are tried until one is verified."""
        series = self.handed_out.pop(case.key)
        seed = next(self.remaining_seeds(series), None) if self.spec.until else None
        return None if seed is None else self._case(series, seed)

    def _case(self, series: FoldSeries, seed: int) -> Case:
        case = series.case(seed, self.spec.keep.plans, self.directory / PLANS_DIR)
        self.handed_out[case.key] = series
        return case

    def compute(self, place: Place, executor: Executor | None = None) -> Iterator[Row]:
        """Compute what is missing; yield each new row, which is stored already.

        Args:
            place: Where the folds are computed, and how many at the same time.
            executor: Computes the folds instead of Dask.
        """
        if not self.count_remaining():
            return
        with ExitStack() as started:
            at_once: int | Callable[[], int] = CASES_PER_WORKER * (place.workers or cores())
            if executor is None:
                executor = started.enter_context(executor_on(place))
                at_once = executor.at_once
            drawn_s = float("-inf")
            for row in run_cases(
                self.missing(), self.add, executor, at_once=at_once, next_case=self.after
            ):
                if time.monotonic() - drawn_s > MAP_PERIOD_S:
                    self._draw(is_running=True)
                    drawn_s = time.monotonic()
                yield row

    def write_results(self) -> None:
        """Write the tables and the map if rows, players or the specification are newer."""
        results = [self.directory / name for name in (PARQUET, CSV, PAGE, PICTURE)]
        players = (self.directory / PAGE_OF_PLAN).parent
        sources = [self.directory / SPEC_FILE, players, *Rows(self.directory).files()]
        newest = max(path.stat().st_mtime_ns for path in sources if path.exists())
        if not all(path.exists() and path.stat().st_mtime_ns >= newest for path in results):
            write_tables(self.directory, self.rows, self.spec.as_dict())
            self._draw(is_running=False)

    def _draw(self, *, is_running: bool) -> None:
        remaining = self.count_remaining()
        write_map(self.directory, self.spec, self.rows, remaining, is_running=is_running)


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
        on: str = "",
        executor: Executor | None = None,
        workers: int | None = None,
        again: Sequence[str] = (),
    ) -> Iterator[Row]:
        """Compute what is missing; yield each new row, which is stored already.

        Args:
            directory: Directory of the sweep; created if missing.
            on: Where the folds are computed: the address or scheduler file of a Dask cluster; empty
                for all cores of this machine.
            executor: Instead of it, any executor.
            workers: Number of folds at the same time; the number of cores if None.
            again: Verdicts, or their beginnings, of rows that are computed again.

        Raises:
            InputError: If the directory cannot be used, or a request is invalid.
        """
        with SweepState.opened(self.spec, Path(directory), again) as state:
            yield from state.compute(Place(on=on, workers=workers), executor)


def check_spec(spec: SweepSpec, directory: Path) -> None:
    """Refuse a directory with the specification of another sweep.

    Raises:
        InputError: ``another-sweep``.
    """
    path = directory / SPEC_FILE
    if not path.exists():
        return
    stored, current = (
        {name: getattr(spec, name) for name in SweepSpec.__struct_fields__ if name != "map"}
        for spec in (SweepSpec.from_toml(path), SweepSpec.of(spec.as_dict(), Path()))
    )
    different = [
        f"{name} is {to_plain(value)!r} there and {to_plain(current[name])!r} here"
        for name, value in stored.items()
        if value != current[name]
    ]
    if different:
        raise InputError(
            "another-sweep",
            f"got the directory of another sweep: {'; '.join(different)}. Choose another "
            f"directory, or remove its {path.name} to go on with other values; its rows stay.",
            where=str(directory),
        )
