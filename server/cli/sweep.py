"""``foldback sweep``: many folds as one table, on this machine or a cluster."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from msgspec import structs
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import refuse
from foldback.planner.errors import InputError
from foldback.planner.parameters.parameters import PRESET_CHOICES, STRATEGY_CHOICES
from foldback.planner.sweeps.spec import SweepSpec

if TYPE_CHECKING:
    from foldback.planner.sweeps.sweep import SweepState

INTERRUPTED: Final = 130
"""Exit status of a command that Ctrl-C has ended, as of shells."""
LISTED_CASES: Final = 10
"""Number of folds that ``--dry-run`` lists."""
LISTED_COLUMNS: Final = ("shape", "group", "modules", "method", "seed")


def sweep(
    spec: Annotated[
        Path | None,
        typer.Argument(metavar="SPEC", help="File with the spec, or directory of a sweep."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Directory of the sweep.")] = None,
    shapes: Annotated[
        list[str] | None,
        typer.Option("--shape", help="Instead of SPEC: example, file or glob; repeatable."),
    ] = None,
    seeds: Annotated[str | None, typer.Option(help="Seeds, such as 0-4.")] = None,
    methods: Annotated[
        list[str] | None,
        typer.Option("--method", help="A strategy or preset, such as peel; repeatable."),
    ] = None,
    on: Annotated[
        str,
        typer.Option(
            help="Dask cluster: tcp://HOST:PORT, a scheduler file, or slurm. Default: this machine."
        ),
    ] = "",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Folds at once. Default: number of cores.")
    ] = None,
    walltime: Annotated[str, typer.Option(help="Time limit of a SLURM job.")] = "04:00:00",
    slurm: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Option of sbatch; repeatable."),
    ] = None,
    dry_run: Annotated[bool, typer.Option(help="Only list what would be folded.")] = False,
    status: Annotated[bool, typer.Option(help="Only count the rows by verdict.")] = False,
    again: Annotated[
        str, typer.Option(metavar="VERDICTS", help="Repeat folds, such as error,lost.")
    ] = "",
    axes: Annotated[
        str, typer.Option("--map", help="Axes: rows=group,columns=modules,by=method.")
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print each row as a line.")] = False,
) -> None:
    """Fold many shapes in many ways; write a table, a map and a page.

    The same line again continues. Exits with 0 if all folds have rows, with 3 if some are lost, and
    with 2 if the spec is bad.
    """
    try:
        values = {"shapes": shapes, "seeds": seeds, "methods": _methods(methods)}
        sweep_spec = _with_axes(_spec(spec, {k: v for k, v in values.items() if v}), axes)
        if out is None and spec is not None and spec.is_dir():
            out = spec
        _check_packages()
        if dry_run:
            _show_plan(sweep_spec, out or Path())
            return
        if out is None:
            raise InputError("no-directory", "got no directory, expected --out DIR.")
        if status:
            _show_status(sweep_spec, out)
            return
        if axes and spec is not None and spec.is_dir():
            _redraw(sweep_spec, out)
            return
        from foldback.planner.sweeps.executors import Place

        options = _pairs(slurm or [], "--slurm")
        place = Place(on=on, workers=workers, walltime=walltime, slurm=options)
        lost = _run(
            sweep_spec, out, place, tuple(filter(None, again.split(","))), bool(axes), as_json
        )
    except InputError as error:
        refuse(error, as_json)
    except KeyboardInterrupt:
        print("The rows are stored; the same line again continues.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    raise typer.Exit(NOT_ACHIEVED if lost else 0)


def _run(
    spec: SweepSpec, out: Path, place: Any, again: tuple[str, ...], redraw: bool, as_json: bool
) -> int:
    """Compute what is missing, and write the results; return the number of lost folds."""
    from foldback.planner.sweeps.rows import Rows
    from foldback.planner.sweeps.run import LOST
    from foldback.planner.sweeps.sweep import Sweep, write_results

    lost = 0
    with _bar() as (bar, begin):
        for row in Sweep.of(spec).rows(out, on=place, again=again, begun=begin):
            lost += row["verdict"] == LOST
            bar(bool(row.get("verified")))
            if as_json:
                print(json.dumps(row), flush=True)
    if redraw or _write_players(out):
        write_results(spec, out, Rows(out).read(), 0, redraw=True)
    if not as_json:
        Console(soft_wrap=True, highlight=False).print(f"{out / 'index.html'}", markup=False)
    return lost


def _spec(spec: Path | None, values: dict[str, Any]) -> SweepSpec:
    """Return the specification in a file or a sweep's directory, or that of options."""
    if (spec is None) != bool(values.get("shapes")) or (spec is not None and values):
        raise InputError("no-spec", "got no spec or two, expected SPEC, or options with --shape.")
    if spec is None:
        return SweepSpec.of(values, Path.cwd())
    path = spec / "sweep.toml" if spec.is_dir() else spec
    if not path.is_file():
        raise InputError(
            "no-file",
            f"got {str(spec)!r}, expected a spec in TOML, or the directory of a sweep; "
            "docs/sweeps.md shows a spec.",
        )
    return SweepSpec.from_toml(path)


