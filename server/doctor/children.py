"""Check of the sandbox of computing processes."""

from __future__ import annotations

from server.doctor.check_result import CheckResult, ok, warning
from server.doctor.drawing import run_python
from server.settings import Settings

_CONFINE = """
import os, socket, sys, tempfile
from pathlib import Path
import planner, server
from server.processes.sandbox import confine
from server.processes.landlock import Allowed
with tempfile.NamedTemporaryFile() as foreign, tempfile.TemporaryDirectory() as place:
    aim = sys.argv[1] if os.path.exists(sys.argv[1]) else foreign.name
    if not os.fork():
        confine(Allowed(writable=(Path(place),)))
        free = []
        for what, do in (("files", lambda: open(aim)), ("sockets", socket.socket)):
            try:
                do().close()
                free.append(what)
            except PermissionError:
                pass
        print("free", *free, flush=True)
        os._exit(0)
    os.wait()
"""


def confinement(settings: Settings) -> CheckResult:
    """Check that processes that read uploads can access neither database nor network."""
    code, words = run_python(_CONFINE, str(settings.root / "foldback.db"))
    free = words.split()[1:]
    if code or not words.startswith("free"):
        found = f"the sandbox could not be tested ({words})"
    elif free:
        found = (
            "on this Linux kernel, processes that read uploads are not isolated from the "
            f"{' and '.join(free)} of other programs"
        )
    else:
        return ok(
            "Landlock and seccomp isolate processes that read uploads from the files, signals and "
            "sockets of other programs"
        )
    return warning(
        found,
        "Use Linux 5.19 or newer with Landlock and seccomp (allow both in a container), "
        "or run the service as a separate user with the sandbox options of systemd.",
    )
