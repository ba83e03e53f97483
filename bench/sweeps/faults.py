"""Faults of sweeps: command, worker, scheduler killed, worker suspended, machine cut off.

``python -m bench.sweeps.faults [NUMBER [SEED]]`` does a number of each kind.
"""

from __future__ import annotations

import contextlib
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Final

import msgspec
import psutil
from rich.console import Console

from bench.sections import Section
from bench.sweeps.cluster import Relay, Restarted, free_port
from bench.sweeps.command_under_faults import NUMBER_FILE, WITNESS_FILE
from foldback.planner.sweeps.case import Row
from foldback.planner.sweeps.rows import Rows

FAULTS_OF_A_KIND: Final = 20
"""Number of faults of each kind."""
WORKERS: Final = 3
"""Number of workers, of which one is connected by a relay."""
WORKER_TTL_S: Final = 10.0
"""Time without a sign of life after which Dask's scheduler gives a worker up, s. Dask's default is
5 minutes."""
ABSENCE_S: Final = WORKER_TTL_S + 3.0
"""Time for which a worker is suspended or cut off, s."""
ROWS_BETWEEN: Final = 8
"""Number of rows that are written between a fault and the next one."""
TIMEOUT_S: Final = 300.0
"""Time without these rows after which the sweep counts as stalled, s."""
CONFIGURATION: Final = {
    "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{WORKER_TTL_S} s",
    "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "10",
}


