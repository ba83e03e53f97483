"""Attacks from within: an attacker's data have taken over a compute process.

Each kind of child runs code of the attacker instead of its work. The objects that it must not reach
exist: a database, another fold, listeners.
"""

import json
import os
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from foldback.server.processes import landlock, sandbox
from foldback.server.processes.fork_server import ForkServer, Kind
from foldback.server.processes.landlock import Allowed
from foldback.server.processes.limits import ChildLimits
from foldback.server.processes.movie_task import ask_for_movie
from foldback.server.settings import Settings
from foldback.web.movies.movie import Movie
from tests.server.processes.test_children import WITHOUT_LIBRARIES, make_child, run_first

LIMITS = ChildLimits(memory_bytes=2**30, cpu_s=60.0)
ATTACK = """
import json, os, resource, socket, threading
from pathlib import Path

def tried(do):
    try:
        found = do()
    except Exception as error:
        return type(error).__name__
    if hasattr(found, "close"):
        found.close()
    return "done"

def connect(family, address):
    with socket.socket(family) as here:
        here.connect(address)

def in_thread(do):
    found = []
    thread = threading.Thread(target=lambda: found.append(tried(do)))
    thread.start()
    thread.join()
    return found[0]

def attack(directory):
    aim = json.loads((Path(directory) / "aim.json").read_bytes())
    own = Path(directory) / "own"
    pid = os.getppid()
    return {
        "own": tried(lambda: own.write_text("mine")),
        "own limits": tried(lambda: resource.getrlimit(resource.RLIMIT_CORE) and None),
        "threads": len(threading.enumerate()),
        "files": sorted(os.readlink(f"/proc/self/fd/{n}").partition(":")[0]
                        for n in os.listdir("/proc/self/fd")
                        if os.path.islink(f"/proc/self/fd/{n}")),
        "refused": {
            "database": tried(lambda: open(aim["database"], "rb")),
            "database written": tried(lambda: open(aim["database"], "r+b")),
            "database cut": tried(lambda: os.truncate(aim["database"], 0)),
            "in a thread": in_thread(lambda: open(aim["database"], "rb")),
            "other fold": tried(lambda: os.listdir(aim["fold"])),
            "its plan": tried(lambda: open(aim["fold"] + "/plan.json")),
            "its plan replaced": tried(lambda: own.rename(aim["fold"] + "/plan.json")),
            "hard link": tried(lambda: os.link(own, own.with_name("link"))),
            "link": tried(lambda: os.symlink(aim["database"], own.with_name("link"))),
            "fifo": tried(lambda: os.mkfifo(own.with_name("fifo"))),
            "other upload": tried(lambda: open(aim["upload"] + "/input")),
            "beside it": tried(lambda: open(own.parent.parent / "beside" / "plan.npz")),
            "what is being made": tried(lambda: os.listdir(aim["made"])),
            "home": tried(lambda: os.listdir(os.path.expanduser("~"))),
            "parent": tried(lambda: open(f"/proc/{pid}/cmdline")),
            "signal": tried(lambda: os.kill(pid, 0)),
            "limits": tried(lambda: resource.prlimit(pid, resource.RLIMIT_NOFILE)),
            "priority": tried(lambda: os.setpriority(os.PRIO_PROCESS, pid, 19)),
            "processors": tried(lambda: os.sched_setaffinity(pid, os.sched_getaffinity(0))),
            "mode": tried(lambda: os.chmod(aim["database"], 0o644)),
            "times": tried(lambda: os.utime(aim["database"])),
            "programs": tried(lambda: open(aim["package"] + "/attack.py", "w")),
            "tcp": tried(lambda: connect(socket.AF_INET, ("127.0.0.1", aim["port"]))),
            "unix": tried(lambda: connect(socket.AF_UNIX, aim["socket"])),
            "abstract": tried(lambda: connect(socket.AF_UNIX, chr(0) + aim["abstract"])),
            "udp": tried(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM)),
            "tcp6": tried(lambda: socket.socket(socket.AF_INET6)),
            "datagrams": tried(lambda: socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)),
            "netlink": tried(lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW)),
            "program": tried(lambda: __import__("subprocess").run(
                ["/bin/cat", aim["database"]], check=True, capture_output=True)),
        },
    }
"""
WITH_A_THREAD = f"""{WITHOUT_LIBRARIES}
import threading, time
from pathlib import Path
from foldback.server.processes import sandbox
sandbox.THREAD_EXIT_S = 0.1
threading.Thread(target=lambda: time.sleep(60), daemon=True).start()
sandbox.confine(sandbox.Allowed(writable=(Path(sys.argv[1]),)))
"""
FORKED = f"""{WITHOUT_LIBRARIES}
reading.check = retiming.retime = attack
stand_in("foldback.server.processes.picture_task", draw=attack)
stand_in(
    "foldback.planner.pipeline.derived_files",
    complete=lambda place, _: (place / "report.json").write_text(json.dumps(attack(place))),
)
staging.run_stage = lambda task, place, **_: attack(place)
"""
SPAWNED = f"""{WITHOUT_LIBRARIES}
from foldback.web.movies.encoding import EncodingError

def film(line, movie, out, **_):
    raise EncodingError(json.dumps(attack(out.parent)))

stand_in("foldback.web.movies.renderer", NoGLError=OSError)
stand_in("foldback.web.movies.make_movie", make_movie=film)
"""
"""Code that replaces the first reading of untrusted data, for each kind."""
FORKED_KINDS: tuple[Kind, ...] = ("reader", "preparer", "retimer", "pictures")
"""Forked kinds that run one task after the other, for many visitors."""
needs_landlock = pytest.mark.skipif(not landlock.version(), reason="a kernel without Landlock")


