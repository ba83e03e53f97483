"""Schema of the service's database: rows, engines, and the migration to the newest version."""

from __future__ import annotations

import errno
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

import sqlalchemy as sa
from sqlalchemy import event
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from foldback.planner.chain.module_file import MAX_MODULE_NAME
from foldback.planner.pathfinding.path_options import MODULE_CHOICES
from foldback.planner.pipeline.request import FoldRequest

if TYPE_CHECKING:
    from foldback.server.settings import Settings
    from foldback.words.fold import ShownFold


class Base(DeclarativeBase):
    """Base class of all rows."""

    type_annotation_map = {dict[str, Any]: sa.JSON(), float: sa.Double()}


class FoldRow(Base):
    """One fold of a visitor.

    ``module`` is the name of its modules, and ``module_words`` what they are called, None if
    foldback ships them.
    ``status`` is one of ``STATUSES``; ``stage`` is one of ``planner.progress.STAGES`` or None;
    ``refold`` is the name of the initial shape of a refold, None if the chain starts straight;
    ``smooths`` is the id of the fold whose plan is smoothed, None for a recorded plan;
    ``prefer`` is the objective for choosing among several plans, see
    ``planner.pipeline.preference``; ``world`` is one of
    ``planner.parameters.parameters.WORLD_CHOICES``; ``settings`` are the changes to the preset, as
    written by ``planner.parameters.settings_text.settings_text``.

    ``turn`` is its virtual finish time, by which the queue is ordered, and ``cost_s`` its expected
    computing time. ``worker`` is the execution that computes it: the name of the worker and a
    random part; None if there is none. ``epoch`` counts the executions, each of which writes its
    own files. ``checkpoint`` is the next stage after the last finished one, see
    ``server.jobs.queue``, and ``losses`` counts the executions since then whose worker died.
    Readers see the files of epoch ``kept``.
    ``bytes`` is the size of its own files, from its acceptance on; ``derived_bytes`` is the size of
    its exports and pictures, which can be computed again. ``seen_at`` is the time of the last
    access, or of its request or end if that was later. A ``pinned`` fold never expires.

    ``owner`` is the hash of its owner's token, None for a ``public`` fold that several clients have
    requested. ``maker`` is the hash of the token of the first request, in whose owner's list the
    fold stays. ``renamed`` is True if its owner has set ``name``.

    ``pauses`` counts its pauses for other folds; ``resumed_at`` is the time at which ``worker``
    started or resumed it.
    """

    __tablename__ = "folds"
    __table_args__ = (
        sa.Index("ix_folds_status_seen_at", "status", "seen_at"),
        sa.Index("ix_folds_visitor_status_seen_at", "visitor", "status", "seen_at"),
        sa.Index("ix_folds_public_status", "public", "status"),
        sa.Index("ix_folds_worker", "worker"),
    )

    id: Mapped[str] = mapped_column(sa.String(32), primary_key=True)
    name: Mapped[str] = mapped_column(sa.String(200))
    status: Mapped[str] = mapped_column(sa.String(16))
    stage: Mapped[str | None] = mapped_column(sa.String(16))
    created_at: Mapped[float] = mapped_column(index=True)
    started_at: Mapped[float | None]
    ended_at: Mapped[float | None]
    modules: Mapped[int]
    module: Mapped[str] = mapped_column(sa.String(MAX_MODULE_NAME))
    module_words: Mapped[dict[str, Any] | None] = mapped_column(default=None)
    shape: Mapped[str | None] = mapped_column(sa.String(64))
    public: Mapped[bool]
    preset: Mapped[str] = mapped_column(sa.String(32))
    seed: Mapped[int] = mapped_column(sa.BigInteger)
    module_size: Mapped[float | None]
    content_key: Mapped[str | None] = mapped_column(sa.String(64), unique=True)
    visitor: Mapped[str] = mapped_column(sa.String(64))
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    progress: Mapped[dict[str, Any]] = mapped_column(default=dict)
    summary: Mapped[dict[str, Any]] = mapped_column(default=dict)
    error: Mapped[dict[str, Any] | None]
    refold: Mapped[str | None] = mapped_column(sa.String(200), default=None)
    turn: Mapped[int] = mapped_column(sa.BigInteger, default=0)
    cost_s: Mapped[float] = mapped_column(default=0.0)
    worker: Mapped[str | None] = mapped_column(sa.String(200), default=None)
    epoch: Mapped[int] = mapped_column(default=0)
    kept: Mapped[int] = mapped_column(default=0)
    bytes: Mapped[int] = mapped_column(sa.BigInteger, default=0)
    seen_at: Mapped[float] = mapped_column(default=time.time)
    pinned: Mapped[bool] = mapped_column(default=False)
    strategy: Mapped[str] = mapped_column(sa.String(16), default="auto")
    smooths: Mapped[str | None] = mapped_column(sa.String(32), default=None)
    settings: Mapped[str] = mapped_column(sa.String(500), default="")
    owner: Mapped[str | None] = mapped_column(sa.String(64), index=True, default=None)
    derived_bytes: Mapped[int] = mapped_column(sa.BigInteger, default=0)
    prefer: Mapped[str] = mapped_column(sa.String(16), default="computing")
    maker: Mapped[str | None] = mapped_column(sa.String(64), index=True, default=None)
    renamed: Mapped[bool] = mapped_column(default=False)
    world: Mapped[str] = mapped_column(sa.String(16), default="floating")
    pauses: Mapped[int] = mapped_column(default=0)
    resumed_at: Mapped[float | None] = mapped_column(default=None)
    checkpoint: Mapped[dict[str, Any] | None] = mapped_column(default=None)
    losses: Mapped[int] = mapped_column(default=0)

    @property
    def over(self) -> bool:
        """True if the fold has ended, verified or not."""
        return self.status in ENDED


