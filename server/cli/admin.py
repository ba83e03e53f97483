"""``foldback admin``: commands of operators for folds, backups and the database."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from foldback.server.ops.startup_errors import settings_of

if TYPE_CHECKING:
    from foldback.server.admin.fold_tasks import AdminTasks
    from foldback.server.store.schema import FoldRow

Status = Literal["queued", "running", "verified", "failed", "cancelled"]
DataDir = Annotated[Path | None, typer.Option(help="Data directory of the service.")]
AsJson = Annotated[bool, typer.Option("--json", help="As JSON.")]
Ids = Annotated[list[str], typer.Argument(help="Ids of the folds.")]
BackupDirectory = Annotated[Path, typer.Argument(help="Directory of the backup.")]
FOLD_LIST_COLUMNS: Final = ("id", "status", "stage", "modules", "age", "bytes", "visitor", "kept")
PSEUDONYM_CHARACTERS: Final = 8
"""Number of first characters of a visitor's pseudonym that the operator's lists display. They are
part of the hash of the visitor's network of IP addresses, so visitors of one network look the
same."""
PENDING_EXIT_CODE: Final = 3
"""Exit code of ``migrate --check`` if the database is of an older version, which a
migration would change. Scripts can tell it from 0 (up to date) and 1 (error)."""

admin = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Manage the folds, backups and database of a service.",
)


@contextmanager
def _refusals() -> Generator[None]:
    """Turn an error of a task into one line and the exit code 1."""
    from sqlalchemy.exc import SQLAlchemyError

    from foldback.server.admin.errors import AdminError
    from foldback.server.store.folds import NoSuchFoldError
    from foldback.server.store.object_store import StorageError
    from foldback.server.store.schema_version import NewerSchemaError

    try:
        yield
    except (AdminError, NewerSchemaError) as error:
        words = str(error)
    except NoSuchFoldError:
        words = "There is no fold with this id."
    except SQLAlchemyError as error:
        words = f"the database does not answer ({type(error).__name__}); run `foldback doctor`."
    except StorageError as error:
        words = f"{str(error).removesuffix('.')}; run `foldback doctor`."
    except OSError as error:
        words = f"{error.filename or 'a file'} cannot be used ({error.strerror})."
    else:
        return
    typer.echo(words, err=True)
    raise typer.Exit(1)


@contextmanager
def _tasks(data_dir: Path | None) -> Generator[AdminTasks]:
    from foldback.server.admin.fold_tasks import AdminTasks

    with _refusals(), closing(AdminTasks(settings_of(data_dir=data_dir))) as tasks:
        yield tasks


@admin.command("list")
def list_folds(
    status: Annotated[Status | None, typer.Option(help="List only folds with this status.")] = None,
    older: Annotated[
        float | None,
        typer.Option(min=0, help="List only folds that have not been used for this many days."),
    ] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """List folds, oldest first."""
    with _tasks(data_dir) as tasks:
        rows = [_shown(row) for row in tasks.folds(status=status, older_days=older)]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
    else:
        _show_rows(FOLD_LIST_COLUMNS, [_words(row) for row in rows])


@admin.command()
def show(fold_id: str, as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """Show the details of a fold."""
    with _tasks(data_dir) as tasks:
        row = tasks.fold(fold_id)
    values = {column.key: getattr(row, column.key) for column in row.__table__.columns} | {
        "visitor": row.visitor[:PSEUDONYM_CHARACTERS],
        "owner": row.owner is not None,
        "job": None if row.over else row.status,
    }
    if as_json:
        typer.echo(json.dumps(values, indent=2))
        return
    for name, value in values.items():
        typer.echo(f"{name:<16} {json.dumps(value)}")


@admin.command()
def expire(
    ids: Annotated[list[str] | None, typer.Argument(help="Ids of the folds.")] = None,
    older: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="Instead of ids: delete all folds that have not been used for this many days.",
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Also delete pinned folds and gallery folds.")
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Delete folds and their files. Pinned folds and gallery folds are kept."""
    if bool(ids) == (older is not None):
        raise typer.BadParameter("give either ids or --older DAYS.")
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
        _each(ids, lambda fold_id: tasks.expire(fold_id, force=force), "deleted")


