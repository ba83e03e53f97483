"""`foldback play` for directories without a verified plan, and with viser."""

import asyncio
import json
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from foldback.planner.motion.timeline import TimelineWriter
from foldback.server.cli.play import create_player_app, row_of
from foldback.words.failures import failure
from tests.planner.peels import snake
from tests.web.conftest import unfolding

CHAIN = snake((2, 2, 3))
STUCK = {"code": "at-rest", "values": {"steps": 90}}
KNOT = {"kind": "knot", "modules": [5, 6], "words": "its path is knotted", "evidence": None}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Directory of an explosion that was interrupted halfway."""
    with TimelineWriter.create(tmp_path / "timeline", CHAIN) as writer:
        writer.append(unfolding(CHAIN, 6)[:2])
    return tmp_path


def state_of(directory: Path) -> dict[str, Any]:
    row = row_of(directory)
    computed_failure = failure(row, row.summary)
    assert computed_failure is not None
    return computed_failure


def test_directory_without_a_verified_plan_reports_reason_and_location(directory: Path) -> None:
    before = sorted(directory.iterdir())
    computed_state_of = state_of(directory)
    assert (computed_state_of["heading"], computed_state_of["text"]) == (
        "Not finished",
        "The chain was still unfolding.",
    )
    assert len(computed_state_of["modules"]) > 2
    assert sorted(directory.iterdir()) == before
    explosion = {"status": "stalled", "reason": STUCK, "steps": 90, "frames": 2}
    plan = {
        "certificate": {
            "verified": False,
            "reason": STUCK,
        },
        "explosion": explosion,
        "attempts": [{**explosion, "steps": 8}, {**explosion, "diagnosis": KNOT}],
    }
    np.savez(directory / "plan.npz", plan=json.dumps(plan))
    computed_state_of = state_of(directory)
    assert (computed_state_of["heading"], computed_state_of["modules"]) == (
        "The chain is knotted",
        [5, 6],
    )


def test_links_of_the_pages_are_answered(directory: Path) -> None:
    app = create_player_app(directory)

    async def found() -> tuple[dict[str, set[int]], dict[str, Any]]:
        transport = httpx.ASGITransport(app=app)
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as http,
        ):
            statuses: dict[str, set[int]] = {}
            for path in ("/folds/fold", "/folds/other", "/embed/other", "/compare?a=fold&b=other"):
                page = (await http.get(path)).text
                # Links of dialogs that are never opened are invisible and may lead nowhere.
                page_text = re.sub(r"<dialog.*?</dialog>", "", page, flags=re.DOTALL)
                links = set(re.findall(r'(?:href|src)="(/[^"#]*)', page_text))
                statuses[path] = {(await http.get(link)).status_code for link in links}
            return statuses, (await http.get("/folds/fold/facts")).json()

    statuses, facts = asyncio.run(found())
    assert {status for route_statuses in statuses.values() for status in route_statuses} <= {
        200,
        307,
    }
    assert not any(facts[name] for name in ("comparable", "refoldable", "smooth_question"))


@pytest.mark.long
@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_viser_ends_by_signal_although_the_shell_ignores_sigint(
    directory: Path, number: signal.Signals
) -> None:
    command = [sys.executable, "-m", "foldback.server.cli.command_line", "play", str(directory)]
    options = ["--viser", "--no-browser", "--port", "0"]
    # A child inherits an ignored signal: background jobs of a shell and of some CI systems do so.
    ignoring = ["sh", "-c", "trap '' INT; exec \"$@\"", "sh"]
    with subprocess.Popen(
        [*ignoring, *command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as playing:
        try:
            line = playing.stdout.readline()
            assert line.startswith("snake is at http://127.0.0.1:")
            address = next(word for word in line.split() if "http" in word)
            with urllib.request.urlopen(address, timeout=30) as page:
                assert b"viser" in page.read().lower()
            playing.send_signal(number)
            output_rest, complaints = playing.communicate(timeout=30)
        finally:
            playing.kill()
    assert (playing.returncode, output_rest, complaints) == (0, "", "")
