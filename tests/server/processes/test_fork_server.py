"""The process that forks children: what it is for, and how it ends."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from planner.progress import COMPILING
from server.processes import children
from server.processes.children import LOST, Child, ChildError
from server.processes.fork_server import ForkServer
from server.processes.limits import ChildLimits
from tests.server.here import FORKS
from tests.server.processes.test_children import WITHOUT_LIBRARIES
from tests.server.service import PATIENCE_S, SNAKE

pytestmark = pytest.mark.processes

LIMITS = ChildLimits(memory_bytes=2**30, cpu_s=60.0, warm=False)
WHOLE = {"name": "snake", "module": "cube", "modules": 16}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    (tmp_path / "request.json").write_text(json.dumps({"filename": "snake.json"}))
    (tmp_path / "input").write_text(json.dumps(SNAKE))
    return tmp_path


@pytest.fixture(scope="module")
def server() -> Iterator[ForkServer]:
    server = ForkServer(["reader"], warm=False)
    yield server
    server.close()


def pid_of(server: ForkServer) -> int:
    assert server.pid is not None
    return server.pid


def spoiled(place: Path, code: str, *, warm: bool = False) -> ForkServer:
    """One that runs code before anything else."""
    place.mkdir()
    (place / "sitecustomize.py").write_text(code)
    return ForkServer(["stages"], warm=warm, environment={"PYTHONPATH": before_others(place)})


def before_others(place: Path) -> str:
    """Return a search path for modules that begins with a directory."""
    return os.pathsep.join([str(place), *filter(None, [os.environ.get("PYTHONPATH")])])


def test_it_says_that_it_starts_until_it_can_fork(directory: Path) -> None:
    server = ForkServer(["reader"], warm=False)
    assert not server.starting
    server.start()
    try:
        assert server.starting
        child = Child("reader", LIMITS, fork_server=server)
        assert child.call("check", directory, wall_s=60) == WHOLE
        assert not server.starting
        child.close()
    finally:
        server.close()
    assert not server.starting


def test_children_of_one_server_are_processes_of_their_own(directory: Path) -> None:
    made = [Child("reader", LIMITS, fork_server=FORKS) for _ in range(2)]
    try:
        assert [child.call("check", directory, wall_s=60) for child in made] == [WHOLE, WHOLE]
        pids = {child.pid for child in made}
        assert len(pids) == 2
        for pid in pids:
            process = psutil.Process(pid)
            assert process.cmdline()[0] == "foldback reader"
            assert (process.ppid(), os.getpgid(pid), os.getsid(pid)) == (pid_of(FORKS), pid, pid)
    finally:
        for child in made:
            child.close()
    assert not pids & {one.pid for one in psutil.Process(pid_of(FORKS)).children()}


def test_when_it_ends_its_children_end_and_the_next_one_has_another(
    server: ForkServer, directory: Path
) -> None:
    child = Child("reader", LIMITS, fork_server=server)
    child.call("check", directory, wall_s=60)
    process, first = psutil.Process(child.pid), pid_of(server)
    os.kill(first, signal.SIGKILL)
    assert not psutil.wait_procs([process], timeout=PATIENCE_S)[1]
    with pytest.raises(ChildError) as ended:
        child.call("check", directory, wall_s=60)
    assert ended.value.code == LOST
    child.close()
    child = Child("reader", LIMITS, fork_server=server)
    assert child.call("check", directory, wall_s=60) == WHOLE
    child.close()
    assert pid_of(server) != first


def test_one_that_was_ended_before_it_was_forked_does_not_stay(
    server: ForkServer, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    child = Child("reader", LIMITS, fork_server=server)
    child.call("check", directory, wall_s=60)
    os.kill(pid_of(server), signal.SIGSTOP)
    monkeypatch.setattr(children, "MAX_START_S", 0.0)
    early = Child("reader", LIMITS, fork_server=server)
    with pytest.raises(ChildError, match="did not start: took too long"):
        early.call("check", directory, wall_s=60)
    assert not early.alive
    os.kill(pid_of(server), signal.SIGCONT)
    early.close()
    assert child.call("check", directory, wall_s=60) == WHOLE
    monkeypatch.undo()
    # It is forked in its turn, and finds that nobody is there.
    after = Child("reader", LIMITS, fork_server=server)
    after.call("check", directory, wall_s=60)
    deadline = time.monotonic() + PATIENCE_S
    wanted = {child.pid, after.pid}
    while {one.pid for one in psutil.Process(pid_of(server)).children()} != wanted:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    for one in (child, after):
        one.close()


def test_what_keeps_it_from_starting_is_told(tmp_path: Path, directory: Path) -> None:
    server = spoiled(
        tmp_path / "code", "import sys\nsys.modules['planner.pipeline.stages'] = None\n"
    )
    for _ in range(2):
        child = Child("stages", LIMITS, fork_server=server)
        with pytest.raises(ChildError, match="did not start: .*planner.pipeline.stages") as refused:
            child.call("read", directory, wall_s=60)
        assert refused.value.code == "no-start"
        child.close()
    server.close()


def test_fork_server_while_it_compiles_passes_each_fraction_on(
    tmp_path: Path, directory: Path
) -> None:
    server = spoiled(
        tmp_path / "code",
        f"{WITHOUT_LIBRARIES}import time\n"
        "from pathlib import Path\n"
        "it = stand_in('planner.pipeline.warm_up')\n"
        "def warm_up(tell, soon, directory):\n"
        "    tell(Progress(stage='read', fraction=0.25, message=COMPILING))\n"
        f"    while not Path({str(tmp_path / '0.25')!r}).exists(): time.sleep(0.01)\n"
        "    tell(Progress(stage='read', fraction=0.5, message=COMPILING))\n"
        f"    while not Path({str(tmp_path / '0.5')!r}).exists(): time.sleep(0.01)\n"
        "it.warm_up = warm_up\n",
        warm=True,
    )
    told: list[tuple[str, float]] = []

    def tell(event: dict[str, Any]) -> None:
        told.append((event["message"], event["fraction"]))
        (tmp_path / str(event["fraction"])).touch()

    child = Child("stages", LIMITS, fork_server=server)
    try:
        child.call("read", directory, wall_s=60, on_progress=tell)
    finally:
        child.close()
        server.close()
    assert told[:2] == [(COMPILING, 0.25), (COMPILING, 0.5)]


PARENT = """
import json, sys, time
from pathlib import Path
from server.processes.children import Child, LOST
from server.processes.fork_server import ForkServer
from server.processes.limits import ChildLimits
server = ForkServer(["reader"], warm=False)
limits = ChildLimits(memory_bytes=2**30, cpu_s=60.0, warm=False)
child = Child("reader", limits, fork_server=server)
child.call("check", Path(sys.argv[1]), wall_s=60)
print(child.pid, server.pid, flush=True)
time.sleep(600)
"""


def test_it_ends_with_its_parent_and_so_do_its_children(directory: Path) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(directory)], stdout=subprocess.PIPE, text=True
    )
    with parent:
        theirs = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        assert len(theirs) == 2
        parent.kill()
    assert not psutil.wait_procs(theirs, timeout=PATIENCE_S)[1]


COMPILES = f"""{WITHOUT_LIBRARIES}
it = stand_in('planner.pipeline.warm_up')
def warm_up(tell, soon, directory):
    while True:
        pass
it.warm_up = warm_up
"""
STARTS = """
import os, signal, sys, time
from server.processes.fork_server import ForkServer
server = ForkServer(["stages"], warm=True, environment={"PYTHONPATH": sys.argv[1]})
server.start()
print(server.pid, flush=True)
time.sleep(600)
"""


def test_fork_server_that_compiles_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(COMPILES)
    parent = subprocess.Popen(
        [sys.executable, "-c", STARTS, before_others(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    with parent:
        server = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    try:
        assert not psutil.wait_procs([server], timeout=PATIENCE_S)[1]
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            server.kill()
