"""Error of a task that an operator requested."""

from __future__ import annotations


class AdminError(Exception):
    """A task that is not done; its text holds the reason and the remedy."""
