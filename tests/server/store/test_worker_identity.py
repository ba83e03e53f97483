"""Names of workers: whoever looks who lives takes no name from anybody."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from server.settings import Settings
from server.store.worker_identity import WorkerIdentities

PROBE = """
import sys
from pathlib import Path
from server.settings import Settings
from server.store.worker_identity import WorkerIdentities
identities = WorkerIdentities(Settings(data_dir=Path(sys.argv[1])))
print("begun", flush=True)
while True:
    identities.dead([sys.argv[2]])
"""
HOLD = """
import sys
from pathlib import Path
from server.settings import Settings
from server.store.worker_identity import WorkerIdentities
identity = WorkerIdentities(Settings(data_dir=Path(sys.argv[1]))).take()
print(identity.name, flush=True)
sys.stdin.read()
"""


@contextmanager
def process(code: str, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process that has said its first line."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as started:
        assert started.stdout is not None
        try:
            yield started, started.stdout.readline().strip()
        finally:
            started.kill()


def test_probe_for_dead_workers_takes_no_name(tmp_path: Path) -> None:
    identities = WorkerIdentities(Settings(data_dir=tmp_path))
    identity = identities.take()
    identity.close()
    with process(PROBE, str(tmp_path), identity.name), process(PROBE, str(tmp_path), identity.name):
        for _ in range(300):
            taken = identities.take()
            taken.close()
            assert taken.name == identity.name


def test_killed_worker_is_dead_at_once(tmp_path: Path) -> None:
    identities = WorkerIdentities(Settings(data_dir=tmp_path))
    with process(HOLD, str(tmp_path)) as (worker, name):
        mine = identities.take()
        assert mine.name != name
        assert identities.dead([name, mine.name, "another/machine/0"]) == set()
        worker.kill()
        worker.wait()
        assert identities.dead([name, mine.name]) == {name}
    mine.close()
