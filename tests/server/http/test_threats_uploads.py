"""Attacks by uploads: too large, too slow, too many at once, and false sizes."""

import io
import json
import socket
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from http.client import HTTPResponse, RemoteDisconnected
from itertools import product
from pathlib import Path
from unittest.mock import patch
from zlib import compress

import httpx
import numpy as np
import psutil
import pytest

from foldback.server.files.uploads import Uploads
from foldback.server.jobs import housekeeping
from foldback.server.settings import Settings
from tests.case import case
from tests.planner.silhouettes.pictures import png_header
from tests.server.service_process import SNAKE, TIMEOUT_S, Service, check_problem, owner, wait_until
from tests.server.service_thread import ServiceThread, ServiceWith

MIB = 2**20
HEAD = (
    b"POST %b HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: %b\r\n"
    b"Content-Type: multipart/form-data; boundary=x\r\n%b\r\n\r\n"
)
PART = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.bin"\r\n\r\n'
END = b"\r\n--x--\r\n"
FORM = "application/x-www-form-urlencoded"


@contextmanager
def connect_to(service: Service) -> Iterator[socket.socket]:
    url = service.http.base_url
    with socket.create_connection((url.host, url.port or 80), timeout=TIMEOUT_S) as client:
        yield client


def answer_of(client: socket.socket) -> tuple[int, str | None]:
    """Return the status of an answer and the code of its problem; 0 without an answer."""
    response = HTTPResponse(client)
    try:
        response.begin()
    except RemoteDisconnected:
        return 0, None
    problem = response.headers["Content-Type"] == "application/problem+json"
    return response.status, json.load(response)["code"] if problem else None


def head(visitor: str, extra: bytes, path: bytes = b"/api/folds") -> bytes:
    return HEAD % (path, visitor.encode(), extra)


def length(size: int) -> bytes:
    return b"Content-Length: %d" % (len(PART) + size + len(END))


