"""Finds the programs that the tests of deploy/ run, or gets Debian's packages of them; says where.

When one can't be got it says so and fails: these tests are never skipped.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

PACKAGES = {"caddy": "caddy", "systemd-analyze": "systemd"}


class NoToolError(RuntimeError):
    """A program is not there, and could not be got."""


def ensure(name: str) -> str:
    """The path of a program, got first when it is not there.

    Raises:
        NoToolError: Saying what to do.
    """
    if not (path := shutil.which(name)) and _by_apt(PACKAGES[name]):
        path = shutil.which(name)
    if not path:
        raise NoToolError(
            f"The tests of deploy/ need {name!r}, which is not there and could not be got. "
            f"Install Debian's package {PACKAGES[name]!r}."
        )
    return path


def _by_apt(package: str) -> bool:
    """Installs a package; False where that can't be tried."""
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        return False
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for command in (
        ["apt-get", "update", "-qq"],
        ["apt-get", "install", "-qq", "--yes", "--no-install-recommends", package],
    ):
        subprocess.run(command, env=environment, stdout=sys.stderr, check=False)
    return True


if __name__ == "__main__":
    try:
        for tool in PACKAGES:
            print(f"{tool} for the tests of deploy/: {ensure(tool)}")
    except NoToolError as error:
        sys.exit(str(error))
