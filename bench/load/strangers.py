"""Strangers: slowdown of others by a few visitors with target streams and first views."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from typing import Final

import httpx
import numpy as np
import psutil
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from bench.load.loopback import serving
from bench.load.visitors import percentile_ms
from bench.sections import Section
from tests.planner.peels import snake
from tests.server.service_process import SNAKE, Service

MAX_PAGE_BESIDE_STREAMS_MS: Final = 200
"""Target for the 95th percentile of the time to load a page while other visitors occupy the service
with target streams or first views, in ms; at or above it the load test fails."""
MAX_WEB_GROWTH_MB: Final = 300
"""Maximum growth of the resident memory of the web process while visitors occupy it with simulated
target streams or first views, in MB; above it the load test fails."""
ADDRESSES, STREAMS_PER_ADDRESS = 3, 8
"""Number of client addresses, and of target streams that each of them opens."""
WITNESS_POLL_S: Final = 0.05
"""Pause between two requests of the client that measures how much others delay it, in s."""
STREAM_RETRY_S: Final = 0.2
"""Maximum time that a client waits for a message before it reports its joint error again,
and pause before it connects again, in s."""


def strangers(short: bool = False) -> Section:
    """Measure the times of others' pages, and the peak memory of the web process."""
    section = Section(name="strangers")
    side, seconds = (5, 3.0) if short else (10, 20.0)
    with serving(largest_queue_of_visitor=32) as service:
        cells = np.rint(snake((side, side, side)).folded_poses.positions).astype(int)
        box = service.fold(cells.tolist())["id"]
        small = [service.fold(SNAKE, seed=str(k))["id"] for k in range(4)]
        for fold in (box, *small):
            assert service.wait_over(fold)["status"] == "verified"
        witness = _Witness(service, small[0])
        per_address = f"{STREAMS_PER_ADDRESS} target streams each on {side**3} modules"
        label = f"{ADDRESSES} addresses with {per_address}"
        with witness.looking(section, "nobody else", judged=False):
            time.sleep(seconds / 4)
        with witness.looking(section, label, judged=not short):
            led = _drive(service, box, seconds)
        section.add(
            "target streams with a target, in turns", f"{led} of {ADDRESSES * STREAMS_PER_ADDRESS}"
        )
        with witness.looking(section, "four first views", judged=not short):
            _view(service, small)
            time.sleep(seconds / 4)
    return section


class _Witness:
    """Client that requests the health and a page repeatedly, from an address of its own."""

    def __init__(self, service: Service, fold: str) -> None:
        self._address = str(service.http.base_url)
        assert service.process is not None
        self._process = psutil.Process(service.process.pid)
        self._paths = {"health": "/health", "page": f"/folds/{fold}"}

    @contextmanager
    def looking(self, section: Section, label: str, *, judged: bool) -> Generator[None]:
        """Add to a section the times and memory that were measured within the context."""
        over = threading.Event()
        times: dict[str, list[float]] = {name: [] for name in self._paths}
        before = self._mb()
        sizes = [before]

        def ask(name: str) -> None:
            headers = {"X-Forwarded-For": "10.9.0.1"}
            with httpx.Client(base_url=self._address, headers=headers, timeout=60.0) as http:
                while not over.wait(WITNESS_POLL_S):
                    start_s = time.perf_counter()
                    http.get(self._paths[name]).raise_for_status()
                    times[name].append(time.perf_counter() - start_s)
                    sizes.append(self._mb())

        threads = [threading.Thread(target=ask, args=(name,)) for name in self._paths]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            over.set()
            for thread in threads:
                thread.join()
        growth = sizes[-1] - before
        for name, values in times.items():
            section.rows.append(
                {
                    "what": label,
                    "kind": name,
                    "requests": len(values),
                    "p50, ms": percentile_ms(values, 50),
                    "p95, ms": percentile_ms(values, 95),
                    "most, ms": percentile_ms(values, 100),
                    "before, MB": before,
                    "most, MB": max(sizes),
                    "then, MB": sizes[-1],
                }
            )
        page = percentile_ms(times["page"], 95)
        section.add(
            f"page p95, {label}",
            f"{page:.0f} ms",
            f"< {MAX_PAGE_BESIDE_STREAMS_MS} ms",
            page < MAX_PAGE_BESIDE_STREAMS_MS if judged else None,
        )
        section.add(
            f"memory, {label}",
            f"{growth:+.0f} MB, at most {max(sizes) - before:+.0f} MB",
            f"≤ {MAX_WEB_GROWTH_MB} MB",
            max(sizes) - before <= MAX_WEB_GROWTH_MB if judged else None,
        )

    def _mb(self) -> float:
        return self._process.memory_info().rss / 1e6


def _drive(service: Service, fold: str, seconds: float) -> int:
    """Open target streams that request different speed limits and report that they are on target.

    Returns:
        Number of target streams that received a target.
    """
    base = str(service.http.base_url).replace("http", "ws", 1).rstrip("/")
    over = threading.Event()
    led: set[int] = set()

    def drive(number: int) -> None:
        address = f"{base}/api/folds/{fold}/play?max_speed={1 + number / 100}&rate_hz=100"
        headers = {"X-Forwarded-For": f"10.8.0.{number // STREAMS_PER_ADDRESS + 1}"}
        while not over.is_set():
            with (
                suppress(WebSocketException, OSError),
                connect(address, additional_headers=headers, max_size=None) as client,
            ):
                while not over.is_set():
                    with suppress(TimeoutError):
                        if '"target"' in str(client.recv(timeout=STREAM_RETRY_S))[:100]:
                            led.add(number)
                        client.send('{"do": "report", "error_rad": 0}')
            over.wait(STREAM_RETRY_S)

    threads = [
        threading.Thread(target=drive, args=(k,)) for k in range(ADDRESSES * STREAMS_PER_ADDRESS)
    ]
    for thread in threads:
        thread.start()
    time.sleep(seconds)
    over.set()
    for thread in threads:
        thread.join()
    return len(led)


def _view(service: Service, folds: list[str]) -> None:
    """Request all folds at the same time, each for the first time."""

    def view(fold: str, number: int) -> None:
        headers = {"X-Forwarded-For": f"10.7.0.{number}"}
        httpx.get(str(service.http.base_url.join(f"/folds/{fold}")), headers=headers, timeout=60.0)

    threads = [threading.Thread(target=view, args=(fold, k)) for k, fold in enumerate(folds, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
