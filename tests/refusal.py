"""Errors with a code that a test expects."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from foldback.planner.errors import InputError


@contextmanager
def refused(
    code: str,
    expected_place: object = ...,
    *,
    match: str | None = None,
    kind: type[Any] = InputError,
) -> Iterator[None]:
    """Expect an error of a kind with a code and, if given, a place and matching words."""
    with pytest.raises(kind, match=match) as error:
        yield
    assert error.value.code == code
    assert expected_place is ... or error.value.where == expected_place