REQUESTED_COLUMNS: Final = (
    "preset",
    "settings",
    "seed",
    "module_size",
    "strategy",
    "prefer",
    "world",
)
"""Options of a request that are columns of a fold's row, under the same names."""


def columns_of(request: FoldRequest) -> dict[str, Any]:
    """Return the columns of a row that contain a request."""
    return {name: getattr(request, name) for name in REQUESTED_COLUMNS}


def request_of(row: FoldRow | ShownFold) -> FoldRequest:
    """Return the request of a fold, without the options that turn its shape into a path."""
    values = {name: getattr(row, name) for name in REQUESTED_COLUMNS}
    values_given: dict[str, Any] = {
        name: value for name, value in values.items() if value is not None
    }
    if row.module in MODULE_CHOICES:
        values_given["module"] = row.module
    return FoldRequest(
        **values_given, refold=row.refold is not None, smooth=row.smooths is not None
    )


STATUSES = ("queued", "running", "verified", "failed", "cancelled")
ENDED = frozenset({"verified", "failed", "cancelled"})


class WorkerRow(Base):
    """Description of a worker that lives, or lived a while ago; see ``server.store.leases``."""

    __tablename__ = "workers"

    name: Mapped[str] = mapped_column(sa.String(200), primary_key=True)
    host: Mapped[str] = mapped_column(sa.String(200))
    pid: Mapped[int]
    folds_at_once: Mapped[int]
    started_at: Mapped[float]
    version: Mapped[str] = mapped_column(sa.String(32))


class MovieRow(Base):
    """A requested movie of a fold.

    ``id`` is the key of its options, ``wishes``; ``job`` is the name of the job, which ends with
    the name of the file; ``status`` is one of ``queued``, ``running``, ``ready`` and ``failed``;
    ``problem`` contains ``code``, ``detail`` and ``where`` of an error. ``bytes`` is the size of
    the file. ``of_owner`` is True if the fold's owner has requested it. ``worker`` and ``losses``
    are like those of a fold.
    """

    __tablename__ = "movies"

    fold_id: Mapped[str] = mapped_column(
        sa.ForeignKey("folds.id", ondelete="CASCADE"), primary_key=True
    )
    id: Mapped[str] = mapped_column(sa.String(32), primary_key=True)
    job: Mapped[str] = mapped_column(sa.String(128), unique=True)
    wishes: Mapped[dict[str, Any]]
    visitor: Mapped[str] = mapped_column(sa.String(64))
    token_hash: Mapped[str] = mapped_column(sa.String(64), index=True)
    status: Mapped[str] = mapped_column(sa.String(16), index=True)
    frames_done: Mapped[int]
    problem: Mapped[dict[str, Any] | None]
    created_at: Mapped[float]
    bytes: Mapped[int] = mapped_column(sa.BigInteger, default=0)
    of_owner: Mapped[bool] = mapped_column(default=False)
    worker: Mapped[str | None] = mapped_column(sa.String(200), index=True, default=None)
    losses: Mapped[int] = mapped_column(default=0)

    @property
    def file(self) -> str:
        """Name of its file."""
        return movie_file(self.job)


UNFINISHED_MOVIE_STATUSES = ("queued", "running")
"""Statuses of movies that wait or are being created."""


def movie_file(job: str) -> str:
    """Return the name of a job's movie file, unique among all jobs."""
    return job.partition(".")[2]


