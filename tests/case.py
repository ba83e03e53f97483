"""Cases of a loop within one test: a failure names the case, as one of a parametrisation does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def case(name: object) -> Iterator[None]:
    """Add the name of a case to what fails within.

    For hundreds of quick cases: each test of pytest takes some 3 ms of the processor by itself.
    """
    try:
        yield
    except BaseException as error:
        error.add_note(f"in the case {name}")
        raise
