"""Names of workers: whoever looks who lives takes no name from anybody."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from server.settings import Settings
from server.store.worker_identity import Slots

PROBE = """
import sys
from pathlib import Path
from server.settings import Settings
from server.store.worker_identity import Slots
slots = Slots(Settings(data_dir=Path(sys.argv[1])))
print("begun", flush=True)
while True:
    slots.dead([sys.argv[2]])
"""
HOLD = """
import sys
from pathlib import Path
from server.settings import Settings
from server.store.worker_identity import Slots
slot = Slots(Settings(data_dir=Path(sys.argv[1]))).take()
print(slot.name, flush=True)
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


def test_a_name_is_free_whoever_looks_for_the_dead_meanwhile(tmp_path: Path) -> None:
    slots = Slots(Settings(data_dir=tmp_path))
    slot = slots.take()
    slot.close()
    with process(PROBE, str(tmp_path), slot.name), process(PROBE, str(tmp_path), slot.name):
        for _ in range(1000):
            taken = slots.take()
            taken.close()
            assert taken.name == slot.name


def test_a_worker_that_was_killed_is_dead_at_once(tmp_path: Path) -> None:
    slots = Slots(Settings(data_dir=tmp_path))
    with process(HOLD, str(tmp_path)) as (worker, name):
        mine = slots.take()
        assert mine.name != name
        assert slots.dead([name, mine.name, "another/machine/0"]) == set()
        worker.kill()
        worker.wait()
        assert slots.dead([name, mine.name]) == {name}
    mine.close()
