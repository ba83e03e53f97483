"""``foldback movie``: creates a movie of a fold's directory, as MP4 or GIF."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from foldback.cli.inputs import refuse
from foldback.cli.options import AsJson, FoldDirectory, with_parameters
from foldback.cli.tour import drafted, stored_tour
from foldback.planner.errors import InputError
from foldback.planner.pipeline.fold_layout import is_on_table, result_path
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.storage.files import written_aside
from foldback.planner.verification.stored_fold import check_fold
from foldback.server.ops.startup_errors import settings_of
from foldback.server.processes.children import ChildError
from foldback.server.processes.limits import ChildLimits
from foldback.server.processes.movie_task import ask_for_movie, check_movie, run_movie
from foldback.web.movies.movie import FORMATS, Movie

MOVIE_OPTIONS: Final[dict[str, tuple[str, type, str]]] = {
    "width": ("--width", int, "Width in pixels; must be an even number."),
    "height": ("--height", int, "Height in pixels; must be an even number."),
    "fps": ("--fps", int, "Pictures per second."),
    "seconds": ("--seconds", float, "Length in seconds."),
    "azimuth_deg": (
        "--azimuth",
        float,
        "Direction of the camera at the end, degrees: -90 is the front, 0 the right. "
        "Default: chosen from the shape.",
    ),
    "elevation_deg": ("--elevation", float, "Camera angle above the ground, degrees."),
    "turn_deg": ("--turn", float, "Angle through which the camera circles, degrees."),
    "theme": ("--theme", str, "Colours: light or dark."),
    "first_frame": (
        "--from",
        int,
        "First frame, from 0. Default: the first frame of the playback.",
    ),
    "last_frame": (
        "--to",
        int,
        "Last frame, from 0. If it is before the first frame, the movie plays backwards.",
    ),
}
"""Options of a movie on the command line: flag, type and help, by the field of ``Movie``."""


def _with_movie_options(command: Callable[..., None]) -> Callable[..., None]:
    """Replace the parameter ``options`` of a command by an option for each of ``MOVIE_OPTIONS``."""
    *own_parameters, _, last = signature(command, eval_str=True).parameters.values()
    added = (
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[kind | None, typer.Option(flag, help=line)],
        )
        for name, (flag, kind, line) in MOVIE_OPTIONS.items()
    )

    @wraps(command)
    def call(*, directory: Path, out: Path, tour: bool, as_json: bool, **options: Any) -> None:
        command(directory=directory, out=out, tour=tour, options=options, as_json=as_json)

    return with_parameters(call, [*own_parameters, *added, last])


@_with_movie_options
def movie(
    *,
    directory: FoldDirectory,
    out: Annotated[Path, typer.Option(help="The file to write: .mp4 or .gif.")] = Path("fold.mp4"),
    tour: Annotated[
        bool,
        typer.Option(
            "--tour",
            help="Pause at the stops of the fold's tour (see `foldback tour`) and show their "
            "captions.",
        ),
    ] = False,
    options: dict[str, Any],
    as_json: AsJson = False,
) -> None:
    """Make a movie of a fold: the straight chain folds into its shape."""
    try:
        check_fold(directory)
        tour_values = _tour_of(directory) if tour else None
        movie = Movie.of({"format": _format_of(out), **options}, tour_values)
        check_movie(movie.format)
        _make(movie, _timeline_of(directory), out, on_table=is_on_table(directory))
    except InputError as error:
        refuse(error, as_json)
    except ChildError as error:
        Console(stderr=True, soft_wrap=True).print(f"{error.code}: {error.detail}", markup=False)
        raise typer.Exit(1) from error
    megabytes = out.stat().st_size / 1e6
    if as_json:
        print(json.dumps({"file": str(out), "pictures": movie.count, **asdict(movie)}))
    else:
        Console().print(f"{out}: {movie.count} pictures, {megabytes:.1f} MB", markup=False)


def _tour_of(directory: Path) -> dict[str, Any]:
    """Return the tour in a fold's directory, or a draft."""
    return (stored_tour(directory) or drafted(directory)).as_dict()


def _format_of(out: Path) -> str:
    """Return the format of a movie by its file's name; check that its directory exists."""
    kind = out.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(
            "bad-movie", f"got the file {out.name!r}, expected one that ends in .mp4 or .gif."
        )
    if not out.resolve().parent.is_dir():
        raise InputError(
            "no-directory",
            "the folder for the movie does not exist; create it first.",
            where=str(out),
        )
    return kind


def _timeline_of(directory: Path) -> Path:
    """Return the timeline in a fold's directory."""
    timeline = result_path(directory.resolve(), TIMELINE)
    if not timeline.is_dir():
        raise InputError(
            "no-directory",
            "found no timeline at this path; expected a folder that `foldback fold` wrote.",
            where=str(directory),
        )
    return timeline


def _make(movie: Movie, timeline: Path, out: Path, *, on_table: bool) -> None:
    settings = settings_of()
    with (
        tempfile.TemporaryDirectory(prefix="foldback-movie-") as folder,
        Progress(
            TextColumn("filming"),
            BarColumn(),
            TextColumn("{task.completed:.0f} of {task.total:.0f} pictures"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        ) as bars,
    ):
        place = Path(folder)
        ask_for_movie(place, asdict(movie), timeline, "movie", on_table=on_table)
        bar = bars.add_task("", total=movie.count)

        def report(event: dict[str, Any]) -> None:
            bars.update(bar, completed=event["steps"])

        run_movie(
            place,
            ChildLimits.of(settings),
            wall_s=float("inf"),
            on_progress=report,
            cancelled=lambda: False,
        )
        with written_aside(out) as partial_path:  # on another disk, it is copied
            shutil.move(place / "movie", partial_path)
