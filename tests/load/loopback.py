"""Loopback: load goes to this machine alone."""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit


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