class TourRow(Base):
    """Tour that the owner of a fold has stored, as in ``planner.plan.tour.Tour.as_dict``."""

    __tablename__ = "tours"

    fold_id: Mapped[str] = mapped_column(
        sa.ForeignKey("folds.id", ondelete="CASCADE"), primary_key=True
    )
    content: Mapped[dict[str, Any]] = mapped_column("tour")


class ValuesRow(Base):
    """Module values that the owner of a fold has stored; see ``planner.plan.module_values``."""

    __tablename__ = "own_values"

    fold_id: Mapped[str] = mapped_column(
        sa.ForeignKey("folds.id", ondelete="CASCADE"), primary_key=True
    )
    content: Mapped[dict[str, Any]] = mapped_column("told")


class PreviewRow(Base):
    """An upload under preview, with the options that its owner viewed last.

    ``visitor`` has sent it. ``owner`` is the hash of the visitor's token, None without one; the
    owner's list contains the preview once it has been viewed with some options. These are the
    ``query`` of the page's address, and ``key`` is derived from them; it is empty before.
    ``bytes`` is the size of the upload; ``seen_at`` is the time of the last access.
    """

    __tablename__ = "previews"

    id: Mapped[str] = mapped_column(sa.String(32), primary_key=True)
    visitor: Mapped[str] = mapped_column(sa.String(64))
    owner: Mapped[str | None] = mapped_column(sa.String(64), index=True)
    filename: Mapped[str | None] = mapped_column(sa.String(200))
    bytes: Mapped[int] = mapped_column(sa.BigInteger, default=0)
    created_at: Mapped[float]
    seen_at: Mapped[float]
    name: Mapped[str] = mapped_column(sa.String(200), default="")
    modules: Mapped[int] = mapped_column(default=0)
    module: Mapped[str] = mapped_column(sa.String(MAX_MODULE_NAME), default="")
    module_words: Mapped[dict[str, Any] | None] = mapped_column(default=None)
    key: Mapped[str] = mapped_column(sa.String(32), default="")
    query: Mapped[str] = mapped_column(sa.String(300), default="")


