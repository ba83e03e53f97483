"""``foldback tour``: draft a tour of a fold from its results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.inputs import read_plan, refuse
from foldback.cli.options import AsJson, FoldDirectory
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.derived_files import completed
from foldback.planner.pipeline.fold_layout import result_path, stored_moments
from foldback.planner.plan.moments import Moments
from foldback.planner.plan.tour import Tour
from foldback.planner.storage.file_names import TIMELINE, TOUR
from foldback.planner.storage.files import json_of, write_whole
from foldback.words.fold import ShownFold
from foldback.words.tour import draft_tour


def tour(
    directory: FoldDirectory,
    out: Annotated[
        Path | None, typer.Option(help="Output file for the tour, in the format foldback-tour/1.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draft a tour of a fold: captions for its most important frames."""
    try:
        draft = drafted(directory)
        if out is not None:
            _write(out, draft)
    except InputError as error:
        refuse(error, as_json)
    if as_json:
        print(json.dumps(draft.as_dict()), flush=True)
        return
    grid = Table(box=None, show_header=False, pad_edge=False)
    for stop in draft.stops:
        grid.add_row(f"Frame {stop.frame}", stop.caption)
    Console(highlight=False).print(grid)


def stored_tour(directory: Path) -> Tour | None:
    """Return the tour in a fold's directory; None if there is no valid one."""
    try:
        return Tour.from_dict(json_of(directory / TOUR))
    except InputError:
        return None


def drafted(directory: Path) -> Tour:
    """Return the draft of a fold's directory.

    Raises:
        InputError: If there is no plan or timeline, or the timeline is damaged or empty.
    """
    drafted = draft_tour(*facts_of(directory))
    if drafted is None:
        raise InputError(
            "no-frames", "got a fold without frames, expected a fold with at least one frame."
        )
    return drafted


def facts_of(directory: Path) -> tuple[ShownFold, int, Moments | None]:
    """Return the facts, the number of frames and the moments of a fold's directory.

    Raises:
        InputError: If there is no plan or timeline, or the timeline is damaged.
    """
    plan = read_plan(directory)
    summary = plan.summary()
    row = ShownFold(
        id="",
        name=summary["name"],
        status=summary["status"],
        modules=summary["modules"],
        module=summary["module"],
        module_words=summary["module_words"],
        preset=plan.preset,
        seed=plan.seed,
        summary=summary,  # pyright: ignore[reportArgumentType]
    )
    try:
        with completed(directory) as derived_dir:
            moments = stored_moments(derived_dir)
        return row, len(Timeline.open(result_path(directory, TIMELINE))), moments
    except TimelineError as error:
        raise InputError("no-frames", f"{error}") from error


def _write(out: Path, tour: Tour) -> None:
    try:
        write_whole(out, json.dumps(tour.as_dict(), indent=2, ensure_ascii=False).encode())
    except OSError as error:
        raise InputError(
            "no-file", f"cannot be written ({error.strerror}).", where=str(out)
        ) from error
