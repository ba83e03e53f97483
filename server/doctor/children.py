"""Check of the sandbox of computing processes."""

from __future__ import annotations

import json
from typing import Final

from foldback.server.doctor.check_result import CheckResult, ok, warning
from foldback.server.doctor.drawing import run_python
from foldback.server.settings import Settings

_CONFINE: Final = """
import ctypes, json, os, socket, sys, tempfile
from pathlib import Path
import foldback.planner, server
from foldback.server.processes.sandbox import confine
from foldback.server.processes.landlock import Allowed

libc = ctypes.CDLL(None, use_errno=True)
REMOVE, NEW_USER_NAMESPACE = 0, 0x10000000

def call(name, *arguments):
    found = getattr(libc, name)(*arguments)
    if found < 0:
        raise OSError(ctypes.get_errno(), name)
    return found

def attempts(aim, own, parent):
    yield "files of other programs", lambda: open(aim).close()
    yield "signals to other programs", lambda: os.kill(parent, 0)
    yield "sockets", lambda: socket.socket().close()
    yield "shared memory", lambda: call("shmctl", call("shmget", 0, 4096, 0o600), REMOVE, None)
    yield "links", lambda: os.link(own, own.with_name("link"))
    yield "namespaces", lambda: call("unshare", NEW_USER_NAMESPACE)

with tempfile.NamedTemporaryFile() as foreign, tempfile.TemporaryDirectory() as place:
    aim = sys.argv[1] if os.path.exists(sys.argv[1]) else foreign.name
    parent = os.getpid()
    if not os.fork():
        confine(Allowed(writable=(Path(place),)))
        own = Path(place) / "own"
        own.touch()
        free = []
        for what, attempt in attempts(aim, own, parent):
            try:
                attempt()
                free.append(what)
            except (OSError, AttributeError):  # the system has no such function
                pass
        print(json.dumps(free), flush=True)
        os._exit(0)
    os.wait()
"""
"""Program that confines a process and prints what it may use nevertheless."""


def confinement(settings: Settings) -> CheckResult:
    """Check that processes that read uploads reach no other programs, files and networks."""
    code, words = run_python(_CONFINE, str(settings.root / "foldback.db"))
    if code or not words.startswith("["):
        text = f"the sandbox could not be tested ({words})"
    elif free := json.loads(words):
        text = (
            "on this system, processes that read uploads are not isolated: they may use "
            f"{' and '.join(free)}"
        )
    else:
        return ok(
            "the kernel refuses processes that read uploads files of other programs, signals to "
            "other programs, sockets, shared memory, links and namespaces"
        )
    return warning(
        text,
        "Use Linux 5.19 or newer with Landlock and seccomp (allow both in a container) on x86_64 "
        "or ARM64, or run the service as a separate user with the sandbox options of systemd.",
    )
