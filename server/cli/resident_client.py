"""Client of the resident process: hands a command over, and ends as the command ends.

It is imported before anything else, so it imports only small modules of Python.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
from dataclasses import asdict, dataclass
from typing import Final

SERVED_COMMANDS: Final = frozenset(
    ("fold", "refold", "smooth", "shape", "verify", "export", "tour", "retime", "servos", "table")
)
"""Commands that the resident process runs: those that compute, and need no service."""

OPTIONS: Final = {"--resident": True, "--no-resident": False}
"""Options before the command: whether to use the resident process."""

START_VARIABLES: Final = (
    *("PYTHON", "LC_", "LANG", "LD_", "OMP_", "OPENBLAS_", "MKL_", "MUJOCO_", "FOLDBACK_"),
)
"""Prefixes of environment variables that Python and libraries read only when they start."""

FORWARDED_SIGNALS: Final = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGCONT", "SIGWINCH")
"""Signals that the terminal or a user sends to the client, and that are for the command."""

HEADER: Final = struct.Struct("!I")
"""Length of a request, in bytes."""

REPLY: Final = struct.Struct("!i")
"""A number: first that of the command's process; then its exit status, or minus the number of the
signal that ended it."""

CREDENTIALS: Final = struct.Struct("3i")
"""Process, user and group at the other end of a Unix socket."""

REPLY_TIMEOUT_S: Final = 2.0
"""Time within which the resident process accepts a command; otherwise it runs here."""


@dataclass(frozen=True)
class Request:
    """A command and what a process inherits from the shell, besides open files.

    Attributes:
        arguments: Arguments after the program's name.
        environment: All environment variables.
        umask: Mask of file permissions.
        limits: Soft and hard limits, by the number of the resource.
        cores: Numbers of the processor cores that may be used.
        niceness: Priority, from 0 to 19.
    """

    arguments: list[str]
    environment: dict[str, str]
    umask: int
    limits: list[tuple[int, int, int]]
    cores: list[int]
    niceness: int


def address() -> str:
    """Return the address of the user's resident process for this installation and environment.

    It is an abstract one, which vanishes with the process. Other users can take it; both ends
    therefore check who is at the other end.
    """
    variables = sorted(item for item in os.environ.items() if item[0].startswith(START_VARIABLES))
    digest = hashlib.sha256(json.dumps([sys.executable, variables]).encode()).hexdigest()
    return f"\0foldback/{os.getuid()}/{digest[:32]}"


def same_user(connection: socket.socket) -> bool:
    """Return whether the process at the other end belongs to this user."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size)
    return CREDENTIALS.unpack(credentials)[1] == os.getuid()


def run_resident(arguments: list[str]) -> list[str]:
    """Run a command in the resident process and exit as it does, if that is possible.

    By default, that is so in a terminal. If there is no resident process, one is started for
    the next command.

    Returns:
        The arguments without the option, if this process is to run the command.
    """
    is_wanted = OPTIONS.get(arguments[0]) if arguments else None
    remaining = arguments if is_wanted is None else arguments[1:]
    is_served = bool(remaining) and remaining[0] in SERVED_COMMANDS and sys.platform == "linux"
    if not is_served or is_wanted is False or (is_wanted is None and not _is_terminal()):
        return remaining
    with socket.socket(socket.AF_UNIX) as connection:
        try:
            connection.connect(address())
            if not same_user(connection):
                return remaining
            connection.settimeout(REPLY_TIMEOUT_S)
            _send(connection, remaining)
            process = _number(connection)
        except OSError:
            process = None
        if process is not None:
            connection.settimeout(None)
            _wait(connection, process)
    _start()
    return remaining


def _is_terminal() -> bool:
    return all(os.isatty(descriptor) for descriptor in (0, 1, 2))


def _send(connection: socket.socket, arguments: list[str]) -> None:
    """Send a command, the three standard streams, and the current directory."""
    import resource

    limits = {getattr(resource, name) for name in dir(resource) if name.startswith("RLIMIT_")}
    umask = os.umask(0o077)
    os.umask(umask)
    request = Request(
        arguments=arguments,
        environment=dict(os.environ),
        umask=umask,
        limits=[(limit, *resource.getrlimit(limit)) for limit in sorted(limits)],
        cores=sorted(os.sched_getaffinity(0)),
        niceness=os.getpriority(os.PRIO_PROCESS, 0),
    )
    # Names of files may be no UTF-8: surrogates stand for their bytes.
    message = json.dumps(asdict(request)).encode()
    directory = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    try:
        socket.send_fds(connection, [HEADER.pack(len(message))], [0, 1, 2, directory])
        connection.sendall(message)
    finally:
        os.close(directory)


def _number(connection: socket.socket) -> int | None:
    """Return the next number that the resident process sends; None if it closes the connection."""
    reply = connection.recv(REPLY.size, socket.MSG_WAITALL)
    return REPLY.unpack(reply)[0] if len(reply) == REPLY.size else None


def _wait(connection: socket.socket, process: int) -> None:
    """Forward signals to the command until it ends, and exit as it does."""

    def forward(number: int, _: object) -> None:
        try:
            os.kill(process, number)
        except ProcessLookupError:
            return

    def stop(*_: object) -> None:
        forward(signal.SIGSTOP, None)
        os.kill(os.getpid(), signal.SIGSTOP)

    for name in FORWARDED_SIGNALS:
        signal.signal(getattr(signal, name), forward)
    signal.signal(signal.SIGTSTP, stop)
    status = _number(connection)
    if status is None:
        forward(signal.SIGTERM, None)
        sys.exit("foldback: its resident process has ended; run the command again.")
    if status < 0:
        signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    os._exit(status)


def _start() -> None:
    """Start a resident process for the next command, at low priority."""
    subprocess.Popen(
        [sys.executable, "-m", "foldback.server.cli.resident"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        cwd="/",
    )
