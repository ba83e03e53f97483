"""``foldback fold``: from a file to a verified plan, without a service."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from cli.inputs import make_directory, read_input, refuse
from cli.options import AsJson, PlanDirectory, Workers, takes
from planner.chain.module import module_named
from planner.cores import cores
from planner.errors import InputError
from planner.pathfinding.options import table_warning
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stage, run_stages
from planner.pipeline.workspace import Workspace
from planner.progress import STAGES, Report
from planner.progress import Progress as StageProgress
from words import certificate as certificate_words
from words.choice import PLAN_COLUMNS, Choice, choice_of
from words.quantities import sentence

STAGE_VERBS = {
    "explode": "Exploding",
    "play_back": "Folding",
    "certify": "Checking",
    "export": "Writing",
}


@takes()
def fold(
    *,
    out: PlanDirectory,
    shape: Annotated[
        str | None,
        typer.Argument(metavar="INPUT", help="A mesh, voxels, a path, a chain, or an example."),
    ] = None,
    angles: Annotated[
        str | None,
        typer.Option(
            help="Instead of INPUT: a chain of tetrahedra, one sign per hinge: '0 - - + 0'."
        ),
    ] = None,
    request: FoldRequest,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Explode, fold and verify a chain or a shape; exits 0, 3 (not verified) or 2 (bad input)."""
    try:
        data, filename = read_input(shape, angles)
        make_directory(out)
        Workspace(out).write_request(replace(request, filename=filename), data)
        read = run_stage(STAGES[0], out)
    except InputError as error:
        refuse(error, as_json)
    if warning := table_warning(read["modules"], request.world):
        print(warning, file=sys.stderr)
    finish(
        compute(out, workers), out, as_json, lambda _: show_choice(choice_of(out, request.prefer))
    )


def finish(
    summary: dict[str, Any],
    out: Path,
    as_json: bool,
    more: Callable[[dict[str, Any]], None] | None = None,
) -> NoReturn:
    """Print a plan's figures, with ``more`` for people; exit with 0 if verified, else 3."""
    if as_json:
        print(json.dumps(summary), flush=True)
    else:
        show(summary, out)
        if more is not None:
            more(summary)
    raise typer.Exit(0 if summary["status"] == "verified" else 3)


def compute(out: Path, workers: int | None, **words: str) -> dict[str, Any]:
    """Run the stages after reading, with a bar for each; the plan's figures.

    Args:
        out: The fold's directory.
        workers: Explosions at once at most; as many as there are cores when None.
        words: Labels of stages that differ from the default ones.
    """
    from planner.pipeline.compiling import Compiling

    with Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
        console=Console(stderr=True),
    ) as bars:

        @contextmanager
        def bar_of(stage: str) -> Generator[Report]:
            bar = bars.add_task({**STAGE_VERBS, **words}[stage], total=1.0, note="")

            def report(progress: StageProgress) -> None:
                bars.update(bar, completed=progress.fraction)
                if progress.steps:
                    bars.update(bar, note=_steps(progress))

            def compiles(progress: StageProgress) -> None:
                bars.update(bar, note=f"{progress.message}(once on each machine)")

            with Compiling(compiles):
                yield report

        return run_stages(out, first=STAGES[1], workers=workers or cores(), around=bar_of)


def show_choice(choice: Choice | None) -> None:
    """Print the plans that were tried for a preference."""
    if choice is None:
        return
    console = Console(highlight=False)
    table = Table(*PLAN_COLUMNS, box=None, pad_edge=False)
    table.columns[0].no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    for plan in choice["plans"]:
        mark = "→" if plan["chosen"] else "✓" if plan["verified"] else "✗"
        table.add_row(f"{mark} {plan['label']}", *plan["cells"])
    console.print()
    console.print(table)
    console.print(choice["text"], markup=False, soft_wrap=True)


def _steps(progress: StageProgress) -> str:
    """Return the progress of a simulation: ``48200 steps · 482 s simulated``."""
    simulated = f" · {progress.simulated_s:.0f} s simulated" if progress.simulated_s else ""
    return f"{progress.steps} steps{simulated}"


def show(summary: dict[str, Any], out: Path) -> None:
    """Print a plan's figures for people."""
    certificate, playback = summary["certificate"], summary["playback"]
    strategy = summary["explosion"].get("strategy")
    console = Console(highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)

    def row(name: str, value: float | int | str | None, unit: str = "") -> None:
        if value is not None:
            table.add_row(name, f"{value} {unit}".rstrip())

    console.print(certificate_words.headline(certificate), markup=False, soft_wrap=True)
    if stuck := summary["stuck"]:
        console.print(f"{sentence(stuck['words'])}.", markup=False, soft_wrap=True)
    row("Starts in shape", summary["refold"] and summary["refold"]["start"])
    row("Modules", summary["modules"])
    row("Strategy", certificate_words.baseline(strategy) or strategy)
    row("Explosion", summary["explosion"]["steps"] or None, "steps")
    row("Playback", playback and (playback["steps"] or None), "steps")
    for name, value in certificate_words.rows(certificate):
        row(sentence(name), value)
    row("Written to", str(out))
    console.print(table)
    limit = module_named(summary["module"]).angle_limit_rad
    for told in (
        certificate_words.linked(certificate),
        certificate_words.record(certificate, limit_rad=limit),
    ):
        if told is not None:
            console.print(told, markup=False, soft_wrap=True)
