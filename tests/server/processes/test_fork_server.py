"""Fork server: its children, their independence, and its end."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import psutil
import pytest

from foldback.server.processes import children, fork_server
from foldback.server.processes.children import LOST, ChildError
from foldback.server.processes.fork_server import ForkServer
from tests.refusal import refused
from tests.server.processes.test_children import make_child, upload_in, without_libraries
from tests.server.service_process import TIMEOUT_S, wait_until
from tests.server.service_thread import FORKS

pytestmark = pytest.mark.processes

RESULT = {"name": "snake", "module": "cube", "module_words": None, "modules": 16}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    return upload_in(tmp_path)


def make_server(directory: Path, extra: str = "") -> ForkServer:
    """Return a server whose children compute nothing, and that first runs more code."""
    directory.mkdir()
    return ForkServer(["stages"], environment=without_libraries(directory, extra))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    with closing(make_server(tmp_path_factory.mktemp("forks") / "code")) as server:
        yield server


def pid_of(server: ForkServer) -> int:
    assert server.pid is not None
    return server.pid


def test_children_of_one_server_are_processes_of_their_own(directory: Path) -> None:
    with make_child(fork_server=FORKS) as first, make_child(fork_server=FORKS) as second:
        for child in (first, second):
            assert child.call("check", directory, wall_s=60) == RESULT
            process, pid = psutil.Process(child.pid), child.pid
            assert process.cmdline()[0] == "foldback reader"
            assert (process.ppid(), os.getpgid(pid), os.getsid(pid)) == (pid_of(FORKS), pid, pid)
        pids = {first.pid, second.pid}
        assert len(pids) == 2
    assert not pids & {process.pid for process in psutil.Process(pid_of(FORKS)).children()}


def test_children_of_a_killed_fork_server_end_and_it_is_replaced(
    server: ForkServer, directory: Path
) -> None:
    server.start()
    first = pid_of(server)
    with make_child("stages", fork_server=server) as child:
        assert child.call("read", directory, wall_s=60) == {}
        assert pid_of(server) == first
        process = psutil.Process(child.pid)
        os.kill(first, signal.SIGKILL)
        assert not psutil.wait_procs([process], timeout=TIMEOUT_S)[1]
        with refused(LOST, kind=ChildError):
            child.call("read", directory, wall_s=60)
    with make_child("stages", fork_server=server) as child:
        assert child.call("read", directory, wall_s=60) == {}
    assert pid_of(server) != first


def test_hung_fork_server_is_replaced(
    server: ForkServer, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fork_server, "MAX_SILENCE_S", 0.5)
    monkeypatch.setattr(fork_server, "PING_INTERVAL_S", 0.1)
    monkeypatch.setattr(children, "KILL_S", 0.5)
    with make_child("stages", fork_server=server) as child:
        child.call("read", directory, wall_s=60)
        first = pid_of(server)
        os.kill(first, signal.SIGSTOP)
        with make_child("stages", fork_server=server) as waiting:
            with pytest.raises(ChildError, match="did not start") as late:
                waiting.call("read", directory, wall_s=60)
            assert late.value.temporary
    with make_child("stages", fork_server=server) as child:
        assert child.call("read", directory, wall_s=60) == {}
        assert pid_of(server) != first
        # A running child also ends while the server is stopped.
        os.kill(pid_of(server), signal.SIGSTOP)
        child.kill()
        assert not child.alive


def test_child_ended_before_it_was_forked_does_not_stay(
    server: ForkServer, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with make_child("stages", fork_server=server) as child:
        child.call("read", directory, wall_s=60)
        os.kill(pid_of(server), signal.SIGSTOP)
        monkeypatch.setattr(children, "MAX_START_S", 0.0)
        with make_child("stages", fork_server=server) as early:
            with pytest.raises(ChildError, match="did not start: it took too long"):
                early.call("read", directory, wall_s=60)
            assert not early.alive
            os.kill(pid_of(server), signal.SIGCONT)
        monkeypatch.undo()
        assert child.call("read", directory, wall_s=60) == {}
        # The late child ends at once, because its client is gone.
        with make_child("stages", fork_server=server) as after:
            after.call("read", directory, wall_s=60)
            expected, forking = {child.pid, after.pid}, psutil.Process(pid_of(server))
            wait_until(lambda: {process.pid for process in forking.children()} == expected)


def test_reason_why_a_fork_server_cannot_start_is_logged(
    tmp_path: Path, directory: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    without_stages = "sys.modules['foldback.planner.pipeline.stages'] = None\n"
    with closing(make_server(tmp_path / "code", without_stages)) as server:
        for _ in range(2):
            with make_child("stages", fork_server=server) as child:
                words = "did not start: an unexpected error"
                with refused("no-start", match=words, kind=ChildError):
                    child.call("read", directory, wall_s=60)
    assert "foldback.planner.pipeline.stages" in capfd.readouterr().err


PARENT = """
import sys, time
from pathlib import Path
from foldback.server.processes.children import Child
from foldback.server.processes.fork_server import ForkServer
from foldback.server.processes.limits import ChildLimits
server = ForkServer(["stages"], environment={"PYTHONPATH": sys.argv[2]})
child = Child("stages", ChildLimits(memory_bytes=2**30, cpu_s=60.0), fork_server=server)
child.call("read", Path(sys.argv[1]), wall_s=60)
print(child.pid, server.pid, flush=True)
time.sleep(600)
"""


def test_fork_server_and_children_end_when_its_parent_is_killed(
    tmp_path: Path, directory: Path
) -> None:
    search = without_libraries(tmp_path)["PYTHONPATH"]
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, str(directory), search], stdout=subprocess.PIPE, text=True
    ) as parent:
        children = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        assert len(children) == 2
        parent.kill()
    alive = psutil.wait_procs(children, timeout=TIMEOUT_S)[1]
    for process in alive:
        process.kill()
    assert not alive
