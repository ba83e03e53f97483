"""Classes: one hundred followers of one leader, while another visitor loads pages."""

from __future__ import annotations

import asyncio
import json
import time

import httpx
from websockets.asyncio.client import ClientConnection, connect

from bench.load.loopback import serving
from bench.load.visitors import percentile_ms
from bench.sections import Section

FOLLOWERS = 100
"""Number of browsers that follow one class: the service sends each change of its leader's camera or
frame to all of them. A larger value loads the service more; it permits 100."""
LED_S = 60.0
"""Time for which the class's leader sends changes of camera and frame, in s, while the delays are
measured."""
VIEWS_PER_SECOND = 10
"""Number of changes of camera and frame that the class's leader sends per second, as many as the
page while the picture is dragged. A larger value loads the service more; more than 30 end the
class."""
PAGES_PER_SECOND = 4
"""Number of pages that another visitor loads per second while the class runs, to measure how much
it delays others."""
MAX_VIEW_DELAY_MS = 300
"""Maximum 95th percentile of the time from the leader's change of camera or frame to its arrival at
a follower, in ms; above it the load test fails."""
MAX_PAGE_DURING_CLASS_MS = 100
"""Maximum 95th percentile of the time to load a fold's page for another visitor while the class
runs, in ms; above it the load test fails."""


def classes(short: bool = False) -> Section:
    """Measure the delay of views, and meanwhile the times of another visitor's pages."""
    section = Section(name="classes")
    followers, seconds = (5, 1.0) if short else (FOLLOWERS, LED_S)
    with serving(workers=1) as service:
        fold = service.fold(shape="wrench-24" if short else "wrench-160")["id"]
        assert service.wait_over(fold)["status"] == "verified"
        delays, pages = asyncio.run(_led(str(service.http.base_url), fold, followers, seconds))
    delay, page = percentile_ms(delays, 95), percentile_ms(pages, 95)
    received_share = len(delays) / (followers * seconds * VIEWS_PER_SECOND)
    section.rows.append(
        {
            "followers": followers,
            "views of all that were sent": round(received_share, 3),
            "delay p50, ms": percentile_ms(delays, 50),
            "delay p95, ms": delay,
            "delay max, ms": 1000 * max(delays),
            "page p50, ms": percentile_ms(pages, 50),
            "page p95, ms": page,
        }
    )
    judged = not short
    section.add(
        f"{followers} followers: delay of a view, p95",
        f"{delay:.0f} ms",
        f"≤ {MAX_VIEW_DELAY_MS} ms",
        delay <= MAX_VIEW_DELAY_MS if judged else None,
    )
    section.add(
        "a fold's page of others meanwhile, p95",
        f"{page:.0f} ms",
        f"≤ {MAX_PAGE_DURING_CLASS_MS} ms",
        page <= MAX_PAGE_DURING_CLASS_MS if judged else None,
    )
    section.add("part of the views that arrived", f"{received_share:.3f}")
    return section


async def _led(
    address: str, fold: str, followers: int, seconds: float
) -> tuple[list[float], list[float]]:
    """Return the delays of views and the times of pages, in s."""
    socket = address.replace("http", "ws", 1).rstrip("/")
    delays: list[float] = []
    sent: dict[str, float] = {}
    async with connect(f"{socket}/api/class/lead?fold={fold}") as leader:
        code = json.loads(await leader.recv())["link"].rpartition("/")[2]
        follow_address = f"{socket}/api/class/follow?code={code}"
        all_ = [await connect(follow_address) for _ in range(followers)]
        works = [asyncio.create_task(_listen(follower, sent, delays)) for follower in all_]
        works.append(asyncio.create_task(_read_counts(leader)))
        looking = asyncio.create_task(_look(address, fold, seconds))
        start_s = time.monotonic()
        for k in range(round(seconds * VIEWS_PER_SECOND)):
            view = f"frame={k + 1}&module={k % 9 + 1}&camera={k % 180}.5,24,1.2&colour=speed"
            sent[view] = time.monotonic()
            await leader.send(view)
            await asyncio.sleep(start_s + (k + 1) / VIEWS_PER_SECOND - time.monotonic())
        pages = await looking
        await asyncio.sleep(1)
    await asyncio.gather(*works, return_exceptions=True)
    return delays, pages


async def _listen(follower: ClientConnection, sent: dict[str, float], delays: list[float]) -> None:
    async for view in follower:
        if view in sent:
            delays.append(time.monotonic() - sent[str(view)])


async def _read_counts(leader: ClientConnection) -> None:
    async for _ in leader:
        pass


async def _look(address: str, fold: str, seconds: float) -> list[float]:
    """Load the page of the fold repeatedly from another address; return the times, s."""
    gaps = []
    headers = {"X-Forwarded-For": "10.9.8.7"}
    async with httpx.AsyncClient(base_url=address, headers=headers) as http:
        end = time.monotonic() + seconds
        while (start_s := time.monotonic()) < end:
            (await http.get(f"/folds/{fold}")).raise_for_status()
            gaps.append(time.monotonic() - start_s)
            await asyncio.sleep(max(0.0, 1 / PAGES_PER_SECOND - gaps[-1]))
    return gaps
