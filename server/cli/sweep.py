"""``foldback sweep``: many folds as one table, on this machine or a cluster."""

from __future__ import annotations

import sys
import time
from collections import Counter
from concurrent.futures import BrokenExecutor
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import typer
from msgspec import structs
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import refuse
from foldback.planner.chain.display_names import escaped
from foldback.planner.errors import InputError
from foldback.planner.parameters.parameters import PRESET_CHOICES, STRATEGY_CHOICES
from foldback.planner.sweeps import PACKAGES
from foldback.planner.sweeps.executors import Place
from foldback.planner.sweeps.map import PAGE, PAGE_OF_PLAN, PLANS_DIR, PLAYERS_DIR
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.sweep import SPEC_FILE, SweepState
from foldback.server.cli.interrupts import INTERRUPTED

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
    lost = 0
    try:
        _check_packages()
        values = {"shapes": shapes, "seeds": seeds, "methods": _methods(methods)}
        sweep_spec = _with_axes(_spec(spec, {k: v for k, v in values.items() if v}), axes)
        is_directory = spec is not None and spec.is_dir()
        out = spec if out is None and is_directory else out
        if dry_run:
            _show_plan(sweep_spec, out or Path())
        elif out is None:
            raise InputError("no-directory", "got no directory, expected --out DIR.")
        elif status:
            _show_status(sweep_spec, out)
        elif axes and is_directory:
            with SweepState.opened(sweep_spec, out):
                pass
        else:
            sbatch = _pairs(slurm or [], "--slurm")
            place = Place(on=on, workers=workers, walltime=walltime, slurm=sbatch)
            verdicts = tuple(filter(None, again.split(",")))
            lost = _run(sweep_spec, out, place, verdicts, as_json)
    except InputError as error:
        refuse(error, as_json)
    except BrokenExecutor as error:
        refuse(InputError("another-planner", str(error)), as_json)
    except KeyboardInterrupt:
        print("The rows are stored; the same line again continues.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    raise typer.Exit(NOT_ACHIEVED if lost else 0)


def _run(spec: SweepSpec, out: Path, place: Place, again: tuple[str, ...], as_json: bool) -> int:
    """Compute what is missing, and write the results; return the number of lost folds."""
    verified = 0
    start_s = time.monotonic()
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        *(TextColumn("{task.fields[rate]}"), TimeRemainingColumn()),
    )
    with SweepState.opened(spec, out, again) as state:
        remaining = state.count_remaining()
        with Progress(
            *columns,
            console=Console(stderr=True),
            redirect_stdout=sys.stdout.isatty(),  # rows in a file or a pipe stay there
            disable=not remaining,
        ) as progress:
            bar = progress.add_task("starting", total=remaining, rate="")
            for number, row in enumerate(state.compute(place), 1):
                verified += bool(row.get("verified"))
                text = f"{verified} verified, {number - verified} not"
                rate = f"{60 * number / (time.monotonic() - start_s):.0f} folds/min"
                progress.update(bar, advance=1, description=text, rate=rate)
                if as_json:
                    print(msgspec.json.encode(row).decode(), flush=True)
        _write_players(out)
    if not as_json:
        Console(soft_wrap=True, highlight=False).print(f"{out / PAGE}", markup=False)
    return state.lost()


def _spec(spec: Path | None, values: dict[str, Any]) -> SweepSpec:
    """Return the specification in a file or a sweep's directory, or that of options."""
    if (spec is None) != bool(values.get("shapes")) or (spec is not None and values):
        raise InputError("no-spec", "got no spec or two, expected SPEC, or options with --shape.")
    if spec is None:
        return SweepSpec.of(values, Path.cwd())
    path = spec / SPEC_FILE if spec.is_dir() else spec
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
    if not all(map(find_spec, PACKAGES)):
        raise InputError("no-sweep", "foldback sweep needs Dask: pip install 'foldback[sweep]'")


def _show_plan(spec: SweepSpec, out: Path) -> None:
    """Print the number of folds, their expected time, and the first ones."""
    state = SweepState.of(spec, out)
    seconds = sum(folds.expected_s * len([*state.remaining_seeds(folds)]) for folds in state.series)
    total = sum(len(folds.seeds) for folds in state.series)
    console = Console(soft_wrap=True, highlight=False)
    console.print(
        f"{state.count_remaining()} of {total} folds, {seconds / 3600:.1f} core hours expected"
    )
    for case in islice(state.missing(), LISTED_CASES):
        text = " ".join(f"{name}={case.columns[name]}" for name in LISTED_COLUMNS)
        console.print(escaped(text), markup=False)


def _show_status(spec: SweepSpec, out: Path) -> None:
    """Print the number of rows by verdict, and how many folds are left."""
    state = SweepState.of(spec, out)
    counts = Counter(
        f"failed: {row['reason']}" if row.get("reason") else str(row.get("verdict"))
        for row in state.rows.values()
    )
    grid = Table("folds", "verdict", box=None)
    for verdict, count in counts.most_common():
        grid.add_row(str(count), Text(escaped(verdict)))
    grid.add_row(str(state.count_remaining()), "left")
    Console().print(grid)


def _write_players(out: Path) -> None:
    """Write pages for plans that have none."""
    plans = [
        plan
        for plan in sorted(out.glob(f"{PLANS_DIR}/[!.]*"))
        if not (out / PAGE_OF_PLAN.format(plan.name)).exists()
    ]
    if not plans:
        return
    try:
        from foldback.server.cli.site import write_players
    except ModuleNotFoundError:  # without the service, foldback play shows them
        return
    write_players(out / PLAYERS_DIR, plans)
