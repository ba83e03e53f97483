"""Loopback: load goes to this machine alone, to services that are there for nothing else."""

from __future__ import annotations

import ipaddress
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from tests.server.service import Service


class NotHereError(ValueError):
    """An address is not this machine's own."""


def checked(address: str) -> str:
    """The address of a service, when it is on this machine.

    Raises:
        NotHereError: When it is anywhere else.
    """
    host = urlsplit(address).hostname or ""
    try:
        found = {info[4][0] for info in socket.getaddrinfo(host, None)}
    except OSError:
        found = set[str]()
    if not found or not all(ipaddress.ip_address(ip).is_loopback for ip in found):
        raise NotHereError(
            f"got {address!r}, expected a service on 127.0.0.1; load is never sent elsewhere."
        )
    return address


@contextmanager
def serving(**settings: object) -> Iterator[Service]:
    """A service with these settings, whose data is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="foldback-load-") as folder:
        service = Service(Path(folder) / "data", prewarm=True, **settings).start()
        try:
            checked(str(service.http.base_url))
            yield service
        finally:
            service.stop()