class FaultyCluster:
    """Scheduler, workers and the command of a sweep, each started again when it ends."""

    def __init__(self, directory: Path, chance: random.Random) -> None:
        self.directory = directory
        self._chance = chance
        port = free_port()
        self.address = f"tcp://127.0.0.1:{port}"
        scheduler = ("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--no-show")
        self.scheduler = self._start("scheduler", *scheduler, "--port", str(port), "--no-dashboard")
        self.relay = Relay(port)
        ports = [self.relay.port] + [port] * (WORKERS - 1)
        self.workers = [
            self._start(
                *(f"worker-{index}", "-m", "distributed.cli.dask_worker"),
                *(f"tcp://127.0.0.1:{worker_port}", "--nthreads", "1", "--no-dashboard"),
                # A worker that loads them later is silent for seconds, and counts as lost.
                *("--preload", "foldback.planner.sweeps.limited_process"),
                *("--local-directory", str(directory / "workers"), "--memory-limit", "0"),
            )
            for index, worker_port in enumerate(ports)
        ]
        self.command = self._start_command()

    def _start(self, name: str, *arguments: str) -> Restarted:
        return Restarted(arguments, self.directory / f"{name}.log", CONFIGURATION)

    def _start_command(self) -> subprocess.Popen[bytes]:
        module = "bench.sweeps.command_under_faults"
        with (self.directory / "command.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", module, str(self.directory), self.address],
                stdout=log,
                stderr=log,
            )

    def kill_command(self) -> None:
        """Kill the command and start it again."""
        self.command.kill()
        self.command.wait()
        self.command = self._start_command()

    def kill_worker(self) -> None:
        """Kill a worker; its nanny starts another one."""
        with self._worker() as worker:
            worker.kill()

    def kill_scheduler(self) -> None:
        """Kill the scheduler; it is started again, and workers, which end with it."""
        self.scheduler.process.kill()

    def suspend_worker(self) -> None:
        """Suspend a worker until it counts as lost; then it comes back."""
        with self._worker() as worker:
            worker.send_signal(signal.SIGSTOP)
            time.sleep(ABSENCE_S)
            worker.send_signal(signal.SIGCONT)

    def cut_off_machine(self) -> None:
        """Forward nothing from and to a worker until it counts as lost; then break its link."""
        self.relay.cut_off(ABSENCE_S)

    @contextlib.contextmanager
    def _worker(self) -> Generator[psutil.Process]:
        """Yield the process of any worker that is running."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline_s:
            if worker := self._chance.choice(self.workers).worker():
                with contextlib.suppress(psutil.NoSuchProcess):
                    yield worker
                return
            time.sleep(0.1)
        raise TimeoutError("no worker is running")

    def close(self) -> None:
        """End everything."""
        self.command.kill()
        self.command.wait()
        for program in (*self.workers, self.scheduler):
            for child in psutil.Process(program.process.pid).children():
                with contextlib.suppress(psutil.NoSuchProcess):
                    child.kill()
            program.end()
        self.relay.close()


def row_keys(directory: Path) -> list[str]:
    """Return the key of each complete line of the rows, those that are there twice as well."""
    decoder = msgspec.json.Decoder(Row)
    return [
        str(decoder.decode(line)["key"])
        for path in Rows(directory).files()
        for line in path.read_bytes().splitlines(keepends=True)
        if line.endswith(b"\n")
    ]


def sweep_faults(_: float, number: int = FAULTS_OF_A_KIND, seed: int | None = None) -> Section:
    """Measure what is lost or there twice after faults of all kinds, mixed."""
    section = Section(name="sweep-faults")
    seed = random.randrange(2**31) if seed is None else seed
    chance = random.Random(seed)
    section.add("seed", str(seed))
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
        cluster = FaultyCluster(Path(place), chance)
        try:
            kinds: list[Callable[[], None]] = [
                *(cluster.kill_command, cluster.kill_worker, cluster.kill_scheduler),
                *(cluster.suspend_worker, cluster.cut_off_machine),
            ]
            faults = kinds * number
            chance.shuffle(faults)
            start_s = time.monotonic()
            for index, fault in enumerate(faults, 1):
                _wait_for_rows(cluster.directory, ROWS_BETWEEN)
                fault()
                print(f"{index:3} {fault.__name__:16} {time.monotonic() - start_s:6.0f} s")
            _wait_for_rows(cluster.directory, ROWS_BETWEEN)
            _end(cluster)
            for kind in kinds:
                section.add(kind.__name__.replace("_", " "), str(number))
            _judge(section, cluster.directory, len(faults))
        finally:
            cluster.close()
    return section


def _wait_for_rows(directory: Path, number: int) -> None:
    before = len(row_keys(directory))
    deadline_s = time.monotonic() + TIMEOUT_S
    while len(row_keys(directory)) < before + number:
        if time.monotonic() > deadline_s:
            logs = [path.read_text(errors="replace")[-2000:] for path in directory.glob("*.log")]
            raise TimeoutError("\n".join(["the sweep has stalled", *logs]))
        time.sleep(0.1)


def _end(cluster: FaultyCluster) -> None:
    """Let the command end with the cases that it has begun."""
    begun = (cluster.directory / WITNESS_FILE).read_text().split()
    number = 1 + max(map(int, begun))
    (cluster.directory / NUMBER_FILE).write_text(str(number))
    cluster.command.wait(TIMEOUT_S)


def _judge(section: Section, directory: Path, faults: int) -> None:
    rows = Counter(row_keys(directory))
    cases = int((directory / NUMBER_FILE).read_text())
    lost = [key for key in map(str, range(cases)) if key not in rows]
    twice = [key for key, number in rows.items() if number > 1]
    given_up = [key for key, row in Rows(directory).read().items() if row["verdict"] != "noted"]
    starts = Counter((directory / WITNESS_FILE).read_text().split())
    again = sum(number - 1 for number in starts.values())
    section.add("cases", str(cases))
    section.add("cases without a row", str(len(lost)), "0", not lost)
    section.add("cases with two rows", str(len(twice)), "0", not twice)
    section.add("cases that were given up", str(len(given_up)), "0", not given_up)
    section.add("cases started again, for each fault", f"{again / faults:.2f}")


def main() -> None:
    """Run faults and print the figures."""
    number, seed = (*map(int, sys.argv[1:]), *(1, 0)[len(sys.argv) - 1 :])[:2]
    sweep_faults(0.0, number, seed).show(Console())


if __name__ == "__main__":
    main()
