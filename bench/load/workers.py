"""Workers: the same folds with one worker and with two."""

from __future__ import annotations

import json
import os
import time

import psutil

from bench.load.loopback import serving
from bench.sections import Section
from tests.server.service_process import SNAKE, Service

MIN_SPEED_UP = 1.8
"""Minimum ratio of the wall times of the same folds with one worker and with two. Below it the load
test fails, unless two workers already use more than 90 % of all processor cores."""


def workers(short: bool = False) -> Section:
    """Measure the wall time and processor time of some folds."""
    section = Section(name="workers")
    count = 2 if short else 20
    folds = {number: _folds(number, count, short) for number in (1, 2)}
    for number, (wall_s, cpu_s) in folds.items():
        section.rows.append(
            {
                "workers": number,
                "folds": count,
                "wall, s": wall_s,
                "cores in use": cpu_s / wall_s,
                "processor a fold, s": cpu_s / count,
            }
        )
    faster = folds[1][0] / folds[2][0]
    busy = folds[2][1] / folds[2][0] / (os.cpu_count() or 1)
    section.add(
        f"{count} folds, two workers against one",
        f"{faster:.2f} ×, with {busy:.0%} of the cores in use",
        f"≥ {MIN_SPEED_UP} ×, or no core left",
        None if short else faster >= MIN_SPEED_UP or busy > 0.9,
    )
    return section


def _folds(number: int, count: int, short: bool) -> tuple[float, float]:
    """Return wall and processor seconds from the first fold's upload to the last one's end."""
    with serving(workers=number, largest_queue_of_visitor=count) as service:
        service.wait_workers(number)
        for k in range(number):  # so that the first child of each worker is ready
            service.fold(SNAKE, seed=str(10_000 + k))
        _wait(service)
        start_s, cpu_s = time.monotonic(), _busy_s()
        for k in range(count):
            form = {"seed": str(k + 1)}
            if short:
                service.fold(SNAKE, **form)
            else:
                service.fold(shape="wrench-160", **form)
        _wait(service)
        return time.monotonic() - start_s, _busy_s() - cpu_s


def _wait(service: Service) -> None:
    """Wait until no fold is queued or running."""
    folder = service.data_dir / "folds"
    ids = [path.name for path in folder.iterdir()]
    for fold in ids:
        while (state := service.state(fold))["status"] in ("queued", "running"):
            time.sleep(0.1)
        assert state["status"] == "verified", json.dumps(state)


def _busy_s() -> float:
    """Return the processor time of all cores of this machine, s."""
    times = psutil.cpu_times()
    return times.user + times.system + times.nice