def _methods(names: list[str] | None) -> dict[str, dict[str, str]]:
    """Return methods by their names: strategies or presets."""
    methods: dict[str, dict[str, str]] = {}
    for name in names or ():
        field = "strategy" if name in STRATEGY_CHOICES else "preset"
        if name not in STRATEGY_CHOICES and name not in PRESET_CHOICES:
            choices = ", ".join([*STRATEGY_CHOICES, *PRESET_CHOICES])
            raise InputError("bad-method", f"got the method {name!r}, expected one of: {choices}.")
        methods[name] = {field: name}
    return methods


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    """Return the names and values of texts such as ``partition=cpu``."""
    pairs = [text.partition("=") for text in texts]
    if bad := next((text for text, pair in zip(texts, pairs, strict=True) if not pair[2]), None):
        raise InputError("bad-pair", f"got {option} {bad!r}, expected KEY=VALUE.")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _with_axes(spec: SweepSpec, text: str) -> SweepSpec:
    """Return the specification with the axes of ``--map``."""
    axes = _pairs(text.split(","), "--map") if text else {}
    if unknown := axes.keys() - {"rows", "columns", "by"}:
        raise InputError(
            "bad-map", f"got --map {min(unknown)!r}, expected rows=…, columns=… or by=…."
        )
    return structs.replace(spec, map=structs.replace(spec.map, **axes))


def _check_packages() -> None:
    if not all(find_spec(name) for name in ("distributed", "pyarrow", "psutil", "tomli_w")):
        raise InputError("no-sweep", "foldback sweep needs Dask: pip install 'foldback[sweep]'")


def _show_plan(spec: SweepSpec, out: Path) -> None:
    """Print the number of folds, their expected time, and the first ones."""
    from foldback.planner.sweeps.sweep import SweepState

    state = SweepState.of(spec, out)
    seconds = sum(
        series.expected_s * sum(series.key(seed) not in state.rows for seed in series.seeds)
        for series in state.cases.series
    )
    console = Console(soft_wrap=True, highlight=False)
    left = state.cases.left(state.rows)
    console.print(f"{left} of {len(state.cases)} folds, {seconds / 3600:.1f} core hours expected")
    for case in islice(state.cases.missing(state.rows), LISTED_CASES):
        columns = {name: value for name, value in case.columns.items() if name in LISTED_COLUMNS}
        console.print(" ".join(f"{k}={v}" for k, v in columns.items()), markup=False)


def _show_status(spec: SweepSpec, out: Path) -> None:
    """Print the number of rows by verdict, and how many folds are left."""
    from foldback.planner.sweeps.sweep import SweepState

    state = SweepState.of(spec, out)
    counts = Counter(
        f"failed: {row['reason']}" if row.get("reason") else str(row["verdict"])
        for row in state.rows.values()
    )
    grid = Table("folds", "verdict", box=None)
    for verdict, count in counts.most_common():
        grid.add_row(str(count), Text(verdict))
    grid.add_row(str(state.cases.left(state.rows)), "left")
    Console().print(grid)


def _redraw(spec: SweepSpec, out: Path) -> None:
    """Draw the map anew from the rows of a directory; compute nothing."""
    from foldback.planner.sweeps.sweep import SweepState, write_results

    state = SweepState.of(spec, out)
    write_results(spec, out, state.rows, state.cases.left(state.rows), redraw=True)


@contextmanager
def _bar() -> Generator[tuple[Callable[[bool], None], Callable[[SweepState], None]]]:
    """Show a bar on standard error; yield functions for each row, and for the beginning."""
    progress = Progress(
        TextColumn("{task.fields[note]}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    bar = progress.add_task("", total=None, note="starting", rate="")
    counts: Counter[bool] = Counter()
    start_s = time.monotonic()

    def begin(state: SweepState) -> None:
        if left := state.cases.left(state.settled):
            progress.update(bar, total=left)
            progress.start()

    def advance(verified: bool) -> None:
        counts[verified] += 1
        minutes = (time.monotonic() - start_s) / 60
        progress.update(
            bar,
            advance=1,
            note=f"{counts[True]} verified, {counts[False]} not",
            rate=f"{counts.total() / minutes:.0f} folds/min",
        )

    try:
        yield advance, begin
    finally:
        if progress.live.is_started:
            progress.stop()


def _write_players(out: Path) -> bool:
    """Write pages for plans that have none; return True if there are new ones."""
    from foldback.planner.sweeps.cases import PLANS_DIR
    from foldback.planner.sweeps.map import PAGE_OF_PLAN, PLAYERS_DIR

    plans = [
        plan
        for plan in sorted(out.glob(f"{PLANS_DIR}/*"))
        if not (out / PAGE_OF_PLAN.format(plan.name)).exists()
    ]
    if not plans:
        return False
    with suppress(ModuleNotFoundError):  # without the service, foldback play shows them
        from foldback.server.cli.site import write_players

        write_players(out / PLAYERS_DIR, plans)
        return True
    return False
