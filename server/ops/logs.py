"""Logs: one line per event on standard error, as text or as JSON.

Lines have context fields: ``about(fold=…)`` sets them for all lines within a context,
``extra={"fold": …}`` for a single line. Text from visitors is escaped, so it cannot start a line.
"""

from __future__ import annotations

import json
import logging
import math
import time
import traceback
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any, Final

from foldback.server.settings import Settings

QUIET_LOGGERS: Final = ("alembic", "httpx", "opentelemetry", "websockets")
ACCEPT_ERROR: Final = "socket.accept() out of system resource"
"""Message of asyncio about a connection for which no file descriptor is left."""
CONTEXT_FIELDS: Final = ("fold", "movie", "worker", "request")
ACCESS_FIELDS: Final = ("method", "route", "path", "status", "duration_ms")
"""Fields of a record of the logger ``foldback.access`` that become fields of a JSON log line; text
lines contain them in the message."""
_about: ContextVar[Mapping[str, str]] = ContextVar("about", default=MappingProxyType({}))


@contextmanager
def about(**facts: str) -> Generator[None]:
    """Set context fields of all log lines within a context.

    Args:
        facts: Values by field, a subset of ``CONTEXT_FIELDS``.
    """
    token = _about.set({**_about.get(), **facts})
    try:
        yield
    finally:
        _about.reset(token)


def from_now_on_about(**facts: str) -> None:
    """Set the context fields of log lines until the task or thread ends."""
    _about.set({**_about.get(), **facts})


def escaped(text: str) -> str:
    """Return the text on one line, with control characters escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class _Formatter(logging.Formatter):
    """Base class of both formats.

    Args:
        always: Context fields of all lines of this process.
    """

    def __init__(self, always: Mapping[str, str]) -> None:
        super().__init__()
        self._always = always

    def _facts(self, record: logging.LogRecord, names: tuple[str, ...]) -> dict[str, Any]:
        fields = {**self._always, **_about.get(), **vars(record)}
        return {name: fields[name] for name in names if fields.get(name) is not None}

    @staticmethod
    def _trace(record: logging.LogRecord) -> str:
        return "".join(traceback.format_exception(*record.exc_info)) if record.exc_info else ""

    @staticmethod
    def _time(record: logging.LogRecord) -> str:
        time = datetime.fromtimestamp(record.created, UTC)
        return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")


class JsonLines(_Formatter):
    """JSON object per line: ``time``, ``level``, ``logger``, ``message``, context fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        line: dict[str, Any] = {
            "time": self._time(record),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **self._facts(record, CONTEXT_FIELDS + ACCESS_FIELDS),
        }
        if trace := self._trace(record):
            line["exception"] = trace
        return json.dumps(line, default=str)


class TextLines(_Formatter):
    """``time level logger [fold=… request=…]: message``, then an indented traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, and those of a traceback."""
        facts = self._facts(record, CONTEXT_FIELDS)
        pairs = " ".join(f"{name}={escaped(str(value))}" for name, value in facts.items())
        head = f"{self._time(record)} {record.levelname.lower()} {record.name}"
        line = f"{head}{f' [{pairs}]' if pairs else ''}: {escaped(record.getMessage())}"
        trace = "".join(f"\n  {escaped(part)}" for part in self._trace(record).splitlines())
        return line + trace


class AcceptErrors(logging.Filter):
    """Filter that passes one line a minute about connections for which no open files are left.

    asyncio would log a traceback for each.
    """

    _told_at = -math.inf

    def filter(self, record: logging.LogRecord) -> bool:
        """Return True if the record is logged."""
        if ACCEPT_ERROR not in record.getMessage():
            return True
        now = time.monotonic()
        if now - self._told_at < 60.0:
            return False
        self._told_at = now
        record.msg = "connections wait, because the limit of open files is reached; raise it"
        record.args, record.exc_info = (), None
        return True


def set_up_logs(settings: Settings, *, worker: str | None = None) -> None:
    """Log to standard error; from some libraries, only warnings and errors.

    Args:
        settings: Contain the format and the lowest level.
        worker: Name of this process if it is a worker, added to all lines.
    """
    lines = JsonLines if settings.log_format == "json" else TextLines
    handler = logging.StreamHandler()
    handler.setFormatter(lines({"worker": worker} if worker else {}))
    logging.basicConfig(level=settings.log_level.upper(), handlers=[handler], force=True)
    asyncio_log = logging.getLogger("asyncio")
    for old_filter in [
        log_filter for log_filter in asyncio_log.filters if isinstance(log_filter, AcceptErrors)
    ]:
        asyncio_log.removeFilter(old_filter)
    asyncio_log.addFilter(AcceptErrors())
    for name in QUIET_LOGGERS:
        min_level = max(logging.WARNING, logging.getLogger().level)
        logging.getLogger(name).setLevel(min_level)