class ReportRow(Base):
    """Report of a preview with one set of options, identified by their ``key``.

    It is ``foreign`` if a visitor other than the uploader requested it; ``bytes`` is the size of
    its files, even if it has failed.
    """

    __tablename__ = "preview_reports"

    preview_id: Mapped[str] = mapped_column(
        sa.ForeignKey("previews.id", ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(sa.String(32), primary_key=True)
    foreign: Mapped[bool]
    bytes: Mapped[int] = mapped_column(sa.BigInteger)


class CounterRow(Base):
    """Number shared by all processes; the one named ``turn`` is the queue's virtual time."""

    __tablename__ = "counters"

    name: Mapped[str] = mapped_column(sa.String(32), primary_key=True)
    value: Mapped[int] = mapped_column(sa.BigInteger)


class SecretRow(Base):
    """Secret shared by all processes of the service."""

    __tablename__ = "secrets"

    name: Mapped[str] = mapped_column(sa.String(32), primary_key=True)
    value: Mapped[bytes] = mapped_column(sa.LargeBinary)


class PoolerError(Exception):
    """The address of the database is that of a pooler."""


READ_ONLY_QUERY: Final = "mode=ro&uri=true"
"""URL parameters with which SQLite opens a database for reading only."""
MISSING_LOG_ERRORS: Final = ("unable to open", "readonly database")
"""Texts in SQLite's error messages if a database in a read-only directory lacks the files of its
write-ahead log; the database is then opened as immutable."""
JOBS_CHANNEL: Final = "foldback_jobs"
"""Channel of PostgreSQL on which triggers notify workers of jobs that wait in the queue."""
MIGRATION_LOCK = 0x666F6C65
"""Key of the advisory lock of PostgreSQL that a process holds while it changes the schema to a new
version, so that two processes never do so at the same time. Any number that no other lock uses; all
processes must use the same."""


def engine_of(settings: Settings) -> sa.Engine:
    """Return the engine of a service; on a read-only disk it never writes to SQLite."""
    url = settings.store_url
    read_only = settings.read_only and url.startswith("sqlite")
    return read_only_engine(url) if read_only else engine_for(url)


def read_only_engine(url: str) -> sa.Engine:
    """Return an engine that writes nothing, not even the write-ahead log of a SQLite database."""
    path = quote(sa.make_url(url).database or "")
    engine = sa.create_engine(f"sqlite:///file:{path}?{READ_ONLY_QUERY}", hide_parameters=True)
    try:
        with engine.connect() as connection:
            connection.exec_driver_sql("SELECT count(*) FROM sqlite_master")
    except OperationalError as error:
        if not any(words in str(error.orig) for words in MISSING_LOG_ERRORS):
            return engine
        engine.dispose()
        return sa.create_engine(
            f"sqlite:///file:{path}?{READ_ONLY_QUERY}&immutable=1", hide_parameters=True
        )
    return engine


def missing_database(url: str) -> Path | None:
    """Return the path of a SQLite database that does not exist yet, or None."""
    path = sa.make_url(url).database if url.startswith("sqlite") else None
    return Path(path) if path and not Path(path).exists() else None


def reading_engine(url: str) -> sa.Engine:
    """Return an engine for reading an existing database, which it neither creates nor repairs."""
    if url.startswith("sqlite"):
        return read_only_engine(url)
    return sa.create_engine(
        sa.make_url(url).set(drivername="postgresql+psycopg"),
        connect_args={"connect_timeout": 5},
        hide_parameters=True,
    )


@contextmanager
def reading_connection(url: str) -> Generator[sa.Connection]:
    """Open a connection of ``reading_engine``."""
    engine = reading_engine(url)
    try:
        with engine.connect() as connection:
            yield connection
    finally:
        engine.dispose()


def check_sessions(url: str) -> None:
    """Check that a connection to PostgreSQL keeps its session, and thus its locks.

    Raises:
        PoolerError: If a pooler gives each transaction another session.
    """
    pid = sa.select(sa.func.pg_backend_pid())
    with reading_connection(url) as first, reading_connection(url) as second:
        before = first.scalar(pid)
        first.commit()
        if second.scalar(pid) == before or first.scalar(pid) != before:
            raise PoolerError(
                "got the address of a pooler that gives each transaction another session, expected "
                "that of PostgreSQL itself, whose locks tell which workers live."
            )


def is_read_only(engine: sa.Engine) -> bool:
    """Return True for an engine of ``read_only_engine``."""
    return engine.url.query.get("mode") == "ro"


def engine_for(url: str) -> sa.Engine:
    """Return an engine; SQLite gets a write-ahead log, a lock timeout, and foreign keys.

    SQLite connections are cheap, so there are enough for all threads of a web process. A server
    gets fewer connections, and unresponsive ones are closed.
    """
    if url.startswith("postgresql"):
        return sa.create_engine(
            url,
            pool_pre_ping=True,
            pool_size=5,
            max_overflow=15,
            pool_timeout=10.0,
            connect_args={
                "connect_timeout": 5,
                "keepalives_idle": 30,
                "tcp_user_timeout": 15000,
                "options": "-c statement_timeout=20000",
            },
            hide_parameters=True,
        )
    engine = sa.create_engine(
        url,
        connect_args={"timeout": 30.0},
        pool_size=10,
        max_overflow=50,
        hide_parameters=True,
    )

    @event.listens_for(engine, "connect")
    def on_connect(connection: Any, record: object) -> None:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")

    return engine


def migrate(engine: sa.Engine) -> None:
    """Migrate the database to the newest schema, if its own is older.

    Raises:
        NewerSchemaError: If a newer foldback wrote them.
    """
    from foldback.server.store.schema_version import Schema

    with changing_alone(engine) as connection:
        schema = Schema.of(connection)
        schema.check()
        if not schema.missing:
            return
        if is_read_only(engine):
            words = "the disk is read-only, and the database on it is empty or too old"
            raise OSError(errno.EROFS, words, engine.url.database)
        upgrade(connection, "head")


@contextmanager
def changing_alone(engine: sa.Engine) -> Generator[sa.Connection]:
    """Yield a connection in a transaction; only one process has such a transaction at a time."""
    with engine.begin() as connection:
        if engine.dialect.name == "sqlite" and not is_read_only(engine):
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        elif engine.dialect.name == "postgresql":
            connection.exec_driver_sql("SET LOCAL statement_timeout = 0")
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(MIGRATION_LOCK)))
        yield connection


def upgrade(connection: sa.Connection, version: str) -> None:
    """Migrate the schema to a version within the transaction of a connection."""
    from alembic import command

    from foldback.server.store.schema_version import config

    alembic = config()
    alembic.attributes["connection"] = connection
    command.upgrade(alembic, version)


def passes(error: BaseException) -> bool:
    """Return True if an error may be transient: the database is unreachable, locked or full."""
    return isinstance(error, OperationalError | InterfaceError | PoolTimeoutError) or (
        isinstance(error, DBAPIError) and error.connection_invalidated
    )
