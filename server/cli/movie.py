"""``foldback movie``: films a fold's directory as MP4 or GIF."""

from __future__ import annotations

import json
import shutil
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from cli.inputs import refuse
from cli.options import AsJson, FoldDirectory
from planner.errors import InputError
from planner.file_names import TIMELINE
from planner.pipeline.fold_layout import result
from server.ops.starting import settings_of
from server.processes.children import ChildError
from server.processes.limits import ChildLimits
from server.processes.movie_task import ask_for_movie, is_on_table, run_movie
from web.movies.movie import FORMATS, Movie


def movie(
    *,
    directory: FoldDirectory,
    out: Annotated[Path, typer.Option(help="The file to write: .mp4 or .gif.")] = Path("fold.mp4"),
    width: Annotated[int | None, typer.Option(help="Width in pixels, even.")] = None,
    height: Annotated[int | None, typer.Option(help="Height in pixels, even.")] = None,
    fps: Annotated[int | None, typer.Option(help="Pictures per second.")] = None,
    seconds: Annotated[float | None, typer.Option(help="Length in seconds.")] = None,
    azimuth: Annotated[
        float | None,
        typer.Option(help=("Viewing direction in degrees. Default: chosen from the shape.")),
    ] = None,
    elevation: Annotated[
        float | None, typer.Option(help=("Camera angle above the ground, degrees."))
    ] = None,
    turn: Annotated[
        float | None, typer.Option(help="Angle through which the camera circles, degrees.")
    ] = None,
    theme: Annotated[str | None, typer.Option(help="light or dark.")] = None,
    first: Annotated[
        int | None,
        typer.Option("--from", help="First frame. Default: the first frame of the playback."),
    ] = None,
    last: Annotated[
        int | None,
        typer.Option("--to", help=("Last frame. A frame before the first one plays backwards.")),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make a movie of a fold: the straight chain folds into its shape."""
    try:
        movie = Movie.of(
            {
                "format": _format_of(out),
                "width": width,
                "height": height,
                "fps": fps,
                "seconds": seconds,
                "azimuth_deg": azimuth,
                "elevation_deg": elevation,
                "turn_deg": turn,
                "theme": theme,
                "first_frame": first,
                "last_frame": last,
            }
        )
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


def _format_of(out: Path) -> str:
    """Return the format of a movie by the name of its file, whose folder must exist."""
    kind = out.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(
            "bad-movie", f"got the file {out.name!r}, expected one that ends in .mp4 or .gif."
        )
    if not out.resolve().parent.is_dir():
        raise InputError("no-directory", "the folder of the movie does not exist.", where=str(out))
    return kind


def _timeline_of(directory: Path) -> Path:
    """Return the timeline in a fold's directory."""
    timeline = result(directory.resolve(), TIMELINE)
    if not timeline.is_dir():
        raise InputError(
            "no-directory",
            "it contains no timeline; expected a folder that `foldback fold` wrote.",
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
        shutil.move(place / "movie", out)
