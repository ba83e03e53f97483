"""Logs: one line an event, on standard error, without the chatter of libraries."""

from __future__ import annotations

import logging
from typing import Final

CHATTERS: Final = ("alembic", "dbos", "httpx", "websockets")


def set_up_logs() -> None:
    """Sends what foldback has to say to standard error, and of libraries only warnings."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
    for name in CHATTERS:
        logging.getLogger(name).setLevel(logging.WARNING)
