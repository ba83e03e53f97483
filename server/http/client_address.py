"""Addresses: where a visitor comes from, as far as bounds on visitors need to know."""

from __future__ import annotations

import ipaddress
from typing import Final

from starlette.requests import HTTPConnection

NETWORK_BITS: Final = 64
"""Leading bits of an IPv6 address that are one visitor's network."""


def address_of(connection: HTTPConnection) -> str:
    """The address that a request comes from; one for all that a single visitor may use."""
    return visitor_at(connection.client.host if connection.client else "unknown")


def visitor_at(host: str) -> str:
    """One address for all that a single visitor may use."""
    try:
        found = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, NETWORK_BITS), strict=False))
