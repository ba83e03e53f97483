"""The context of a service: what it opened is closed again, also if it cannot be opened wholly."""

import threading
from pathlib import Path

import pytest

from foldback.server import context
from foldback.server.context import Context
from foldback.server.ops.metrics import Metrics
from foldback.server.settings import Settings
from foldback.server.store.previews import SWEEPING_THREAD
from tests.server.service_process import wait_until


def test_resources_are_closed_if_a_later_one_cannot_be_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise OSError("no gallery")

    before = set(threading.enumerate())
    sweeping: list[threading.Thread] = []
    start_sweeping = context.Previews.start_sweeping

    def note(previews: context.Previews) -> None:
        start_sweeping(previews)
        started = set(threading.enumerate()) - before
        sweeping.extend(thread for thread in started if thread.name == SWEEPING_THREAD)

    monkeypatch.setattr(context.Previews, "start_sweeping", note)
    monkeypatch.setattr(context, "Gallery", fail)
    with pytest.raises(OSError, match="no gallery"):
        Context.open(Settings(data_dir=tmp_path, prewarm=False), Metrics())
    (thread,) = sweeping
    wait_until(lambda: not thread.is_alive())
    assert not list((tmp_path / "uploads").glob("*"))
