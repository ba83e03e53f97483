"""Summary of a plan in the terminal, and the exit status of a fold."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn, cast

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.planner.certificate.figures import FoldSummary
from foldback.planner.chain.built_in_modules import module_of
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import CHAIN
from foldback.planner.storage.files import json_of
from foldback.words import certificate as certificate_words
from foldback.words.failures import timeline_reader
from foldback.words.joint_errors import QUESTION, build_words
from foldback.words.likeness import likeness_words
from foldback.words.messages import diagnosis_text
from foldback.words.plan_choice import Choice
from foldback.words.quantities import sentence


def finish(
    summary: dict[str, Any],
    out: Path,
    as_json: bool,
    show_details: Callable[[dict[str, Any]], None] | None = None,
) -> NoReturn:
    """Print a plan's figures, with ``show_details`` for people; exit with 0 if verified, else 3."""
    if as_json:
        print(json.dumps(summary), flush=True)
    else:
        show(summary, out)
        if show_details is not None:
            show_details(summary)
    raise typer.Exit(0 if summary["status"] == "verified" else NOT_ACHIEVED)


def show_choice(choice: Choice | None) -> None:
    """Print the plans that were tried for a preference."""
    if choice is None:
        return
    console = Console(highlight=False)
    table = Table(*choice["columns"], box=None, pad_edge=False)
    figures = zip(*(plan["cells"] for plan in choice["plans"]), strict=True)
    for column, heading, cells in zip(
        table.columns[1:], choice["columns"][1:], figures, strict=True
    ):
        column.justify = "right"
        # As narrow as its longest word, so that headings wrap and the labels have room.
        column.width = max(map(len, (*heading.split(), *cells)))
    for plan in choice["plans"]:
        mark = "→" if plan["chosen"] else "✓" if plan["verified"] else "✗"
        table.add_row(f"{mark} {plan['label']}", *plan["cells"])
    console.print()
    console.print(table)
    console.print(choice["text"], markup=False, soft_wrap=True)


def show(summary: dict[str, Any], out: Path) -> None:
    """Print a plan's figures for people."""
    certificate, playback = summary["certificate"], summary["playback"]
    strategy = summary["explosion"].get("strategy")
    console = Console(highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)

    def row(name: str, value: float | int | str | None, unit: str = "") -> None:
        if value is not None:
            table.add_row(name, f"{value} {unit}".rstrip())

    reader = timeline_reader(cast("FoldSummary", summary))
    verdict = certificate_words.headline(certificate, reader)
    console.print(verdict, markup=False, soft_wrap=True)
    if stuck := summary["stuck"]:
        note = sentence(diagnosis_text(stuck))
        console.print(f"{note}.", markup=False, soft_wrap=True)
    if build := build_words(certificate):
        line = f"{QUESTION} {build['answer']} {build['size']}"
        console.print(line, markup=False, soft_wrap=True)
        if build["sample"]:
            console.print(build["sample"], markup=False, soft_wrap=True)
    row("Start shape", summary["refold"] and summary["refold"]["start"])
    row("Modules", summary["modules"])
    row("Likeness", likeness_words(summary.get("likeness")))
    row("Strategy", certificate_words.baseline(strategy) or strategy)
    row("Unfolding", summary["explosion"]["steps"] or None, "steps")
    row("Folding", playback and (playback["steps"] or None), "steps")
    for name, value in certificate_words.rows(certificate):
        row(sentence(name), value)
    row("Written to", str(out))
    console.print(table)
    chain = json_of(result_path(out, CHAIN))
    limit = module_of(chain.get("module", summary["module"])).largest_angle_rad
    for note in (
        certificate_words.linked(certificate),
        certificate_words.record(certificate, limit_rad=limit),
    ):
        if note is not None:
            console.print(note, markup=False, soft_wrap=True)
