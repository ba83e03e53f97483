"""``foldback admin``: list, delete, repeat and pin the folds of a service."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from server.ops.starting import settings_of

if TYPE_CHECKING:
    from server.cli.admin_tasks import AdminTasks
    from server.store.tables import FoldRow

Status = Literal["queued", "running", "verified", "failed", "cancelled"]
DataDir = Annotated[Path | None, typer.Option(help="Data directory of the service.")]
AsJson = Annotated[bool, typer.Option("--json", help="As JSON.")]
Ids = Annotated[list[str], typer.Argument(help="Ids of the folds.")]
Force = Annotated[
    bool, typer.Option("--force", help="Also act in cases that are normally refused.")
]
FOLD_LIST_COLUMNS: Final = ("id", "status", "stage", "modules", "age", "bytes", "visitor", "kept")
PSEUDONYM_CHARACTERS: Final = 8
"""Number of first characters of a visitor's pseudonym that the operator's lists display. They are
part of the hash of the visitor's network of IP addresses, so visitors of one network look the same.
A larger value makes the lists wider. Chosen."""

admin = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="List, delete, repeat and pin folds of a service.",
)


@contextmanager
def _tasks(data_dir: Path | None) -> Generator[AdminTasks]:
    """An operator's tasks with these settings; what is wrong ends the command in words."""
    from sqlalchemy.exc import SQLAlchemyError

    from server.cli.admin_tasks import AdminError, AdminTasks

    try:
        tasks = AdminTasks(settings_of(data_dir=data_dir))
    except AdminError as error:
        raise _ended(str(error)) from None
    except SQLAlchemyError as error:
        raise _ended(
            f"the database does not answer ({type(error).__name__}); run `foldback doctor` for "
            "details."
        ) from None
    try:
        yield tasks
    finally:
        tasks.close()


def _ended(words: str) -> typer.Exit:
    typer.echo(words, err=True)
    return typer.Exit(1)


@admin.command("list")
def list_folds(
    status: Annotated[Status | None, typer.Option(help="Only folds with this status.")] = None,
    older: Annotated[
        float | None,
        typer.Option(min=0, help=("Only folds that have not been used for this many days.")),
    ] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """List folds, oldest first."""
    with _tasks(data_dir) as tasks:
        rows = [_shown(row) for row in tasks.folds(status=status, older_days=older)]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    _table(FOLD_LIST_COLUMNS, [_words(row) for row in rows])


@admin.command()
def show(fold_id: str, as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """Show the details of a fold."""
    from server.store.folds import NoSuchFoldError

    with _tasks(data_dir) as tasks:
        try:
            row = tasks.fold(fold_id)
        except NoSuchFoldError:
            raise _ended(f"There is no fold {fold_id!r}.") from None
        known = {column.key: getattr(row, column.key) for column in row.__table__.columns}
        known |= {
            "visitor": row.visitor[:PSEUDONYM_CHARACTERS],
            "owner": row.owner is not None,
            "job": None if row.over else row.status,
        }
    if as_json:
        typer.echo(json.dumps(known, indent=2))
        return
    for name, value in known.items():
        typer.echo(f"{name:<16} {json.dumps(value)}")


@admin.command()
def expire(
    ids: Annotated[list[str] | None, typer.Argument(help="Ids of the folds.")] = None,
    older: Annotated[
        float | None,
        typer.Option(
            min=0, help=("Instead of ids: folds that have not been used for this many days.")
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")] = False,
    force: Force = False,
    data_dir: DataDir = None,
) -> None:
    """Delete folds and their files. Pinned folds and gallery folds stay."""
    if bool(ids) == (older is not None):
        raise typer.BadParameter("give ids or --older DAYS, and not both.")
    with _tasks(data_dir) as tasks:
        if older is not None:
            rows = tasks.folds(older_days=older)
            ids = [row.id for row in rows if force or not (row.pinned or row.public)]
        assert ids is not None
        if not ids:
            typer.echo("Nothing to delete.")
            return
        if not yes:
            typer.confirm(f"Permanently delete {len(ids)} folds?", abort=True)
        _each(ids, lambda fold_id: tasks.expire(fold_id, force=force), "forgotten")


@admin.command()
def requeue(ids: Ids, force: Force = False, data_dir: DataDir = None) -> None:
    """Compute failed, cancelled or unresponsive folds again."""
    with _tasks(data_dir) as tasks:
        _each(ids, lambda fold_id: tasks.requeue(fold_id, force=force), "queued")


@admin.command()
def pin(ids: Ids, data_dir: DataDir = None) -> None:
    """Pin folds, so that they do not expire."""
    with _tasks(data_dir) as tasks:
        _each(ids, lambda fold_id: tasks.pin(fold_id, pinned=True), "pinned")


@admin.command()
def unpin(ids: Ids, data_dir: DataDir = None) -> None:
    """Unpin folds, so that they can expire again."""
    with _tasks(data_dir) as tasks:
        _each(ids, lambda fold_id: tasks.pin(fold_id, pinned=False), "not pinned")


@admin.command()
def damaged(data_dir: DataDir = None) -> None:
    """List folds whose files are missing or changed; exits with 1 if there are any."""
    with _tasks(data_dir) as tasks:
        rows = [(row.id, row.name, ", ".join(names)) for row, names in tasks.damaged()]
    if not rows:
        typer.echo("no fold is damaged")
        return
    _table(("id", "name", "damaged files"), rows)
    raise typer.Exit(1)


@admin.command()
def workers(as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """List the workers."""
    with _tasks(data_dir) as tasks:
        found = tasks.workers()
    now = time.time()
    rows = [
        {
            "name": row.name,
            "host": row.host,
            "pid": row.pid,
            "folds_at_once": row.folds_at_once,
            "version": row.version,
            "age_s": round(now - row.started_at, 1),
            "beat": row.beat,
        }
        for row in found
    ]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    if rows:
        _table(tuple(rows[0]), [[str(value) for value in row.values()] for row in rows])
    else:
        typer.echo("No worker is running.")


def _each(ids: Sequence[str], do: Callable[[str], None], done: str) -> None:
    """Apply a task to each fold; a refusal does not stop the others."""
    from server.cli.admin_tasks import AdminError
    from server.store.folds import NoSuchFoldError

    refused = 0
    for fold_id in ids:
        try:
            do(fold_id)
        except NoSuchFoldError:
            typer.echo(f"There is no fold {fold_id!r}.", err=True)
            refused += 1
        except AdminError as error:
            typer.echo(str(error), err=True)
            refused += 1
        else:
            typer.echo(f"{fold_id} is {done}.")
    if refused:
        raise typer.Exit(1)


def _shown(row: FoldRow) -> dict[str, Any]:
    """Return the listed facts of a fold: none that grants access or that a visitor wrote."""
    return {
        "id": row.id,
        "status": row.status,
        "stage": row.stage,
        "modules": row.modules,
        "age_s": round(time.time() - row.created_at, 1),
        "bytes": row.bytes,
        "visitor": row.visitor[:PSEUDONYM_CHARACTERS],
        "pinned": row.pinned,
        "gallery": row.public,
    }


def _words(row: dict[str, Any]) -> list[str]:
    kept = [word for word in ("pinned", "gallery") if row[word]]
    shown = {**row, "age": _age(row["age_s"]), "kept": ", ".join(kept)}
    return ["" if shown[name] is None else str(shown[name]) for name in FOLD_LIST_COLUMNS]


def _age(seconds: float) -> str:
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(0.0, seconds):.0f} s"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for row in (heads, *rows):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        typer.echo("  ".join(cells).rstrip())
