"""Errors of input that a test expects."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import EllipsisType

import pytest

from planner.errors import InputError


@contextmanager
def refused(
    code: str, where: str | EllipsisType | None = ..., *, match: str | None = None
) -> Iterator[None]:
    """Expect an error with this code and, if they are given, this place and matching words."""
    with pytest.raises(InputError, match=match) as error:
        yield
    assert error.value.code == code
    assert where is ... or error.value.where == where
