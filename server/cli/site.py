"""``foldback site``: creates a static website of folds, the paper's experiments and benchmarks."""

from __future__ import annotations

import json
import re
import tempfile
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from shutil import copyfile, copytree
from typing import Annotated
from urllib.parse import urlsplit

import typer
from rich.console import Console

from foldback.cli.inputs import refuse
from foldback.cli.options import AsJson
from foldback.planner.errors import InputError, PlannerError
from foldback.planner.pipeline.derived_files import completed
from foldback.planner.pipeline.fold_layout import holds_fold, result_path
from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.storage.output_directory import replacing_listed
from foldback.planner.sweeps.map import PAGE, PICTURE, PLAYERS_DIR
from foldback.planner.sweeps.rows import CSV, PARQUET
from foldback.planner.verification.stored_fold import check_fold
from foldback.server.cli.play import row_of
from foldback.server.pages import site as pages
from foldback.server.store.fold_source import LocatedFold
from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR


def site(
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Directory for the site; created if missing.")
    ],
    folds: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            help="Directory of a fold, or of several folds. You can repeat this option.",
        ),
    ] = None,
    sweeps: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="Directory of a sweep. You can repeat this option."),
    ] = None,
    finished: Annotated[
        bool, typer.Option(help="Include the finished folds that come with foldback.")
    ] = True,
    service: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Address of the service that *Fold your own* links to. Default: no such link.",
        ),
    ] = None,
    project: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Address of foldback's project, to which the first page links. Default: the page "
            "with the paper's experiments.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Create a static website: folds, the published paper's experiments, benchmarks."""
    try:
        for address in (service, project):
            _check_address(address)
        if holds_fold(out):
            raise InputError(
                "another-fold",
                "got the folder of a fold for the site. Choose another folder.",
                where=str(out),
            )
        with (
            replacing_listed(out, None) as place,
            _shipped(finished) as shipped,
            ExitStack() as opened,
        ):
            for directory in folds or ():
                for folder in _folds_in(directory):
                    check_fold(folder)
                    derived_dir = opened.enter_context(completed(folder))
                    shipped.append(replace(_found(folder, folder.name), derived=derived_dir))
            shipped = _named_apart(shipped)
            if not shipped:
                raise InputError("no-folds", "got no folds, expected --folds or --finished.")
            names = [_add_sweep(directory, place) for directory in sweeps or ()]
            pages.write_site(place, shipped, service, names, project)
    except InputError as error:
        refuse(error, as_json)
    except PlannerError as error:
        refuse(InputError("no-fold", str(error)), as_json)
    except OSError as error:
        detail = f"the file cannot be written ({error.strerror})."
        refuse(InputError("no-file", detail, where=str(error.filename or out)), as_json)
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    if as_json:
        print(json.dumps({"directory": str(out), "folds": len(shipped), "bytes": size}), flush=True)
        return
    number = "1 fold" if len(shipped) == 1 else f"{len(shipped)} folds"
    Console(soft_wrap=True, highlight=False).print(
        f"{out}: {number}, {size / 1e6:.1f} MB; open {out / 'index.html'}", markup=False
    )


def write_players(out: Path, directories: Sequence[Path]) -> None:
    """Write pages that play the plans of a sweep, whose map is in the directory above.

    Args:
        out: Directory of the pages.
        directories: Directories of folds, whose names are keys.
    """

    def folds() -> Generator[LocatedFold]:
        for directory in directories:
            with suppress(PlannerError), completed(directory) as derived:
                yield replace(_found(directory, directory.name), derived=derived)

    if directories:
        pages.write_players(out, folds(), "../index.html")


def _add_sweep(directory: Path, site_dir: Path) -> str:
    """Copy the page of a sweep, its tables and its players into a site; return its name there."""
    files = (PAGE, PICTURE, PARQUET, CSV)
    if missing := next((name for name in files if not (directory / name).is_file()), None):
        raise InputError(
            "no-sweep",
            f"got no {missing}, expected the directory of a sweep; foldback sweep writes it.",
            where=str(directory),
        )
    folder = re.sub(r"[^A-Za-z0-9_-]+", "-", directory.resolve().name).strip("-") or "sweep"
    target = site_dir / "sweeps" / folder
    if target.exists():
        raise InputError(
            "no-sweep",
            f"got two sweeps with the name {folder!r}, expected one; rename one of them.",
        )
    target.mkdir(parents=True)
    for name in files:
        copyfile(directory / name, target / name)
    if (directory / PLAYERS_DIR).is_dir():
        copytree(directory / PLAYERS_DIR, target / PLAYERS_DIR)
    return folder


def _check_address(address: str | None) -> None:
    """Raise InputError unless an address is a valid target of a link, or None."""
    parts = urlsplit(address or "https://none")
    if parts.scheme not in ("http", "https") or not parts.hostname:
        detail = f"got {address!r}, expected an address such as https://fold.example.org."
        raise InputError("bad-service", detail)


@contextmanager
def _shipped(finished: bool) -> Generator[list[LocatedFold]]:
    """Unpack the finished folds of the package for the duration of a context."""
    with tempfile.TemporaryDirectory(prefix="foldback-site-") as place:
        folds: list[LocatedFold] = []
        for path in sorted(SHIPPED_FOLDS_DIR.glob("*.fold")) if finished else ():
            directory = Path(place) / path.stem
            directory.mkdir()
            about = unpack(path.read_bytes(), directory)
            located = _found(directory, path.stem)
            row = replace(located.row, name=about["name"], refold=about["refold"])
            folds.append(replace(located, row=row))
        yield folds


def _folds_in(directory: Path) -> list[Path]:
    """Return the directory if it is a fold, else the folds in it."""
    if result_path(directory, TIMELINE).exists():
        return [directory]
    inside = sorted(directory.iterdir()) if directory.is_dir() else []
    if not (folds := [folder for folder in inside if result_path(folder, TIMELINE).exists()]):
        detail = (
            "found no fold at this path; expected a folder that `foldback fold` wrote, or a "
            "folder with several such folders."
        )
        raise InputError("no-fold", detail, where=str(directory))
    return folds


def _found(directory: Path, name: str) -> LocatedFold:
    """Return a fold with an id that is valid in addresses."""
    fold_id = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:60] or "fold"
    return LocatedFold(replace(row_of(directory), id=fold_id), directory)


def _named_apart(folds: list[LocatedFold]) -> list[LocatedFold]:
    """Return the folds, shortest chain first, with unique ids."""
    apart: dict[str, LocatedFold] = {}
    for fold in sorted(folds, key=lambda fold: (fold.row.modules, fold.row.name)):
        ids = (fold.row.id if k == 1 else f"{fold.row.id}-{k}" for k in count(1))
        fold_id = next(candidate for candidate in ids if candidate not in apart)
        apart[fold_id] = replace(fold, row=replace(fold.row, id=fold_id))
    return _titled_apart(list(apart.values()))


def _titled_apart(folds: list[LocatedFold]) -> list[LocatedFold]:
    """Return the folds with different titles: equal ones get their size or, if equal, their id."""
    for suffix in ("{title}, {row.counted}", "{row.id}"):
        titles = Counter(fold.row.title for fold in folds)
        folds = [
            replace(
                fold,
                row=replace(row, renamed=True, name=suffix.format(title=row.title, row=row)),
            )
            if titles[(row := fold.row).title] > 1
            else fold
            for fold in folds
        ]
    return folds
