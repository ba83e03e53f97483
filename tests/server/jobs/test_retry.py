"""Retries: transient errors only, logged once, with a wait that may end them."""

import errno

import pytest
from sqlalchemy.exc import IntegrityError, OperationalError

from foldback.server.jobs.retry import RETRY_INTERVAL_S, retry_until_available
from foldback.server.store.object_store import StorageError

NO_SPACE = OSError(errno.ENOSPC, "no space")
LOCKED = OperationalError("", {}, Exception("locked"))


def fails(*errors: Exception) -> list[Exception | str]:
    """Return the results of successive calls, the last one a success."""
    return [*errors, "done"]


def call(results: list[Exception | str]) -> str:
    result = results.pop(0)
    if isinstance(result, Exception):
        raise result
    return result


def test_transient_errors_are_waited_for_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    results, waits = fails(NO_SPACE, LOCKED, StorageError("silent")), list[float]()
    assert retry_until_available(lambda: call(results), wait=waits.append) == "done"
    assert waits == [RETRY_INTERVAL_S] * 3
    (line,) = caplog.messages
    assert "no space" in line


@pytest.mark.parametrize(
    "error", [OSError(errno.EACCES, "forbidden"), IntegrityError("", {}, Exception()), KeyError(1)]
)
def test_other_errors_are_raised(error: Exception) -> None:
    with pytest.raises(type(error)):
        retry_until_available(lambda: call(fails(error)), wait=lambda _: None)


def test_wait_may_end_the_retries() -> None:
    def wait(_: float) -> None:
        raise InterruptedError

    results = fails(NO_SPACE, NO_SPACE)
    with pytest.raises(InterruptedError):
        retry_until_available(lambda: call(results), wait=wait)
    assert len(results) == 2
