"""Viewers: a thousand of them connect and leave; the server's memory must not grow."""

from __future__ import annotations

import asyncio
import gc
import random
import time
from collections import Counter
from contextlib import suppress

import httpx
import psutil
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from bench.load.loopback import serving
from bench.sections import Section
from tests.server.service_process import SNAKE, Service

MAX_VIEWERS_GROWTH_MB = 50
"""Maximum growth of the resident memory of the web process from the first 20 viewers to 5 s after
the last of 1000 further ones, in MB; above it the load test fails, as the process leaks memory."""
CONCURRENT_VIEWERS = 25
"""Number of viewers, out of 1000, that load a fold's page and data at the same time."""
VIEWERS_PER_STREAM = 10
"""Every n-th viewer, n being this value, also opens a target stream of the fold."""


def viewers(short: bool = False) -> Section:
    """Measure the memory of the web process before and after the viewers."""
    section = Section(name="viewers")
    count, warm = (40, 10) if short else (1000, 20)
    with serving(max_target_streams_of_visitor=32) as service:
        address = str(service.http.base_url)
        folds = [service.fold(SNAKE, seed=str(k))["id"] for k in range(2 if short else 5)]
        if not short:
            folds.append(service.fold(shape="wrench-160")["id"])
        for fold in folds:
            assert service.wait_over(fold)["status"] == "verified"
        errors: Counter[str] = Counter()
        asyncio.run(_come(address, folds, warm, errors))
        before = _resident_mb(service)
        start_s = time.monotonic()
        asyncio.run(_come(address, folds, count, errors))
        took_s = time.monotonic() - start_s
        peak = _resident_mb(service)
        time.sleep(0.5 if short else 5)
        after = _resident_mb(service)
        metrics = service.metrics().text
    section.rows.append(
        {"viewers": count, "before, MB": before, "at the end, MB": peak, "then, MB": after}
    )
    section.add(
        f"memory after {count} viewers, against that after {warm}",
        f"{after - before:+.0f} MB, in {took_s:.0f} s",
        f"≤ {MAX_VIEWERS_GROWTH_MB} MB",
        after - before <= MAX_VIEWERS_GROWTH_MB,
    )
    section.add("errors", str(dict(errors)), "none", not errors)
    streams = [line for line in metrics.splitlines() if "streams" in line and line[0] != "#"]
    if streams:
        section.add("still open", "; ".join(streams))
    return section


async def _come(address: str, folds: list[str], count: int, errors: Counter[str]) -> None:
    semaphore = asyncio.Semaphore(CONCURRENT_VIEWERS)

    async def one(number: int) -> None:
        async with semaphore:
            try:
                await _view(address, folds[number % len(folds)], number, errors)
            except (httpx.HTTPError, OSError, WebSocketException, TimeoutError) as error:
                errors[f"{type(error).__name__}: {error}"] += 1

    await asyncio.gather(*(one(k) for k in range(count)))
    gc.collect()


async def _view(address: str, fold: str, number: int, errors: Counter[str]) -> None:
    rng = random.Random(number)
    headers = {"X-Forwarded-For": f"10.3.{number // 250}.{number % 250 + 1}"}
    async with httpx.AsyncClient(base_url=address, headers=headers, timeout=60.0) as http:
        for path in (
            f"/folds/{fold}",
            "/view",
            f"/folds/{fold}/bundle",
            f"/folds/{fold}/batch?from=0&to=128",
            f"/folds/{fold}/batch?stride={rng.randint(1, 9)}",
            f"/folds/{fold}/figures",
            f"/api/folds/{fold}",
        ):
            answer = await http.get(path)
            if answer.status_code not in (200, 204):
                errors[f"{path.rpartition('/')[2].partition('?')[0]}: {answer.status_code}"] += 1
        async with http.stream("GET", f"/api/folds/{fold}/events") as stream:
            with suppress(StopAsyncIteration):
                await anext(stream.aiter_bytes())
    if number % VIEWERS_PER_STREAM == 0:
        socket = f"{address.replace('http', 'ws').rstrip('/')}/api/folds/{fold}/play"
        async with connect(socket, additional_headers=headers) as client:
            await asyncio.wait_for(client.recv(), 30)


def _resident_mb(service: Service) -> float:
    assert service.process is not None
    return psutil.Process(service.process.pid).memory_info().rss / 1e6
