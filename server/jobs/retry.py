"""Retries: calls that are repeated until the database and the storage answer again."""

from __future__ import annotations

import errno
import logging
import time
from collections.abc import Callable
from typing import Final, TypeVar

import tenacity

from foldback.server.store.object_store import StorageError
from foldback.server.store.schema import passes

RETRY_INTERVAL_S: Final = 0.5
"""Time between two attempts to reach the database, the object store or the disk after an error, in
s."""
TRANSIENT_ERRNOS: Final = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.ESTALE}
)
"""Error numbers (errno) of disk errors after which a worker waits and tries again, as they may
pass: no space, quota exceeded, I/O error, read-only file system, stale file handle."""
Answer = TypeVar("Answer")
log = logging.getLogger("foldback.worker")


def retry_until_available(
    do: Callable[[], Answer], *, wait: Callable[[float], None] = time.sleep
) -> Answer:
    """Call ``do`` and return its result; repeat it while database, storage or disk fail.

    Args:
        do: Function that may be called any number of times.
        wait: Waits for the given seconds before the next attempt.
    """
    return tenacity.Retrying(
        retry=tenacity.retry_if_exception(_is_transient),
        wait=tenacity.wait_fixed(RETRY_INTERVAL_S),
        sleep=wait,
        before_sleep=_log_first,
    )(do)


def _is_transient(error: BaseException) -> bool:
    if isinstance(error, OSError):
        return error.errno in TRANSIENT_ERRNOS
    return isinstance(error, StorageError) or passes(error)


def _log_first(state: tenacity.RetryCallState) -> None:
    if state.attempt_number == 1 and state.outcome:
        log.warning("database or storage does not answer, waiting: %s", state.outcome.exception())
