"""Retries: calls that are repeated until the database and the storage answer again."""

from __future__ import annotations

import errno
import logging
import time
from collections.abc import Callable
from typing import Final, TypeVar

from sqlalchemy.exc import SQLAlchemyError

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
    do: Callable[[], Answer], *, wait: Callable[[float], object] = time.sleep
) -> Answer:
    """Call ``do`` and return its result; repeat it while database, storage or disk fail.

    Args:
        do: Function that may be called any number of times.
        wait: Waits for the given seconds before the next attempt.
    """
    is_logged = False
    while True:
        try:
            return do()
        except (SQLAlchemyError, StorageError, OSError) as error:
            if isinstance(error, OSError) and error.errno not in TRANSIENT_ERRNOS:
                raise
            if isinstance(error, SQLAlchemyError) and not passes(error):
                raise
            if not is_logged:
                log.warning("database or storage does not answer, waiting: %s", error)
            is_logged = True
        wait(RETRY_INTERVAL_S)
