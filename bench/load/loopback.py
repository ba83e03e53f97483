"""Loopback: load is sent only to this machine, to services started for the test."""

from __future__ import annotations

import ipaddress
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from tests.server.service_process import Service


class NotHereError(ValueError):
    """Error raised if an address is not on this machine."""


def checked(address: str) -> str:
    """Return the address of a service if it is on this machine.

    Raises:
        NotHereError: If it is on another machine.
    """
    host = urlsplit(address).hostname or ""
    try:
        getaddrinfo = {info[4][0] for info in socket.getaddrinfo(host, None)}
    except OSError:
        getaddrinfo = set[str]()
    if not getaddrinfo or not all(ipaddress.ip_address(ip).is_loopback for ip in getaddrinfo):
        raise NotHereError(
            f"got {address!r}, expected a service on 127.0.0.1; load is never sent elsewhere."
        )
    return address


@contextmanager
def serving(**settings: object) -> Iterator[Service]:
    """Run a service with these settings; delete its data afterwards."""
    with tempfile.TemporaryDirectory(prefix="foldback-load-") as folder:
        service = Service(Path(folder) / "data", prewarm=True, **settings).start()
        try:
            checked(str(service.http.base_url))
            yield service
        finally:
            service.stop()
