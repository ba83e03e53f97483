"""Rows of a backup: one JSON array per line, with the name of its kind and the values of a row.

Rows are data: they are read into the schema that foldback's own migrations create, with its columns
and types. Anything else in the file is refused.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from io import BufferedReader
from typing import Annotated, Any, BinaryIO, Final

import msgspec
import sqlalchemy as sa
from msgspec import Meta
from sqlalchemy.exc import DataError, IntegrityError

from foldback.server.admin.errors import AdminError
from foldback.server.store.schema import STATUSES
from foldback.server.store.staged_files import RESTORED_COUNTER

SAVED_KINDS: Final = ("folds", "movies", "tours", "own_values", "counters", "secrets")
"""Kinds of rows that are in a backup; a kind comes after those that it refers to."""
UNSAVED_KINDS: Final = ("previews", "preview_reports", "workers")
"""Kinds of rows that are not in a backup: their files are not in it either, or they
describe running processes."""
ROWS_PER_BATCH: Final = 500
"""Number of rows that are read or written together."""
MAX_ROW_BYTES: Final = 8 << 20
"""Maximum size of a row in a backup, in bytes. The largest rows, tours and values of modules, take
about 100 kB."""
MAX_NUMBER: Final = 1e11
"""Maximum of a number in a row: times, in s since 1970, have dates up to it (the year 5138)."""
PATTERNS: Final = {
    ("folds", "id"): r"\A[0-9A-Za-z]{1,32}\Z",
    ("folds", "status"): rf"\A({'|'.join(STATUSES)})\Z",
    ("movies", "id"): r"\A[0-9A-Za-z]{1,32}\Z",
    ("movies", "job"): r"\A[0-9A-Za-z]+([.-][0-9A-Za-z]+)*\Z",
    ("movies", "status"): r"\A(queued|running|ready|failed)\Z",
}
"""Patterns of the columns that become paths or select code."""


def write_rows(connection: sa.Connection, file: BinaryIO) -> frozenset[str]:
    """Write the rows of a service into a file; return the ids of its folds.

    Args:
        connection: Connection to the database, which sees the same rows until the end.
        file: The file.

    Raises:
        SQLAlchemyError: If the database does not answer.
        OSError: If the file cannot be written.
    """
    encoder = msgspec.json.Encoder()
    ids: set[str] = set()
    for kind in _kinds(connection):
        name, columns = f"{kind.name}", [f"{column.name}" for column in kind.columns]
        result = connection.execution_options(yield_per=ROWS_PER_BATCH).execute(sa.select(kind))
        for values in result:
            row = dict(zip(columns, values, strict=True))
            file.write(encoder.encode([name, row]) + b"\n")
            if name == "folds":
                ids.add(row["id"])
    return frozenset(ids)


def load_rows(
    connection: sa.Connection, file: BufferedReader, names: Iterable[str]
) -> Collection[str]:
    """Insert the rows of a backup into a schema that has just been created.

    Folds without files, which were deleted while the backup was made, are left out; only cancelled
    folds may have none.

    Args:
        connection: Connection to the database, in a transaction.
        file: The rows.
        names: Names of the files in the backup.

    Returns:
        Ids of the folds that were left out.

    Raises:
        AdminError: If a row is not of a known kind, or a fold with files has no row.
        SQLAlchemyError: If the database refuses a row for other reasons.
        OSError: If the file cannot be read.
    """
    kinds = {kind.name: _RowKind.of(kind) for kind in _kinds(connection)}
    owners = {tuple(name.split("/", 2)[:2]) for name in names}
    with_files = {fold_id for key, fold_id in owners if key == "folds"}
    missing = {fold_id for _, fold_id in owners}
    left_out, started = set[str](), set[str]()
    for name, lines in _batches(file, kinds):
        kind = kinds[name]
        if name not in started:  # rows of the migrations
            started.add(name)
            connection.execute(sa.delete(kind.rows))
        rows = [kind.row_of(line, place) for place, line in lines]
        if name == "folds":
            missing_ids = {
                row["id"]
                for row in rows
                if row["id"] not in with_files and row["status"] != "cancelled"
            }
            left_out |= missing_ids
            missing.difference_update(row["id"] for row in rows)
        kept_rows = [row for row in rows if row.get(kind.fold_column) not in left_out]
        if kept_rows:
            kind.insert(connection, kept_rows)
    connection.execute(
        sa.text("DELETE FROM counters WHERE name = :name"), {"name": RESTORED_COUNTER}
    )
    if missing:
        raise _changed(f"files of the fold {min(missing)}, which has no row")
    return left_out


def _kinds(connection: sa.Connection) -> list[sa.Table]:
    """Return the kinds of rows of a database that a backup contains."""
    meta_data = sa.MetaData()
    names = sa.inspect(connection).get_table_names()
    meta_data.reflect(connection, only=[name for name in SAVED_KINDS if name in names])
    for kind in meta_data.tables.values():
        for column in kind.columns:
            if isinstance(column.type, sa.JSON):
                column.type = sa.JSON(none_as_null=True)
    return [meta_data.tables[name] for name in SAVED_KINDS if name in meta_data.tables]


@dataclass(frozen=True, slots=True)
class _RowKind:
    """A kind of rows, with their decoder.

    Attributes:
        rows: Rows in the database.
        decoder: Decoder that checks names and types of the columns.
        fold_column: Name of the column with the id of the fold.
    """

    rows: sa.Table
    decoder: msgspec.json.Decoder[msgspec.Struct]
    fold_column: str

    @classmethod
    def of(cls, kind: sa.Table) -> _RowKind:
        fields = [(f"{column.name}", _type_of(column)) for column in kind.columns]
        row = msgspec.defstruct(f"{kind.name}", fields, forbid_unknown_fields=True)
        fold_column = "id" if kind.name == "folds" else "fold_id"
        return cls(kind, msgspec.json.Decoder(row), fold_column)

    def row_of(self, line: msgspec.Raw, number: int) -> dict[str, Any]:
        try:
            return msgspec.structs.asdict(self.decoder.decode(line))
        except (msgspec.DecodeError, RecursionError) as error:
            raise _changed(f"an invalid row in line {number} ({str(error)!r})") from None

    def insert(self, connection: sa.Connection, rows: list[dict[str, Any]]) -> None:
        try:
            connection.execute(sa.insert(self.rows), rows)
        except (DataError, IntegrityError, ValueError) as error:
            error_text = str(getattr(error, "orig", error)).partition("\n")[0]
            raise _changed(f"rows of {self.rows.name} that do not fit ({error_text!r})") from None


def _type_of(column: sa.Column[Any]) -> Any:
    """Return the type of a column's values in JSON."""
    kind, name = column.type, (column.table.name, column.name)
    if isinstance(kind, sa.JSON):
        row_type: Any = dict[str, Any]
    elif isinstance(kind, sa.Boolean):
        row_type = bool
    elif isinstance(kind, sa.LargeBinary):
        row_type = bytes
    elif isinstance(kind, sa.String):
        row_type = Annotated[str, Meta(max_length=kind.length, pattern=PATTERNS.get(name))]
    elif isinstance(kind, sa.Integer):
        bits = 63 if isinstance(kind, sa.BigInteger) else 31
        row_type = Annotated[int, Meta(ge=-(2**bits), le=2**bits - 1)]
    else:
        row_type = Annotated[float, Meta(ge=0.0, le=MAX_NUMBER)]
    return row_type | None if column.nullable else row_type


