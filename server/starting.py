"""Starting: what is said when a process of the service can't start."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager

from sqlalchemy.exc import DBAPIError

from server.schema import NewerSchemaError
from server.storage import StorageError


@contextmanager
def starting(what: str) -> Generator[None]:
    """Turns what is not there into one line and the exit code 1.

    Args:
        what: What starts.
    """
    try:
        yield
    except NewerSchemaError as error:
        reason = str(error)
    except StorageError as error:
        reason = f"{error}."
    except DBAPIError as error:
        line = str(error.orig).strip().partition("\n")[0]
        reason = f"the database does not answer as it should ({line})."
    except OSError as error:
        reason = f"{error.filename or 'the data directory'} cannot be used ({error.strerror})."
    else:
        return
    print(f"The {what} does not start: {reason} `foldback doctor` says more.", file=sys.stderr)
    raise SystemExit(1)
