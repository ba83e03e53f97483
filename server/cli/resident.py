"""Resident process: has imported what commands need, and runs each in a copy of itself.

Imports take more than a second of the processor, a quarter of the fold of 160 modules
(docs/decisions/0064-resident-process.md). The process ends after ten idle minutes, or when a file
that it has imported changes.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import selectors
import signal
import socket
import sys
from contextlib import suppress
from importlib import import_module
from typing import Final

from foldback.server.cli.resident_client import (
    HEADER,
    REPLY,
    Request,
    address,
    same_user,
)

IDLE_S: Final = 600.0
"""Time without a command after which the process ends, in seconds."""

MAX_REQUEST_BYTES: Final = 4 * 2**20
"""Size of a request: Linux permits 2 MiB of arguments and environment, and JSON escapes letters."""

REQUEST_TIMEOUT_S: Final = 2.0
"""Time within which a client must have sent its request, in seconds."""

IMPORTED_MODULES: Final = (
    "foldback.server.cli.command_line",
    "foldback.cli.fold",
    "foldback.cli.summary",
    "foldback.planner.pipeline.stages",
    "foldback.planner.playback.playback",
    "foldback.planner.certificate.certificate",
    "foldback.planner.explosion.strategies",
    "foldback.planner.simulation.mujoco_robot",
    "mujoco",
    "scipy.interpolate",
    "scipy.optimize",
)
"""Modules that a fold uses, among them those that it imports only while it runs."""


class Server:
    """Runs the commands that clients send.

    Attributes:
        idle_s: Time without a command after which it ends.
    """

    def __init__(self, listener: socket.socket, idle_s: float = IDLE_S) -> None:
        self.idle_s = idle_s
        self._listener = listener
        self._selector = selectors.DefaultSelector()
        self._selector.register(listener, selectors.EVENT_READ)
        self._commands: dict[int, tuple[int, socket.socket]] = {}
        self._files = _stamps(_imported_files())

    def serve(self) -> Request | None:
        """Run commands until the process is idle for too long, or its imports are out of date.

        Returns:
            In a new copy of the process, the command that it is to run. Otherwise None.
        """
        while self._commands or self._listener.fileno() >= 0:
            events = self._selector.select(None if self._commands else self.idle_s)
            if not events:
                break
            for key, _ in events:
                if key.fileobj is not self._listener:
                    self._follow(key)
                    continue
                connection, _ = self._listener.accept()
                with suppress(OSError, ValueError):
                    if (request := self._accepted(connection)) is not None:
                        return request
        return None

    def _accepted(self, connection: socket.socket) -> Request | None:
        """Start a copy of this process for a command; in the copy, return the command."""
        try:
            request, descriptors = _receive(connection)
        except (OSError, ValueError):
            connection.close()
            raise
        try:
            if self._files != _stamps([*self._files]):
                # The address is free before the client, which learns it now, starts another one.
                self._selector.unregister(self._listener)
                self._listener.close()
                connection.close()
            elif self._fork(connection):
                _inherit(request, descriptors)
                return request
        finally:
            for descriptor in descriptors:
                os.close(descriptor)
        return None

    def _fork(self, connection: socket.socket) -> bool:
        """Return True in a copy of this process."""
        process = os.fork()
        if process == 0:
            self._selector.close()
            self._listener.close()
            for _, other in [*self._commands.values(), (0, connection)]:
                other.close()
            for descriptor in self._commands:
                os.close(descriptor)
            return True
        descriptor = os.pidfd_open(process)
        self._commands[descriptor] = (process, connection)
        self._selector.register(descriptor, selectors.EVENT_READ, descriptor)
        self._selector.register(connection, selectors.EVENT_READ, descriptor)
        connection.sendall(REPLY.pack(process))
        return False

    def _follow(self, key: selectors.SelectorKey) -> None:
        """Tell a client that its command has ended, or end the command of a client that is gone."""
        if key.data not in self._commands:  # both happened at once
            return
        process, connection = self._commands[key.data]
        if key.fileobj is connection:
            self._selector.unregister(connection)
            os.kill(process, signal.SIGTERM)
            return
        _, status = os.waitpid(process, 0)
        with suppress(OSError):
            connection.sendall(REPLY.pack(os.waitstatus_to_exitcode(status)))
        with suppress(KeyError):
            self._selector.unregister(connection)
        self._selector.unregister(key.data)
        del self._commands[key.data]
        os.close(key.data)
        connection.close()


def _imported_files() -> list[str]:
    """Return the files of all imported modules."""
    files = (getattr(module, "__file__", None) for module in list(sys.modules.values()))
    return [path for path in files if path]


def _stamps(paths: list[str]) -> dict[str, tuple[int, int]]:
    """Return time of change and size of files, (0, 0) of one that is gone."""
    stamps: dict[str, tuple[int, int]] = {}
    for path in paths:
        try:
            status = os.stat(path)
            stamps[path] = (status.st_mtime_ns, status.st_size)
        except OSError:
            stamps[path] = (0, 0)
    return stamps


def _receive(connection: socket.socket) -> tuple[Request, list[int]]:
    """Return a client's request, and its three streams and current directory.

    Raises:
        OSError: The client has gone, is slow, or belongs to another user.
        ValueError: The request has another format.
    """
    connection.settimeout(REQUEST_TIMEOUT_S)
    if not same_user(connection):
        raise PermissionError("the client belongs to another user")
    header, descriptors, _, _ = socket.recv_fds(connection, HEADER.size, 4)
    try:
        (length,) = HEADER.unpack(header.ljust(HEADER.size, b"\xff"))
        if len(descriptors) != 4 or length > MAX_REQUEST_BYTES:
            raise ValueError("the request has another format")
        message = connection.recv(length, socket.MSG_WAITALL)
        request = Request(**json.loads(message))
    except (OSError, ValueError, TypeError):
        for descriptor in descriptors:
            os.close(descriptor)
        raise
    return request, list(descriptors)


def _inherit(request: Request, descriptors: list[int]) -> None:
    """Take over what a process that the shell had started would have inherited."""
    for target, descriptor in enumerate(descriptors[:3]):
        os.dup2(descriptor, target)
    os.fchdir(descriptors[3])
    os.umask(request.umask)
    os.environ.clear()
    os.environ.update(request.environment)
    os.sched_setaffinity(0, request.cores)
    os.setpriority(os.PRIO_PROCESS, 0, max(request.niceness, os.getpriority(os.PRIO_PROCESS, 0)))
    for limit, soft, hard in request.limits:
        with suppress(ValueError, OSError):  # above what this process may have itself
            resource.setrlimit(limit, (soft, hard))
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        buffering = 1 if name == "stderr" or os.isatty(descriptor) else -1
        setattr(sys, name, open(descriptor, "w", buffering, closefd=False))  # noqa: SIM115


def main() -> None:
    """Serve; in the copies of this process, run a command."""
    gc.disable()
    with socket.socket(socket.AF_UNIX) as listener:
        try:
            listener.bind(address())
        except OSError:  # there is one already
            return
        # As in command_line.main: no OpenGL, and no search for plug-ins.
        os.environ.setdefault("MUJOCO_GL", "off")
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        for name in IMPORTED_MODULES:
            import_module(name)
        # Pages of memory that no garbage collection touches stay shared with the copies.
        gc.freeze()
        listener.listen()
        request = Server(listener).serve()
    if request is None:
        return
    gc.enable()
    sys.argv = ["foldback", *request.arguments]
    from foldback.server.cli.command_line import main as run

    run()


if __name__ == "__main__":
    main()