@admin.command()
def requeue(
    ids: Ids,
    force: Annotated[bool, typer.Option("--force", help="Also recompute verified folds.")] = False,
    data_dir: DataDir = None,
) -> None:
    """Recompute folds that failed or were cancelled, from the beginning."""
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
    """List folds whose files are missing or changed; exits with 1 if there are such folds."""
    with _tasks(data_dir) as tasks:
        rows = [(row.id, row.name, ", ".join(names)) for row, names in tasks.damaged()]
    if not rows:
        typer.echo("no fold is damaged")
        return
    _show_rows(("id", "name", "damaged files"), rows)
    raise typer.Exit(1)


@admin.command()
def workers(as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """List the workers."""
    column_names = ("name", "host", "pid", "folds_at_once", "version")
    with _tasks(data_dir) as tasks:
        rows: list[dict[str, Any]] = [
            {name: getattr(row, name) for name in column_names}
            | {"age_s": round(time.time() - row.started_at, 1)}
            for row in tasks.workers()
        ]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
    elif rows:
        _show_rows(tuple(rows[0]), [[str(value) for value in row.values()] for row in rows])
    else:
        typer.echo("No worker is running.")


@admin.command()
def backup(directory: BackupDirectory, data_dir: DataDir = None) -> None:
    """Back up the database and files to a new directory; the service may keep running."""
    from foldback.server.admin.backup import back_up

    with _refusals():
        manifest = back_up(settings_of(data_dir=data_dir), directory)
    size = manifest.total_bytes
    typer.echo(f"{directory}: {len(manifest.files)} fold files, {size} bytes in total.")


@admin.command()
def restore(
    directory: BackupDirectory,
    replace: Annotated[
        bool,
        typer.Option("--replace", help="Replace the service's current data with the backup."),
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Restore a backup. Stop all web processes and workers first."""
    from foldback.server.admin import backup

    with _refusals():
        done = backup.restore(settings_of(data_dir=data_dir), directory, replace=replace)
    date = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(done.manifest.created_at))
    typer.echo(f"Restored the backup of {date}: {len(done.manifest.files)} fold files.")
    if done.left_out:
        typer.echo(f"Left out {done.left_out} folds that were deleted during the backup.")


@admin.command()
def migrate(
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Only list the changes. Exits with 3 if there are changes, and with 0 if not.",
        ),
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Update the database to this version of foldback, as the service does when it starts."""
    from foldback.server.admin.migration import pending_changes, run_migration

    settings = settings_of(data_dir=data_dir)
    with _refusals():
        changes = pending_changes(settings)
        if changes and not check:
            run_migration(settings)
    for change in changes:
        typer.echo(f"{'would migrate' if check else 'migrated'} {change}")
    if not changes:
        typer.echo("The database is up to date.")
    elif check:
        raise typer.Exit(PENDING_EXIT_CODE)


def _each(ids: Sequence[str], do: Callable[[str], None], done: str) -> None:
    """Apply a task to each fold; a refusal does not stop the others.

    Args:
        ids: Ids of the folds.
        do: The task.
        done: State of a fold after it, for a message.
    """
    from foldback.server.admin.errors import AdminError
    from foldback.server.store.folds import NoSuchFoldError

    refused = False
    for fold_id in ids:
        try:
            do(fold_id)
        except (NoSuchFoldError, AdminError) as error:
            is_missing = isinstance(error, NoSuchFoldError)
            typer.echo(f"There is no fold {fold_id!r}." if is_missing else error, err=True)
            refused = True
        else:
            typer.echo(f"{fold_id} is {done}.")
    if refused:
        raise typer.Exit(1)


def _shown(row: FoldRow) -> dict[str, Any]:
    """Return the listed facts of a fold, without secrets and without text of visitors."""
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
    marks = [word for word in ("pinned", "gallery") if row[word]]
    cells = {**row, "age": _age(row["age_s"]), "kept": ", ".join(marks)}
    return ["" if cells[name] is None else str(cells[name]) for name in FOLD_LIST_COLUMNS]


def _age(seconds: float) -> str:
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(0.0, seconds):.0f} s"


def _show_rows(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for row in (heads, *rows):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        typer.echo("  ".join(cells).rstrip())
