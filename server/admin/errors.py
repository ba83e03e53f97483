"""Error of a task that an operator requested."""

from __future__ import annotations


class AdminError(Exception):
    """The task cannot be done; the message contains the reason and the remedy."""
