"""Caddy with deploy/Caddyfile and a certificate of its own, for tests."""

import os
import socket
import ssl
import subprocess
from pathlib import Path

import httpx

from tests.server.service_process import TIMEOUT_S, wait_until
from tests.tools import CADDY

CADDYFILE = Path(__file__).parents[2] / "deploy" / "Caddyfile"


def free_ports(count: int) -> list[int]:
    servers = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [listener.getsockname()[1] for listener in servers]
    for listener in servers:
        listener.close()
    return ports


class Proxy:
    """Caddy in front of web processes; ``http`` is a client of it."""

    def __init__(self, place: Path, *upstreams: object, max_body: str) -> None:
        self.log = place / "caddy.log"
        self.port, self.plain_port, health = free_ports(3)
        addresses = " ".join(
            str(upstream).removeprefix("http://").rstrip("/") for upstream in upstreams
        )
        environment = {
            "PATH": os.environ["PATH"],
            "HOME": str(place),
            "XDG_DATA_HOME": str(place),
            "XDG_CONFIG_HOME": str(place),
            "SITE": "localhost",
            "HTTPS_PORT": str(self.port),
            "HTTP_PORT": str(self.plain_port),
            "HEALTH_PORT": str(health),
            "UPSTREAMS": f"to {addresses}",
            "MAX_BODY": max_body,
        }
        command = [CADDY.get(), "run", "--config", str(CADDYFILE), "--adapter", "caddyfile"]
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(command, env=environment, stderr=log, stdout=log)
        address = f"http://127.0.0.1:{health}/"
        wait_until(
            lambda: httpx.get(address).is_success, self.log.read_text, (httpx.TransportError,)
        )
        root = place / "caddy" / "pki" / "authorities" / "local" / "root.crt"
        self.tls = ssl.create_default_context(cafile=str(root))
        self.address = f"https://localhost:{self.port}"
        self.http = self.client()

    def client(self, comes_from: str | None = None) -> httpx.Client:
        """Return a client that connects from another address of this machine, if one is given."""
        transport = httpx.HTTPTransport(verify=self.tls, local_address=comes_from)
        return httpx.Client(base_url=self.address, transport=transport, timeout=60)

    def raw(self, target: str) -> bytes:
        """Return the answer to a target that no HTTP client would send unchanged."""
        with (
            socket.create_connection(("127.0.0.1", self.port), timeout=60) as plain,
            self.tls.wrap_socket(plain, server_hostname="localhost") as tls,
        ):
            host = f"localhost:{self.port}"
            tls.sendall(
                f"GET {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode()
            )
            return b"".join(iter(lambda: tls.recv(65536), b""))

    def send_and_disconnect(self, data: bytes) -> None:
        """Send the beginning of a request and disconnect."""
        with (
            socket.create_connection(("127.0.0.1", self.port), timeout=60) as plain,
            self.tls.wrap_socket(plain, server_hostname="localhost") as tls,
        ):
            tls.sendall(data)

    def stop(self) -> None:
        self.http.close()
        self.process.terminate()
        self.process.wait(TIMEOUT_S)
