"""Logs: one line an event, on standard error, for people or (as JSON) for programs.

Lines say what they are about: ``about(fold=…)`` holds for all that is logged within it,
``extra={"fold": …}`` for one line. Whatever visitors send stays within its line.
"""

from __future__ import annotations

import json
import logging
import traceback
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any, Final

from server.settings import Settings

QUIET_LOGGERS: Final = ("alembic", "httpx", "opentelemetry", "websockets")
CONTEXT_FIELDS: Final = ("fold", "movie", "worker", "request")
ACCESS_FIELDS: Final = ("method", "route", "path", "status", "duration_ms")
"""Fields of a record of the logger ``foldback.access`` that become fields of a JSON log line; plain
log lines hold them in their text."""
_about: ContextVar[Mapping[str, str]] = ContextVar("about", default=MappingProxyType({}))


@contextmanager
def about(**facts: str) -> Generator[None]:
    """Say what is logged within is about.

    Args:
        facts: Some of ``CONTEXT_FIELDS``.
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
    """Return the text on one line, with nothing in it that a terminal would obey."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class _Formatter(logging.Formatter):
    """Common part of the two formats.

    Args:
        always: Context fields of all lines of this process.
    """

    def __init__(self, always: Mapping[str, str]) -> None:
        super().__init__()
        self._always = always

    def _facts(self, record: logging.LogRecord, names: tuple[str, ...]) -> dict[str, Any]:
        known = {**self._always, **_about.get(), **vars(record)}
        return {name: known[name] for name in names if known.get(name) is not None}

    @staticmethod
    def _trace(record: logging.LogRecord) -> str:
        return "".join(traceback.format_exception(*record.exc_info)) if record.exc_info else ""

    @staticmethod
    def _time(record: logging.LogRecord) -> str:
        time = datetime.fromtimestamp(record.created, UTC)
        return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")


class JsonLines(_Formatter):
    """One JSON object a line: ``time``, ``level``, ``logger``, ``message`` and what it is about."""

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
    """``time level logger [fold=… request=…]: message``; a traceback follows, moved in."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, and those of a traceback."""
        facts = self._facts(record, CONTEXT_FIELDS)
        shown = " ".join(f"{name}={escaped(str(value))}" for name, value in facts.items())
        head = f"{self._time(record)} {record.levelname.lower()} {record.name}"
        line = f"{head}{f' [{shown}]' if shown else ''}: {escaped(record.getMessage())}"
        trace = "".join(f"\n  {escaped(part)}" for part in self._trace(record).splitlines())
        return line + trace


def set_up_logs(settings: Settings, *, worker: str | None = None) -> None:
    """Send what foldback has to say to standard error, and of libraries only warnings.

    Args:
        settings: Say the format and from which level on.
        worker: Name of the worker that this process is, for all its lines.
    """
    lines = JsonLines if settings.log_format == "json" else TextLines
    handler = logging.StreamHandler()
    handler.setFormatter(lines({"worker": worker} if worker else {}))
    logging.basicConfig(level=settings.log_level.upper(), handlers=[handler], force=True)
    for name in QUIET_LOGGERS:
        least = max(logging.WARNING, logging.getLogger().level)
        logging.getLogger(name).setLevel(least)
