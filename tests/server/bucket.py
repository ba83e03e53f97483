"""S3-compatible server for tests, moto's, in a separate process on a free port."""

import signal
import subprocess
import sys
import uuid
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import httpx

from tests.server.postgres import free_port
from tests.server.service_process import wait_until

TIMEOUT_S = 60.0
REGION = "us-east-1"


class Bucket:
    """S3 server; ``bucket`` creates an empty bucket.

    It holds everything in memory, so that all data are lost when the process ends. ``silent`` is an
    outage without data loss.

    Args:
        log: Path of its log; None discards the output.
    """

    def __init__(self, log: Path | None = None) -> None:
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None
        self.port = 0

    @property
    def endpoint(self) -> str:
        """Address of the server."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables with which a program reaches the server."""
        return {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": REGION,
            "AWS_ALLOW_HTTP": "true",
        }

    def start(self) -> "Bucket":
        """Start the server, on its earlier port if it had one."""
        self.port = self.port or free_port()
        with open(self._log or "/dev/null", "ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "moto.server", "-H", "127.0.0.1"]
                + ["-p", str(self.port)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        wait_until(self._answers, errors=(httpx.TransportError,))
        return self

    def _answers(self) -> bool:
        assert self._process.poll() is None, "the server of buckets has ended"
        return bool(httpx.get(f"{self.endpoint}/moto-api/", timeout=TIMEOUT_S))

    def bucket(self) -> str:
        """Create an empty bucket and return its URL."""
        name = f"test-{uuid.uuid4().hex[:12]}"
        httpx.put(f"{self.endpoint}/{name}", timeout=TIMEOUT_S).raise_for_status()
        return f"s3://{name}"

    @contextmanager
    def silent(self) -> Generator[None]:
        """Suspend the server, which then accepts connections but does not answer."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """Stop the server."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            self._process.wait(TIMEOUT_S)
        self._process = None
