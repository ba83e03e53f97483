"""Patience: what is to be noted or kept is so once the database and the storage answer again."""

from __future__ import annotations

import errno
import logging
import time
from collections.abc import Callable
from typing import Final, TypeVar

from sqlalchemy.exc import SQLAlchemyError

from server.store.object_store import StorageError
from server.store.tables import passes

TRY_AGAIN_S: Final = 0.5
PASSING: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.ESTALE})
"""Errors of a disk that may pass: no room, no handles, an input or output error."""
Answer = TypeVar("Answer")
log = logging.getLogger("foldback.worker")


def patiently(do: Callable[[], Answer], *, wait: Callable[[float], object] = time.sleep) -> Answer:
    """What it returns, once the database and the storage answer and the disk has room.

    Args:
        do: May be done any number of times.
        wait: Waits for so many seconds before the next try.
    """
    told = False
    while True:
        try:
            return do()
        except (SQLAlchemyError, StorageError, OSError) as error:
            if isinstance(error, OSError) and error.errno not in PASSING:
                raise
            if isinstance(error, SQLAlchemyError) and not passes(error):
                raise
            if not told:
                log.warning("database or storage does not answer, waiting: %s", error)
            told = True
        wait(TRY_AGAIN_S)
