"""Visitors: many at once, in a separate process, so that their own cost can be measured.

``python -m bench.load.visitors`` reads ``Visits`` as JSON from standard input and writes the
measurements as JSON to standard output.
"""

from __future__ import annotations

import asyncio
import json
import random
import ssl
import subprocess
import sys
import time
from collections import defaultdict
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

import httpx
import numpy as np

from bench.load.loopback import checked

SETTLE_S = 2.0
"""Time after the arrival of the last simulated visitor, in s, before which requests are reported
separately, as pages are still loading."""
FRAMES_PER_BATCH = 128
"""Number of frames of a motion that a simulated visitor requests at once after it has moved the
slider."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """Plan of all visitors.

    Attributes:
        address: Address of the service, on this machine.
        folds: Fold that each visitor views.
        seconds: Seconds for which they continue after all have arrived.
        arrive_s: Seconds within which all of them arrive.
        pause_s: Mean seconds between two moves of a slider.
        streams: Number of visitors that also follow a fold by its event stream.
        followed: Folds that those follow; empty for the folds that they view.
        seed: Seed of all random choices.
    """

    address: str
    folds: list[str]
    seconds: float
    arrive_s: float = 3.0
    pause_s: float = 1.0
    streams: int = 0
    followed: list[str] = field(default_factory=list)
    seed: int = 1

    def run(self) -> dict[str, Any]:
        """Run the visitors in a process of their own.

        Returns:
            ``arriving_s`` and ``times_s``, seconds of each request by kind, before and after all
            visitors had arrived; ``errors``, their number by description; ``cpu_s`` and ``wall_s``
            of the visitors' own process.
        """
        checked(self.address)
        done = subprocess.run(
            [sys.executable, "-m", "bench.load.visitors"],
            input=json.dumps(asdict(self)),
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        return json.loads(done.stdout)


class _Crowd:
    """All visitors of one plan."""

    def __init__(self, visits: Visits) -> None:
        self._visits = visits
        self._times: dict[str, list[float]] = defaultdict(list)
        self._arriving: dict[str, list[float]] = defaultdict(list)
        self._errors: dict[str, int] = defaultdict(int)
        self._all_arrived = self._until = 0.0
        # One context for all clients: creating one takes longer than a hundred requests.
        self._tls = ssl.create_default_context()

    async def run(self) -> dict[str, Any]:
        start_s, cpu = time.monotonic(), time.process_time()
        self._all_arrived = start_s + self._visits.arrive_s + SETTLE_S
        self._until = self._all_arrived + self._visits.seconds
        async with asyncio.TaskGroup() as tasks:
            for number, fold in enumerate(self._visits.folds):
                tasks.create_task(self._visit(number, fold))
        return {
            "times_s": self._times,
            "arriving_s": self._arriving,
            "errors": self._errors,
            "cpu_s": time.process_time() - cpu,
            "wall_s": time.monotonic() - start_s,
        }

    async def _visit(self, number: int, fold: str) -> None:
        """Open a page, move its slider several times, and reopen it, until the time is over."""
        rng = random.Random(f"{self._visits.seed}/{number}")
        headers = {"X-Forwarded-For": f"10.1.{number // 250}.{number % 250 + 1}"}
        limits = httpx.Limits(max_connections=6)
        async with httpx.AsyncClient(
            base_url=self._visits.address,
            headers=headers,
            limits=limits,
            timeout=30.0,
            verify=self._tls,
            trust_env=False,
        ) as http:
            await asyncio.sleep(rng.uniform(0, self._visits.arrive_s))
            follower: asyncio.Task[None] | None = None
            if number < self._visits.streams:
                followed = self._visits.followed or self._visits.folds
                follower = asyncio.create_task(self._follow(http, followed[number % len(followed)]))
            while time.monotonic() < self._until:
                total = await self._open(http, fold)
                for _ in range(rng.randint(8, 16)):
                    if time.monotonic() >= self._until:
                        break
                    await asyncio.sleep(rng.expovariate(1 / self._visits.pause_s))
                    first = rng.randrange(max(1, total)) // FRAMES_PER_BATCH * FRAMES_PER_BATCH
                    last = first + FRAMES_PER_BATCH
                    batch = f"/folds/{fold}/batch?from={first}&stride=1&wait=0&to={last}"
                    await self._get(http, "scrub", batch)
                    if rng.random() < 0.2:
                        await self._get(http, "API", f"/api/folds/{fold}")
            if follower is not None:
                follower.cancel()
                with suppress(asyncio.CancelledError):
                    await follower

    async def _open(self, http: httpx.AsyncClient, fold: str) -> int:
        """Send the requests of a browser that opens a page; return the number of frames."""
        await self._get(http, "page", f"/folds/{fold}")
        await asyncio.gather(
            self._get(http, "batch", f"/folds/{fold}/bundle"),
            self._get(http, "batch", f"/folds/{fold}/batch?from=0&stride=1&wait=0&to=1"),
        )
        state = await self._get(http, "API", f"/api/folds/{fold}")
        total = int(state.json()["progress"]["frames"]) if state is not None else 0
        stride = -(-total // 64)
        if stride > 1:
            await self._get(http, "batch", f"/folds/{fold}/batch?from=0&stride={stride}&wait=0")
        await self._get(http, "batch", f"/folds/{fold}/figures")
        return total

    async def _get(self, http: httpx.AsyncClient, kind: str, path: str) -> httpx.Response | None:
        times = self._times if time.monotonic() >= self._all_arrived else self._arriving
        start_s = time.perf_counter()
        try:
            answer = await http.get(path)
        except httpx.HTTPError as error:
            self._errors[f"{kind}: {type(error).__name__}"] += 1
            return None
        times[kind].append(time.perf_counter() - start_s)
        if answer.status_code not in (200, 204, 304):
            self._errors[f"{kind}: {answer.status_code}"] += 1
            return None
        return answer

    async def _follow(self, http: httpx.AsyncClient, fold: str) -> None:
        try:
            while True:
                async with http.stream("GET", f"/api/folds/{fold}/events") as stream:
                    if stream.status_code != 200:
                        self._errors[f"events: {stream.status_code}"] += 1
                    async for _ in stream.aiter_bytes():
                        pass
                await asyncio.sleep(1.0)
        except httpx.HTTPError as error:
            self._errors[f"events: {type(error).__name__}"] += 1


def percentile_ms(times_s: list[float], q: float) -> float:
    """Return a percentile in milliseconds; 0 if there are no times."""
    return 1000 * float(np.percentile(times_s, q)) if times_s else 0.0


if __name__ == "__main__":
    print(json.dumps(asyncio.run(_Crowd(Visits(**json.load(sys.stdin))).run())))
