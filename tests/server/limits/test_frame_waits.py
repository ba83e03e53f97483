"""Frame waits: one check of a timeline serves all requests that wait for it."""

import asyncio
from pathlib import Path

import pytest

from foldback.planner.motion.timeline import TimelineWriter
from foldback.server.viewing.frame_waits import FrameWaits
from foldback.web.timeline.view import TimelineView
from tests.planner.chains import chain_of
from tests.server.service_process import SNAKE
from tests.web.conftest import unfolding

WAITS = 60


def test_one_look_serves_all_waiting_requests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[TimelineView] = []
    refresh = TimelineView.refresh

    def counted(self: TimelineView, **options: bool) -> bool:
        looks.append(self)
        return refresh(self, **options)

    monkeypatch.setattr(TimelineView, "refresh", counted)
    chain = chain_of(SNAKE)
    motion = unfolding(chain, 6)
    with TimelineWriter.create(tmp_path / "timeline", chain) as writer:
        writer.append(motion[:3])
        writer.flush()
        timeline = TimelineView(tmp_path / "timeline")
        writer.append(motion[3:])
        writer.flush()

        async def wait_together() -> None:
            waits = FrameWaits()
            await asyncio.gather(
                *(waits.until(timeline, 5, asyncio.Event(), timeout_s=60.0) for _ in range(WAITS))
            )
            waits.close()

        asyncio.run(wait_together())
    assert len(timeline) == 6
    assert 0 < len(looks) < WAITS
