"""Attempt pool: explosions of a fold, likely next ones computed speculatively in other processes.

The attempts and their order are those of one process: ``RetryPolicy.next_attempt`` decides them.
Likely next attempts are started early, each in a separate process; those that the order reaches are
used, the others are discarded. So a plan is the same whatever the number of workers.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, astuple
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final

from foldback.planner.motion.record import Record
from foldback.planner.pipeline.attempt import MAX_EXPLOSIONS, Attempt, AttemptSpec
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.progress import Cancelled, Progress, Report
from foldback.planner.storage.file_names import RECORD, TIMELINE, TRIALS_DIR

SPECULATION_PULSES: Final = 2
"""Consecutive pulses (weakened tension and stronger repulsion, to loosen a jam) without progress,
after which other processes begin the next attempts."""
ATTEMPT_STOP_GRACE_S: Final = 1.0
"""Time, in s, that a process that computes an attempt may take to write its result after it is told
to stop; then it is killed."""
PROGRESS_FILE: Final = "progress.json"
"""Name of the file in which a process that computes an attempt reports its progress."""
OUTCOME_FILE: Final = "attempt.json"
"""Name of the file with the outcome of an attempt that another process has computed; written last,
so that its presence marks the result as complete."""


class AttemptPool:
    """Processes that compute likely next attempts.

    Args:
        directory: Directory of the fold, with its input read; None without processes.
        workers: Explosions that are made at once at most; with one there are no processes. More
            than a fold may have would bring nothing.
    """

    def __init__(self, directory: FilePath | None, workers: int = 1) -> None:
        self._exchange = None if directory is None else directory.resolve() / TRIALS_DIR
        self._workers = 1 if directory is None else min(workers, MAX_EXPLOSIONS)
        self._beside: dict[AttemptSpec, _AttemptProcess] = {}
        self._ahead: Callable[[], list[AttemptSpec]] = list
        self._current: AttemptSpec | None = None
        self._eager = False
        self._clear()

    def __enter__(self) -> AttemptPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes and discard their results."""
        for beside in self._beside.values():
            beside.end()
        self._beside = {}
        self._clear()

    def _clear(self) -> None:
        if self._exchange is not None:
            rmtree(self._exchange, ignore_errors=True)

    def end_running(self) -> None:
        """End running attempts; results of finished ones stay."""
        self._keep([])

    def schedule(
        self, choice: RetryPolicy, attempts: Sequence[Attempt], current: AttemptSpec
    ) -> None:
        """Set the current attempt. After a failure the next ones are started at once."""
        before = tuple(attempts)
        self._current, self._eager = current, bool(attempts)
        self._ahead = lambda: choice.lookahead(before, current, self._finished())
        self._keep(self._ahead())
        if self._eager:
            self._begin()

    def with_speculation(self, progress: Report) -> Report:
        """Return a report that also starts the next attempts if the current one stalls."""

        def report(now: Progress) -> None:
            progress(now)
            if self._eager or now.pushes >= SPECULATION_PULSES:
                self._begin()

        return report if self._workers > 1 else progress

    def collect(
        self, timeline: FilePath | None, progress: Report, cancelled: Cancelled
    ) -> Record | None:
        """Return the record of the current attempt if it was begun beside; wait for it.

        Its timeline moves to ``timeline`` unless that is None. None when it was not begun, or its
        process failed: whoever makes it here comes to the same, or sees why it cannot be made.
        """
        if self._current not in self._beside:
            return None
        beside = self._beside[self._current]
        while beside.running:
            if cancelled():
                beside.stop()
                break
            if (now := beside.progress()) is not None:
                progress(now)
            self._begin()
            time.sleep(0.05)
        del self._beside[self._current]
        record = beside.record()
        if record is not None and timeline is not None:
            rmtree(timeline, ignore_errors=True)
            (beside.place / TIMELINE).rename(timeline)
        beside.end()
        return record

    def _finished(self) -> dict[AttemptSpec, Attempt]:
        """Return the attempts that are finished, by their specifications."""
        attempts = {spec: beside.attempt() for spec, beside in self._beside.items()}
        return {spec: attempt for spec, attempt in attempts.items() if attempt is not None}

    def _keep(self, specs: Sequence[AttemptSpec]) -> None:
        """End running attempts that are not needed or exceed the limit, least likely first."""
        room = self._workers - (self._current not in self._beside)
        running = [spec for spec, beside in self._beside.items() if beside.running]
        running_specs = [spec for spec in (self._current, *specs) if spec in running][:room]
        for spec in running:
            if spec not in running_specs:
                self._beside.pop(spec).end()

    def _begin(self) -> None:
        """Start the likely next attempts, as many as there are processors for."""
        room = self._workers - (self._current not in self._beside)
        room -= sum(beside.running for beside in self._beside.values())
        if room <= 0 or self._exchange is None:
            return
        fresh = [spec for spec in self._ahead() if spec not in self._beside]
        for spec in fresh[:room]:
            try:
                self._beside[spec] = _AttemptProcess(self._exchange, spec)
            except OSError:  # no process or no room to be had: what is made here goes on alone
                self._workers = 1
                return


class _AttemptProcess:
    """One try in a process of its own, which runs ``attempt_process``."""

    def __init__(self, exchange: FilePath, spec: AttemptSpec) -> None:
        self.place = exchange / "-".join(map(str, astuple(spec)))
        rmtree(self.place, ignore_errors=True)
        self.place.mkdir(parents=True)
        modules = [str(FilePath(__file__).parents[3]), *filter(None, [os.getenv("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-m",
                "foldback.planner.pipeline.attempt_process",
                json.dumps(asdict(spec)),
            ],
            cwd=self.place,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(modules)},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # Ctrl-C is for this process, which then ends the other.
            process_group=0,
        )

    @property
    def running(self) -> bool:
        """True while it computes."""
        return self._process.poll() is None

    def progress(self) -> Progress | None:
        """Return its progress; None before it has begun."""
        progress = _read(self.place / PROGRESS_FILE)
        return None if progress is None else Progress(**progress)

    def attempt(self) -> Attempt | None:
        """Return its outcome; None before that is written."""
        outcome = None if self.running else _read(self.place / OUTCOME_FILE)
        return None if outcome is None else Attempt.from_dict(outcome)

    def record(self) -> Record | None:
        """Return its record; None when it failed."""
        return None if self.attempt() is None else Record.load(self.place / RECORD)

    def stop(self) -> None:
        """Stop the process, and wait until it has written its result."""
        self._hang_up()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2.0 * ATTEMPT_STOP_GRACE_S)

    def end(self) -> None:
        """Kill the process and discard its result."""
        self._process.kill()
        self._process.wait()
        self._hang_up()
        rmtree(self.place, ignore_errors=True)

    def _hang_up(self) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()


def _read(path: FilePath) -> dict[str, Any] | None:
    return json.loads(path.read_bytes()) if path.exists() else None
