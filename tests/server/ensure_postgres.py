"""Makes sure of a PostgreSQL for the tests; prints where its programs are.

One that is there is taken (``FOLDBACK_POSTGRES`` names its directory of programs); else Debian's
package is installed when this is root on a Debian. When nothing works it says so and fails: tests
with PostgreSQL are never skipped.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from tests.debian import install

PROGRAMS = ("initdb", "postgres")
DEBIAN = Path("/usr/lib/postgresql")


class NoPostgresError(RuntimeError):
    """There is no PostgreSQL, and none could be got."""


def find() -> Path | None:
    """The directory with PostgreSQL's programs, the newest version first, or None."""
    named = os.environ.get("FOLDBACK_POSTGRES")
    places = [Path(named)] if named else _places()
    return next((p for p in places if all(os.access(p / n, os.X_OK) for n in PROGRAMS)), None)


def _places() -> list[Path]:
    on_path = shutil.which("postgres")
    found = [Path(on_path).resolve().parent] if on_path else []
    versions = (p for p in DEBIAN.glob("*") if p.name.isdecimal())
    return found + [p / "bin" for p in sorted(versions, key=lambda p: -int(p.name))]


def ensure() -> Path:
    """The directory with PostgreSQL's programs, got first when there is none.

    Raises:
        NoPostgresError: Saying what to do.
    """
    if found := find():
        return found
    if install("postgresql") and (found := find()):
        return found
    raise NoPostgresError(
        "The tests of many machines need a PostgreSQL; found none. Install the package "
        "'postgresql', or name the directory with its programs in FOLDBACK_POSTGRES."
    )


if __name__ == "__main__":
    try:
        print(f"PostgreSQL for the tests: {ensure()}")
    except NoPostgresError as error:
        sys.exit(str(error))
