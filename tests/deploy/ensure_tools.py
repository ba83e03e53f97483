"""Finds the programs that the tests of deploy/ run, or gets Debian's packages of them; says where.

When one can't be got it says so and fails: these tests are never skipped.
"""

from __future__ import annotations

import shutil
import sys

from tests.debian import install

PACKAGES = {"caddy": "caddy", "systemd-analyze": "systemd"}


class NoToolError(RuntimeError):
    """A program is not there, and could not be got."""


def ensure(name: str) -> str:
    """The path of a program, got first when it is not there.

    Raises:
        NoToolError: Saying what to do.
    """
    if not (path := shutil.which(name)) and install(PACKAGES[name]):
        path = shutil.which(name)
    if not path:
        raise NoToolError(
            f"The tests of deploy/ need {name!r}, which is not there and could not be got. "
            f"Install Debian's package {PACKAGES[name]!r}."
        )
    return path


if __name__ == "__main__":
    try:
        for tool in PACKAGES:
            print(f"{tool} for the tests of deploy/: {ensure(tool)}")
    except NoToolError as error:
        sys.exit(str(error))