def _batches(
    file: BufferedReader, kinds: Collection[str]
) -> Iterator[tuple[str, list[tuple[int, msgspec.Raw]]]]:
    """Yield successive rows of one kind: its name, and the number and text of each line."""
    decoder = msgspec.json.Decoder(tuple[str, msgspec.Raw])
    current, batch, size = "", list[tuple[int, msgspec.Raw]](), 0
    for number, line in enumerate(iter(lambda: file.readline(MAX_ROW_BYTES + 1), b""), start=1):
        if len(line) > MAX_ROW_BYTES:
            raise _changed(f"a row of more than {MAX_ROW_BYTES >> 20} MiB in line {number}")
        try:
            name, row = decoder.decode(line)
        except (msgspec.DecodeError, RecursionError) as error:
            raise _changed(f"an invalid row in line {number} ({str(error)!r})") from None
        if name not in kinds:
            raise _changed(f"a row of the unknown kind {name[:40]!r} in line {number}")
        if batch and (
            name != current or len(batch) == ROWS_PER_BATCH or size + len(line) > MAX_ROW_BYTES
        ):
            yield current, batch
            batch, size = [], 0
        current = name
        batch.append((number, row))
        size += len(line)
    if batch:
        yield current, batch


def _changed(change: str) -> AdminError:
    return AdminError(
        f"got a backup with {change}; use another backup, because this one was changed. Nothing "
        "was "
        "restored."
    )