@pytest.fixture
def targets(tmp_path: Path) -> Iterator[dict[str, Any]]:
    """Objects that an attacker would look for, in a data directory like the service's."""
    data = tmp_path / "data"
    fold, upload = data / "folds" / "another", data / "uploads" / "1" / "another"
    scratch = data / "scratch" / "another"
    for place in (fold, upload, scratch):
        place.mkdir(parents=True)
    (fold / "plan.json").write_text("{}")
    (upload / "input").write_text("[]")
    with sqlite3.connect(data / "foldback.db") as database:
        database.execute("CREATE TABLE folds (id)")
    database.close()
    with (
        socket.create_server(("127.0.0.1", 0)) as tcp,
        socket.socket(socket.AF_UNIX) as unix,
        socket.socket(socket.AF_UNIX) as abstract,
    ):
        unix.bind(str(tmp_path / "listener"))
        abstract.bind(f"\0foldback-{os.getpid()}")
        unix.listen()
        abstract.listen()
        yield {
            "database": str(data / "foldback.db"),
            "fold": str(fold),
            "upload": str(upload),
            "made": str(scratch),
            "package": str(Path(sandbox.__file__).parent),
            "port": tcp.getsockname()[1],
            "socket": str(tmp_path / "listener"),
            "abstract": f"foldback-{os.getpid()}",
        }


def attack_env(code: Path, process: str, places: str) -> dict[str, str]:
    """Return the environment in which a process of ours runs the attack."""
    code.mkdir()
    (code / "attack.py").write_text(f"{ATTACK}{places}")
    # Python processes that libraries start do not run the attack.
    return run_first(code, f"import sys\nif {process!r} in sys.orig_argv:\n    import attack\n")


@pytest.fixture(scope="module")
def forks(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    """Fork server whose children of all kinds run the attack."""
    environment = attack_env(
        tmp_path_factory.mktemp("forks") / "code",
        "foldback.server.processes.fork_server_process",
        FORKED,
    )
    kinds = [*FORKED_KINDS, "figures", "stages"]
    with closing(ForkServer(kinds, environment=environment)) as server:
        yield server


def run_attack(
    kind: Kind, tmp_path: Path, targets: dict[str, Any], forks: ForkServer | None
) -> dict[str, Any]:
    """Return the results of the attack in a child of a kind, forked or started directly."""
    code = tmp_path / "code"
    environment = {} if forks else attack_env(code, "foldback.server.processes.child", SPAWNED)
    settings = Settings(data_dir=tmp_path / "data")
    place = {
        "stages": settings.folds_dir / "mine",
        "figures": settings.folds_dir / "mine",
        "movies": settings.scratch_dir / "mine",
        "retimer": settings.motions_dir / "mine",
        "pictures": settings.motions_dir / "mine",
    }.get(kind, settings.uploads_dir / "1" / "mine")
    place.mkdir(parents=True)
    (place.parent / "beside").mkdir()
    (place.parent / "beside" / "plan.npz").write_text("")
    (place / "aim.json").write_text(json.dumps(targets))
    timeline = settings.folds_dir / "filmed" / "timeline"
    ask_for_movie(place, asdict(Movie()), timeline, "movie", on_table=False)
    count = kind in FORKED_KINDS
    limits = replace(ChildLimits.of(settings, awaited=count), niceness=0)
    if kind in ("retimer", "pictures"):
        limits = replace(limits, folders=(str(settings.motions_dir),))
    task = {"retimer": "retime", "pictures": "picture"}.get(kind, "check")
    with make_child(kind, limits, fork_server=forks, environment=environment) as child:
        child_report = child.call(task, place, wall_s=120)
    if kind == "figures":
        return json.loads((place / "report.json").read_bytes())
    return json.loads(child_report["reason"]) if kind == "movies" else child_report


@pytest.mark.processes
@needs_landlock
@pytest.mark.parametrize("kind", [*FORKED_KINDS, "figures", "stages", "movies"])
def test_hijacked_process_reaches_nothing(
    kind: Kind, tmp_path: Path, targets: dict[str, Any], forks: ForkServer
) -> None:
    attack = run_attack(kind, tmp_path, targets, None if kind == "movies" else forks)
    assert attack["own"] == attack["own limits"] == "done"
    refused = attack["refused"]
    # Movies need an encoder, but no program can do more than the process that starts it.
    assert refused.pop("program") == (
        "CalledProcessError" if kind == "movies" else "PermissionError"
    )
    assert set(refused.values()) == {"PermissionError"}, refused
    # Only the pipe to the parent is open and, in some kinds, the reader of one upload or plan. No
    # other reader was started before, as it would not be confined.
    assert attack["threads"] == (3 if kind in FORKED_KINDS else 2)
    assert "socket" not in attack["files"]


def test_packages_are_readable_wherever_they_are_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("site-packages", "libraries"):
        place = tmp_path / name
        monkeypatch.syspath_prepend(place)
        monkeypatch.setattr(
            sys.modules["foldback"], "__file__", str(place / "foldback/__init__.py")
        )
        assert place / "foldback" in sandbox._programs(Allowed(writable=(tmp_path / "data",)))
        inside = Allowed(writable=(place / "data",))
        assert (place in sandbox._programs(inside)) == (name == "site-packages")


@pytest.mark.processes
@needs_landlock
def test_process_with_other_threads_is_not_confined(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITH_A_THREAD, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "expected 1" in done.stderr