@pytest.mark.slow
def test_twenty_large_uploads_at_once_fit_into_little_memory(service: Service) -> None:
    web = psutil.Process(service.process.pid)
    service.http.post("/api/folds", files={"file": ("a.bin", b"\x89PNG" * MIB)})
    before = maximum = _settled_memory(web)
    piece, size = b"\x89PNG" * (MIB // 4), 5
    with ExitStack() as stack:
        clients = [stack.enter_context(connect_to(service)) for _ in range(20)]
        for k, client in enumerate(clients):
            client.sendall(head(f"203.0.113.{k}", length(size * MIB)) + PART)
        for _ in range(size):
            for client in clients:
                client.sendall(piece)
            maximum = max(maximum, web.memory_info().rss)
        assert sum(1 for _ in service.data_dir.glob("uploads/*/")) == 1
        for client in clients[:3]:  # read, counted, copied, and refused by the reader
            client.sendall(END)
            assert answer_of(client) == (422, "wrong-kind")
            maximum = max(maximum, web.memory_info().rss)
    assert maximum - before < 64 * MIB, f"grew by {(maximum - before) / MIB:.0f} MiB"


def test_uploads_at_once_are_limited_for_a_visitor_and_for_all(service_with: ServiceWith) -> None:
    service = service_with(max_uploads=2, max_uploads_of_visitor=1).start()

    def answer_to(visitor: str) -> httpx.Response:
        headers = {"X-Forwarded-For": visitor}
        return service.http.post("/api/folds", data={"shape": "mallet-64"}, headers=headers)

    with ExitStack() as stack:
        for visitor in ("203.0.113.1", "2001:db8::1"):
            client = stack.enter_context(connect_to(service))
            # The head is accepted; a client that expects 100-continue gets it once it may upload.
            client.sendall(head(visitor, length(10) + b"\r\nExpect: 100-continue"))
            assert client.recv(65536).startswith(b"HTTP/1.1 100 ")
            client.sendall(PART)
        for visitor, whose in (("2001:db8:0:0:1:2:3:4", "of yours"), ("198.51.100.3", "in all")):
            assert whose in check_problem(answer_to(visitor), 429, "too-many-uploads", retry=True)
    wait_until(lambda: answer_to("203.0.113.1").status_code == 202)


def _settled_memory(process: psutil.Process) -> int:
    """Return the memory of a service after the imports that follow its start."""
    rss, quiet = process.memory_info().rss, 0
    while quiet < 30:
        time.sleep(0.1)
        now = process.memory_info().rss
        rss, quiet = (now, 0) if now > rss + MIB else (rss, quiet + 1)
    return rss


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """Service with short timeouts."""
    settings = dict.fromkeys(("upload_idle_s", "header_seconds", "unread_seconds"), 0.5)
    visitors = {"max_connections_of_visitor": 8, "trusted_proxies": "192.0.2.0/24"}
    service = ServiceThread(tmp_path_factory.mktemp("hasty") / "data", **settings, **visitors)
    with patch("foldback.server.http.upload_limits.MAX_DRAIN_S", 0.5), service.start():
        yield service


def test_stalled_upload_times_out(hasty: Service) -> None:
    with connect_to(hasty) as client:
        client.sendall(head("x", b"Content-Length: 1000") + PART)
        assert answer_of(client) == (408, "too-slow")


def test_slow_upload_times_out(service_with: ServiceWith) -> None:
    service = service_with(upload_seconds=0.5).start()
    with connect_to(service) as client:
        client.sendall(head("x", b"Content-Length: 100000") + PART)
        client.settimeout(0.1)
        answer = None
        while answer is None:
            client.sendall(b"[")
            with suppress(TimeoutError):
                answer = answer_of(client)
    assert answer == (408, "too-slow")


def test_connection_without_a_whole_request_is_closed(hasty: Service) -> None:
    for start in (b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "):
        with connect_to(hasty) as client, suppress(ConnectionResetError):
            client.sendall(start)
            assert client.recv(1) == b""


def test_endless_head_is_refused(hasty: Service) -> None:
    for data in (
        b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 60_000,
        b"GET /" + b"y" * 60_000,
        b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"A: b\r\n" * 200 + b"\r\n",
    ):
        with connect_to(hasty) as client:
            client.sendall(data)
            assert answer_of(client)[0] == 400


def test_client_that_does_not_read_is_disconnected(hasty: Service) -> None:
    url = hasty.http.base_url
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.settimeout(TIMEOUT_S)
        client.connect((url.host, url.port or 80))
        # Send requests without reading answers until the buffers are full.
        ask = b"GET /view HTTP/1.1\r\nHost: localhost\r\n\r\n" * 50
        with pytest.raises(ConnectionError):
            for _ in range(1000):
                client.sendall(ask)
                time.sleep(0.1)


def test_connections_of_one_address_are_limited(hasty: Service) -> None:
    with ExitStack() as stack:
        clients = [stack.enter_context(connect_to(hasty)) for _ in range(16)]
        assert sum(status_of(client, b"/api/shapes") == 200 for client in clients) <= 8
    wait_until(lambda: hasty.http.get("/health").status_code == 200)


def test_health_is_answered_while_all_connections_are_taken(service_with: ServiceWith) -> None:
    service = service_with(max_connections=3).start()
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(connect_to(service))
        for path, status in ((b"/health", 200), (b"/api/shapes", 503)):
            assert status_of(stack.enter_context(connect_to(service)), path) == status


def test_tiny_chunks_are_read_at_a_rate(service_with: ServiceWith) -> None:
    service = service_with(requests_per_second_of_visitor=1).start()
    with connect_to(service) as client:
        client.sendall(
            b"POST /api/folds HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 203.0.113.1\r\n"
            b"Content-Type: %b\r\nTransfer-Encoding: chunked\r\n\r\n6\r\nshape=\r\n"
            % FORM.encode()
            + b"1\r\na\r\n" * 20_000
            + b"0\r\n\r\n"
        )
        for k in range(8):
            forwarded_header = {"X-Forwarded-For": f"10.{k}.0.1"}
            assert service.http.get("/api/shapes", headers=forwarded_header).status_code == 200
        client.setblocking(False)
        with pytest.raises(BlockingIOError):  # no answer until the whole upload is read
            client.recv(1)


def test_trailer_fields_are_read_at_a_rate(service_with: ServiceWith) -> None:
    service = service_with(requests_per_second_of_visitor=1).start()
    head = b"POST /nowhere HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 203.0.113.1\r\n"
    trailer = b"0\r\n" + b"a:b\r\n" * 5000 + b"\r\n"
    answers = b""
    with connect_to(service) as client:
        client.sendall(head + b"Transfer-Encoding: chunked\r\n\r\n" + trailer)
        client.sendall(head + b"Content-Length: 0\r\n\r\n")
        client.settimeout(60.0)
        while b"HTTP/1.1" not in answers and (piece := client.recv(4096)):
            answers += piece
        client.settimeout(0.5)
        with pytest.raises(TimeoutError):
            while piece := client.recv(4096):
                answers += piece
    assert answers.count(b"HTTP/1.1") == 1  # the rate limit stops reading for seconds


def status_of(client: socket.socket, path: bytes) -> int:
    """Return the status of a request, 0 if the connection is closed."""
    try:
        client.sendall(b"GET %b HTTP/1.1\r\nHost: localhost\r\n\r\n" % path)
        return answer_of(client)[0]
    except ConnectionError:
        return 0


def test_false_lengths_are_refused(hasty: Service) -> None:
    for length, body in (
        (b"Content-Length: 999999999999", PART + b"[[0,0,0]]" + END),
        (b"Content-Length: 18446744073709551617", PART),
        (b"Content-Length: 30", PART + b"[" * 1000 + END),
        (b"Content-Length: -1", PART),
        (b"Content-Length: 10\r\nContent-Length: 20", PART),
        (b"Transfer-Encoding: chunked", b"fffffffffffffffff\r\nabc"),
        (b"Transfer-Encoding: chunked\r\nContent-Length: 5", b"0\r\n\r\nGET /health"),
        (b"Transfer-Encoding: chunked", b"5\r\n--x\r\n\r\n0\r\n\r\n"),
    ):
        with case(length), connect_to(hasty) as client:
            client.sendall(head("x", length) + body)
            status = answer_of(client)[0]
            assert status == 0 or 400 <= status < 500 or status == 507
    assert hasty.http.get("/health").status_code == 200


def test_forms_have_few_and_small_parts(idle: Service) -> None:
    field = b'--x\r\nContent-Disposition: form-data; name="'
    for kind, form in {
        "files": (field + b'f"; filename="a"\r\n\r\n1\r\n') * 100 + b"--x--\r\n",
        "fields": (field + b'seed"\r\n\r\n1\r\n') * 200 + b"--x--\r\n",
        "long field": field + b'shape"\r\n\r\n' + b"a" * 100_000 + END,
        "long header": field + b'file"; x="' + b"a" * 100_000 + b'"\r\n',
        "many headers": b"--x\r\n" + b"A: b\r\n" * 10_000,
    }.items():
        headers = {"Content-Type": "multipart/form-data; boundary=x"}
        answer = idle.http.post("/api/folds", content=form, headers=headers)
        assert 400 <= answer.status_code < 500, (kind, answer.text)
        assert answer.headers["content-type"] == "application/problem+json"


def test_requests_without_a_file_are_small(idle: Service) -> None:
    data = b"shape=" + b"a" * 180_000
    paths = ("/api/folds", "/api/folds/nosuch/movies", "/api/shapes/preview", "/api/shapes/offers")
    for kind, path in product(("application/json", FORM, ""), paths):
        answer = idle.http.post(path, content=data, headers={"Content-Type": kind})
        assert 400 <= answer.status_code < 500, answer.text
    with connect_to(idle) as client:  # refused even if it arrives slowly
        about = b"Content-Type: %s\r\nContent-Length: %d\r\n\r\n" % (FORM.encode(), len(data))
        client.sendall(b"POST /api/folds HTTP/1.1\r\nHost: localhost\r\n" + about)
        for start in range(0, len(data), 20_000):
            client.sendall(data[start : start + 20_000])
            time.sleep(0.02)
        assert answer_of(client) == (413, "too-large")


def bomb(name: str, inside: bytes = b"") -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr(name, inside or bytes(80 * MIB))
    return file.getvalue()


def npz_bomb() -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, joint_angles_rad=np.zeros(9 * MIB))
    return file.getvalue()


HOSTILE: dict[str, Callable[[], bytes]] = {
    "bomb.3mf": lambda: bomb("3D/3dmodel.model"),
    "bomb.npz": npz_bomb,
    "laughs.3mf": lambda: bomb(
        "3D/3dmodel.model",
        b'<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa">'
        + b"".join(b'<!ENTITY %c "%b">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(9))
        + b"]><model>&j;</model>",
    ),
    "foreign.3mf": lambda: bomb(
        "3D/3dmodel.model",
        b'<!DOCTYPE m [<!ENTITY a SYSTEM "file:///etc/passwd">]><model>&a;</model>',
    ),
    "deep.json": lambda: b"[" * 100_000 + b"]" * 90_000,
    "bomb.png": lambda: png_header(50_000, 50_000, compress(bytes(50_000_000))),
    "script.svg": lambda: b'<svg xmlns="http://www.w3.org/2000/svg"><script>1</script></svg>',
    "foreign.svg": lambda: (
        b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">'
        b'<image href="/etc/passwd" width="9" height="9"/></svg>'
    ),
    "path.obj": lambda: b"v 0 0 0\nmtllib /etc/passwd\nf 1/1/1 99999999999999999999 -5\n",
}
"""Files by their names; tests/planner/shapes has others of all kinds."""


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused(idle: Service, name: str) -> None:
    data = HOSTILE[name]()
    assert len(data) < 250_000, len(data)
    answer = idle.http.post("/api/folds", files={"file": (name, data)})
    check_problem(answer, 422, answer.json()["code"])
    assert "passwd" not in answer.text and "root:" not in answer.text
    assert answer.json()["code"] not in ("internal", "crashed"), answer.text


def test_uploads_of_other_processes_are_left_alone(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with closing(Uploads(settings)) as first:
        with first.stored(io.BytesIO(b"abc"), "a") as upload:
            dead, outside = settings.uploads_dir / "1-dead", tmp_path / "outside"
            for place in (dead, outside):
                place.mkdir()
            (dead / "input").write_text("never acknowledged")
            (settings.uploads_dir / "old").write_text("from a version before")
            (settings.uploads_dir / "link").symlink_to(outside)
            with closing(Uploads(settings)) as second:
                assert upload.directory.is_dir() and outside.is_dir()
                names = {path.name for path in settings.uploads_dir.iterdir()}
                assert names == {first._place.name, second._place.name}
        assert not upload.directory.exists()
    assert not list(settings.uploads_dir.iterdir())


def test_broken_off_upload_leaves_no_files(hasty: Service) -> None:
    with connect_to(hasty) as client:
        client.sendall(head("x", length(8 * MIB)) + PART + bytes(4 * MIB))
    wait_until(lambda: hasty.fold(SNAKE)["id"] is not None)
    wait_until(lambda: [p.name for p in hasty.data_dir.glob("uploads/*/*")] == [])


def test_uploads_cancelled_at_once_fill_no_disk(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    """tests/server/jobs/test_housekeeping.py checks the number of remaining folds."""
    monkeypatch.setattr(housekeeping, "MAX_CANCELLED_BYTES", 2**19)
    service = service_with().start()
    for _ in range(3):
        data = json.dumps(SNAKE).encode() + 2**18 * b" "
        fold = service.http.post("/api/folds", files={"file": ("a.json", data)}).json()
        answer = service.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))
        assert answer.json()["status"] == "cancelled"
    # The last one remains, with those that fit into 512 KiB beside it.
    assert len(list(service.directory(".").rglob("input"))) == 2
