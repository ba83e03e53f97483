"""Progress of compiling kernels: nothing is left to compile."""

from __future__ import annotations

from typing import Any


class Compiling:
    """Context that never reports."""

    has_reported = False

    def __init__(self, *args: object, **options: object) -> None:
        del args, options

    def __enter__(self) -> Compiling:
        return self

    def __exit__(self, *error: object) -> None:
        pass


def beside(part: str, directory: object) -> Any:
    """Do nothing."""
    del part, directory
