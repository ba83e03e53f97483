"""Views through a real service, and through ``foldback play``: sockets, headers, refusals."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
import viser
from websockets import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from tests.server.service import SNAKE, Service

VISITOR = "a-visitor-in-a-test"
PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("service") / "data", max_viewers=3).start()
    yield service
    assert service.stop() == 0


@pytest.fixture(scope="module")
def fold(service: Service) -> str:
    accepted = service.fold(SNAKE)
    assert service.wait_over(accepted["id"])["status"] == "verified"
    return accepted["id"]


def socket(base: str, path: str, **more: Any) -> ClientConnection:
    return connect(base.replace("http", "ws", 1) + path, compression=None, max_size=None, **more)


def control(base: str, fold: str, visitor: str = VISITOR, **more: Any) -> ClientConnection:
    return socket(base, f"/folds/{fold}/control/{visitor}", **more)


def view(base: str, fold: str, visitor: str = VISITOR, **more: Any) -> ClientConnection:
    return socket(base, f"/folds/{fold}/view/{visitor}", subprotocols=[PROTOCOL], **more)


def told(connection: ClientConnection, kind: str, **values: Any) -> dict[str, Any]:
    """The next message of a kind with these values."""
    while True:
        message = json.loads(connection.recv(timeout=30))
        if message["is"] == kind and all(message.get(k) == v for k, v in values.items()):
            return message


def test_scrubbing_moves_what_viser_sends(service: Service, fold: str) -> None:
    base = str(service.http.base_url)
    with view(base, fold) as scene, control(base, fold) as bar:
        assert scene.subprotocol == PROTOCOL
        assert isinstance(scene.recv(timeout=30), bytes)
        frames = told(bar, "outline")["frames"]
        bar.send(json.dumps({"do": "seek", "frame": frames - 1}))
        assert told(bar, "state", frame=frames - 1)["phase"] == "playback"
        while b"batched_positions" not in _unpacked(scene.recv(timeout=30)):
            pass


def _unpacked(data: str | bytes) -> bytes:
    import zstandard

    assert isinstance(data, bytes)
    size, packed = (int.from_bytes(data[k : k + 8], "little") for k in (0, 8))
    return zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)


def test_of_many_seeks_the_last_counts(service: Service, fold: str) -> None:
    with control(str(service.http.base_url), fold) as bar:
        for frame in (*range(1, 12), 5):
            bar.send(json.dumps({"do": "seek", "frame": frame}))
        bar.send(json.dumps({"do": "set", "loop": True}))
        assert told(bar, "state", loop=True)["frame"] == 5


def test_a_viewer_outlives_its_sockets(service: Service, fold: str) -> None:
    base = str(service.http.base_url)
    with control(base, fold) as bar:
        first = told(bar, "hello")["viewer"]
        bar.send(json.dumps({"do": "seek", "frame": 7}))
        told(bar, "state", frame=7)
    with control(base, fold) as bar:
        assert told(bar, "hello")["viewer"] == first
        assert told(bar, "state")["frame"] == 7


def test_other_messages_than_a_look_needs_are_dropped(service: Service, fold: str) -> None:
    base = str(service.http.base_url)
    with view(base, fold) as scene, control(base, fold) as bar:
        for kind in ("ShareUrlRequest", "FileTransferStartUpload", "GuiUpdateMessage", 7):
            scene.send(msgspec.msgpack.encode({"type": kind}))
        scene.send(b"\xc1 not msgpack")
        scene.send("text")
        bar.send(json.dumps({"do": "seek", "frame": 3}))
        told(bar, "state", frame=3)
        bar.send("[]")
        bar.send("not json")
        bar.send(json.dumps({"do": "nonsense"}))
        assert "nonsense" in told(bar, "problem")["detail"]
        scene.ping().wait(30)


@pytest.mark.parametrize("path", ["control", "view"])
def test_pages_of_other_sites_are_refused(service: Service, fold: str, path: str) -> None:
    base = str(service.http.base_url)
    with (
        pytest.raises((InvalidStatus, ConnectionClosed)),
        socket(
            base, f"/folds/{fold}/{path}/{VISITOR}", origin=Origin("https://elsewhere.example")
        ) as connection,
    ):
        connection.recv(timeout=30)


@pytest.mark.parametrize(
    "path", ["/folds/nosuch/control/" + VISITOR, "/folds/{fold}/control/short"]
)
def test_what_is_not_there_is_refused(service: Service, fold: str, path: str) -> None:
    with socket(str(service.http.base_url), path.format(fold=fold)) as connection:
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=30)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008


def test_too_many_viewers_are_told_to_wait(service: Service, fold: str) -> None:
    base = str(service.http.base_url)
    with (
        control(base, fold, VISITOR),
        control(base, fold, VISITOR + "-2"),
        control(base, fold, VISITOR + "-3"),
    ):
        with control(base, fold, VISITOR + "-4") as late, pytest.raises(ConnectionClosed) as shut:
            late.recv(timeout=30)
        assert shut.value.rcvd is not None
        assert shut.value.rcvd.code == 1013
        assert "try again" in shut.value.rcvd.reason


def test_headers_of_pages_and_of_the_view(service: Service, fold: str) -> None:
    page = service.http.get(f"/folds/{fold}")
    assert "script-src 'self';" in page.headers["content-security-policy"]
    assert page.headers["cache-control"] == "no-store"
    (source,) = re.findall(r'<iframe[^>]* data-src="([^"]+)"', page.text)
    framed = service.http.get(source)
    assert framed.status_code == 200
    assert "connect-src 'self' data: blob:" in framed.headers["content-security-policy"]
    etag = {"If-None-Match": framed.headers["etag"]}
    assert service.http.get(source, headers=etag).status_code == 304
    again = service.http.get(f"/folds/{fold}").text
    assert source not in again  # every load has a playhead of its own


def test_names_of_files_are_not_markup(service: Service) -> None:
    document = {"format": "foldback-path/1", "name": "</script><b>x", "cells": SNAKE}
    answer = service.http.post("/api/folds", files={"file": ("x.json", json.dumps(document))})
    assert answer.status_code == 202
    fold_id = answer.json()["id"]
    service.wait_over(fold_id)
    page = service.http.get(f"/folds/{fold_id}").text
    assert "</script><b>" not in page
    assert "<b>x" not in page


def test_static_files_only_from_their_folder(service: Service) -> None:
    script = service.http.get("/static/fold.js")
    assert script.headers["content-type"].startswith("text/javascript")
    for path in ("/static/../player.py", "/static/%2e%2e%2fplayer.py", "/static/none.js"):
        assert service.http.get(path).status_code == 404


def test_play_shows_a_directory_without_a_service(service: Service, fold: str) -> None:
    directory = service.data_dir / "folds" / fold
    command = [sys.executable, "-P", "-m", "server.command_line", "play", str(directory)]
    with subprocess.Popen([*command, "--no-browser"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"(http://[^/]+)(/\S+)", process.stdout.readline())
        assert address
        page = httpx.get(address[1] + address[2])
        assert page.status_code == 200
        assert "verified" in page.text
        assert "/api/" not in page.text  # there is no service to download from
        with control(address[1], "fold") as bar:
            assert told(bar, "outline")["modules"] == len(SNAKE)
        process.terminate()
        assert process.wait(30) in (0, -15)


def test_play_of_nothing_says_so(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "server.command_line", "play", str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 2
    assert "no timeline" in ended.stderr
