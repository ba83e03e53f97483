"""Uploads: two hundred in a minute by many visitors; each is answered, and accepted ones finish."""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from typing import Any

import httpx

from bench.load.loopback import serving
from bench.sections import Section
from tests.server.service_process import SNAKE, Service

MAX_FOLD_S = 1800.0
"""Maximum time that the load test waits for the end of an accepted fold, in s; one that is still
queued or running then fails the test."""


def uploads(short: bool = False) -> Section:
    """Count the answers to uploads, and the results of the accepted ones."""
    section = Section(name="uploads")
    count, seconds, queue = (6, 1.0, 2) if short else (200, 60.0, 64)
    with serving(workers=1, largest_queue=queue, largest_queue_of_visitor=4) as service:
        service.wait_workers(1)
        address = str(service.http.base_url)
        start_s = time.monotonic()
        answers = asyncio.run(_send(address, count, seconds))
        sent_s = time.monotonic() - start_s
        accepted = [body["id"] for status, body, _, _ in answers if status == 202]
        ends: Counter[str] = Counter()
        for fold in accepted:
            ends[_end(service, fold)["status"]] += 1
        over_s = time.monotonic() - start_s
    statuses = Counter(status for status, *_ in answers)
    other_status = {status for status in statuses if status not in (202, 429)}
    silent = sum(status == 429 and not later for status, _, later, _ in answers)
    slowest = max(seconds for *_, seconds in answers)
    section.add(
        f"{count} uploads in {sent_s:.0f} s", str(dict(statuses)), "202 or 429", not other_status
    )
    section.add("429 without Retry-After", str(silent), "0", not silent)
    section.add(
        "what became of the accepted ones",
        f"{dict(ends)}, all over after {over_s:.0f} s",
        "all verified",
        ends["verified"] == len(accepted),
    )
    section.add("slowest answer", f"{slowest:.2f} s")
    return section


async def _send(
    address: str, count: int, seconds: float
) -> list[tuple[int, dict[str, Any], str | None, float]]:
    """Return status, body, Retry-After and seconds of each answer."""

    async def one(number: int) -> tuple[int, dict[str, Any], str | None, float]:
        await asyncio.sleep(seconds * number / count)
        start_s = time.perf_counter()
        answer = await http.post(
            "/api/folds",
            data={"seed": str(number)},
            files={"file": ("path.json", json.dumps(SNAKE))},
            headers={"X-Forwarded-For": f"10.2.0.{number % 100 + 1}"},
        )
        taken_s = time.perf_counter() - start_s
        return answer.status_code, answer.json(), answer.headers.get("Retry-After"), taken_s

    limits = httpx.Limits(max_connections=50)
    async with httpx.AsyncClient(base_url=address, timeout=120.0, limits=limits) as http:
        return await asyncio.gather(*(one(k) for k in range(count)))


def _end(service: Service, fold: str) -> dict[str, Any]:
    deadline = time.monotonic() + MAX_FOLD_S
    while (state := service.state(fold))["status"] in ("queued", "running"):
        if time.monotonic() > deadline:
            return {"status": f"still {state['status']}"}
        time.sleep(0.2)
    return state
