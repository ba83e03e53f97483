"""Warm-up of compiled code: nothing is left to do."""

from __future__ import annotations


def warm_up(*args: object, **options: object) -> None:
    """Do nothing."""
    del args, options


warm_up_folding = warm_up_fit = warm_up_paths = warm_up_chains = warm_up
