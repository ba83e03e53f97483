"""Relay between a client and a service, which causes failures on request."""

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import httpx

Trouble = Callable[[str, str, int], "int | str | None"]
"""Method, path and count of such requests; returns a status, ``lose``, ``cut`` or None."""
HOP_BY_HOP = {"connection", "host", "transfer-encoding", "content-length", "accept-encoding"}


class Relay:
    """Server that forwards requests and causes the failures that ``trouble`` returns."""

    def __init__(self, upstream: str, trouble: Trouble, retry_after: str = "0") -> None:
        self.requests: list[tuple[str, str]] = []
        relay = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do(self) -> None:
                path = self.path.partition("?")[0]
                relay.requests.append((self.command, path))
                failure = trouble(self.command, path, relay.requests.count((self.command, path)))
                body = self.rfile.read(int(self.headers.get("content-length") or 0))
                self.close_connection = True
                if isinstance(failure, int):
                    self.send_response(failure)
                    self.send_header("Retry-After", retry_after)
                    self.end_headers()
                    return
                headers = {k: v for k, v in self.headers.items() if k.lower() not in HOP_BY_HOP}
                with httpx.stream(
                    self.command, upstream + self.path, headers=headers, content=body, timeout=60
                ) as answer:
                    if failure == "lose":
                        self.connection.shutdown(socket.SHUT_RDWR)
                        return
                    self.send_response(answer.status_code)
                    for name, value in answer.headers.items():
                        if name not in HOP_BY_HOP - {"content-length"}:
                            self.send_header(name, value)
                    self.end_headers()
                    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                        for piece in answer.iter_bytes():
                            self.wfile.write(piece[:100] if failure == "cut" else piece)
                            self.wfile.flush()
                            if failure == "cut":
                                return

            do_GET = do_POST = do_DELETE = do

            def log_message(self, format: str, *args: object) -> None:
                del format, args

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def stop(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@contextlib.contextmanager
def running_relay(upstream: object, trouble: Trouble, retry_after: str = "0") -> Iterator[Relay]:
    """Run a relay in front of a service for the duration of the context."""
    relay = Relay(str(upstream).rstrip("/"), trouble, retry_after)
    try:
        yield relay
    finally:
        relay.stop()
