"""Checks of the machine: packages, port, memory, open files, host names and clock."""

from __future__ import annotations

import errno
import json
import os
import platform
import resource
import socket
import sys
import time
from contextlib import closing
from http.client import HTTPConnection, HTTPException
from importlib.metadata import PackageNotFoundError, distribution, requires, version
from pathlib import Path
from typing import Final

import psutil
from packaging.requirements import Requirement

from foldback.server.doctor.check_result import CheckResult, ok, problem, warning
from foldback.server.limits.open_files import (
    BACKLOG,
    MIN_BACKLOG,
    MIN_CONNECTIONS,
    OTHER_FILES,
    OpenFiles,
)
from foldback.server.processes.limits import INTERACTIVE_CHILDREN
from foldback.server.settings import Settings, is_loopback, unknown_names, unknown_words

MIN_PYTHON: Final = (3, 11)


def python(_: Settings) -> CheckResult:
    """Check the versions of Python and of the required packages."""
    wrong: list[str] = []
    expected: list[str] = []
    count = 0
    for line in requires("foldback") or ():
        needed = Requirement(line)
        if needed.marker is not None and not needed.marker.evaluate({"extra": "service"}):
            continue
        count += 1
        try:
            installed = version(needed.name)
        except PackageNotFoundError:
            wrong.append(f"{needed.name} is missing")
            expected.append(str(needed))
            continue
        if not needed.specifier.contains(installed, prereleases=True):
            wrong.append(f"{needed.name} has version {installed}, expected {needed.specifier}")
            expected.append(str(needed))
    versions = f"Python {platform.python_version()}, foldback {version('foldback')}"
    if sys.version_info < MIN_PYTHON:
        return problem(versions, "Install Python 3.11 or newer.")
    if wrong:
        command = " ".join(["pip install", *(f"'{needed}'" for needed in expected)])
        return problem(
            f"{versions}; {'; '.join(wrong)}",
            f"Run `{command}`, or reinstall foldback into its own virtual environment.",
        )
    directory = Path(str(distribution("foldback").locate_file(""))).resolve()
    return ok(f"{versions} in {directory}; {count} packages have the right versions")


def variables(settings: Settings) -> CheckResult:
    """Check that each environment variable that resembles a setting is one."""
    unknown = unknown_names(os.environ)
    if not unknown:
        return ok(
            f"{len(settings.model_fields_set)} set; all other settings have their default values"
        )
    return warning(
        "; ".join(unknown_words(name, nearest) for name, nearest in unknown.items()),
        "Correct the name, or unset the variable; docs/operations.md lists all settings.",
    )


def port(settings: Settings) -> CheckResult:
    """Check that ``serve`` can listen on its address."""
    place = f"{settings.host}:{settings.port}"
    if settings.port == 0:
        return ok("a free port is picked (port 0)")
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        with socket.socket(family) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((settings.host, settings.port))
            listener.listen()
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            if _foldback_answers(settings):
                return ok(f"foldback is already running at {place}")
            return problem(
                f"another program listens at {place}",
                "Set FOLDBACK_PORT to a free port, or stop the other program.",
            )
        return problem(
            f"cannot listen at {place} ({error.strerror})",
            "Set FOLDBACK_HOST to an address of this machine and FOLDBACK_PORT to 1024 or more.",
        )
    return ok(f"{place} is free")


def _foldback_answers(settings: Settings) -> bool:
    anywhere = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # nosec B104
    host = anywhere.get(settings.host, settings.host)
    try:
        with closing(HTTPConnection(host, settings.port, timeout=5.0)) as connection:
            connection.request("GET", "/ready")
            health = json.loads(connection.getresponse().read(65536))
    except (OSError, HTTPException, ValueError):
        return False
    return isinstance(health, dict) and {"ready", "database", "disk", "workers"} <= health.keys()


def files(settings: Settings) -> CheckResult:
    """Check that the limit of open files suffices for all connections."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard == resource.RLIM_INFINITY:
        return ok("there is no limit")
    connections = OpenFiles.of(settings, hard).connections
    if connections >= settings.max_connections:
        return ok(f"the limit is {hard}")
    judged = warning if hard > OTHER_FILES + MIN_BACKLOG + MIN_CONNECTIONS else problem
    return judged(
        f"the limit is {hard}, enough for {connections} connections instead of "
        f"{settings.max_connections}",
        f"Raise the limit: `ulimit -n {settings.max_connections + OTHER_FILES + BACKLOG}`, or "
        "LimitNOFILE= in a systemd unit; or lower FOLDBACK_MAX_CONNECTIONS.",
    )


def memory(settings: Settings) -> CheckResult:
    """Check that all folds, the web process and its children together fit into memory."""
    memory_bytes = min(psutil.virtual_memory().total, *_allowed_bytes())
    folds = settings.workers * settings.folds_per_worker
    # measured: the web process, and each of its idle children
    besides = 2**20 * (384 + 272 * INTERACTIVE_CHILDREN)
    needed = folds * settings.child_memory_bytes + besides
    text = (
        f"this machine has {_mib(memory_bytes)}; {folds} simultaneous folds need up to "
        f"{_mib(settings.child_memory_bytes)} each"
    )
    if memory_bytes >= needed:
        return ok(text)
    return warning(
        f"{text}; web pages and {INTERACTIVE_CHILDREN} processes that read uploads, prepare "
        f"previews, compute trajectories and draw pictures need {_mib(besides)} more",
        "Lower FOLDBACK_CHILD_MEMORY_BYTES, FOLDBACK_WORKERS or FOLDBACK_FOLDS_PER_WORKER.",
    )


def _allowed_bytes() -> list[int]:
    """Return the memory limit of the container, if there is one."""
    allowed: list[int] = [sys.maxsize]
    for place in ("memory.max", "memory/memory.limit_in_bytes"):
        try:
            allowed.append(int((Path("/sys/fs/cgroup") / place).read_text()))
        except (OSError, ValueError):
            continue
    return allowed


def _mib(size: int) -> str:
    return f"{size // 2**20} MiB"


def names(settings: Settings) -> CheckResult:
    """Check that the service refuses foreign host names."""
    host = settings.host
    if settings.allowed_hosts:
        if "*" in settings.allowed_hosts:
            return warning(
                "the service accepts requests for any host name (*)",
                "Set FOLDBACK_ALLOWED_HOSTS to the service's host names.",
            )
        return ok(", ".join(settings.allowed_hosts))
    if is_loopback(host):
        return ok(f"the service is at {host} and accepts only this machine's own host names")
    return warning(
        f"other machines can reach the service at {host}, and it accepts any host name",
        "Set FOLDBACK_ALLOWED_HOSTS to the service's host names, to prevent DNS rebinding.",
    )


def clock(settings: Settings) -> CheckResult:
    """Check that the clock is later than time stamps of existing files."""
    past = Path(__file__).stat().st_mtime
    newest = settings.root / "foldback.db"
    if newest.exists():
        past = max(past, newest.stat().st_mtime)
    now = time.time()
    clock_text = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now))
    if now < past - 60.0:
        return warning(
            f"the clock shows {clock_text}, but some files have times that are "
            f"{_hours(past - now)} later",
            "Set the clock and synchronise it with NTP; the clock decides when folds expire.",
        )
    return ok(clock_text)


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.1f} hours"
