"""Networks: the visitor that an address belongs to, and the networks around it.

A visitor's name lists its networks from the widest to the narrowest and ends with the visitor
itself, separated by ``|``: ``2001:db8:1::/48|2001:db8:1::/56|2001:db8:1:2::/64`` or
``203.0.113.0/24|203.0.113.7``. Every prefix that ends before a ``|`` names a network, so a table
with a column of visitors needs no column of networks.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
from typing import Final

PSEUDONYM_SEPARATOR: Final = "|"
IPV6_BITS: Final = (48, 56, 64)
"""Prefix lengths, in bits, of the IPv6 addresses that count as one site, one home network and one
visitor. Providers assign a home a /56 or a /48 (RIPE-690), of which it may use every /64."""
IPV4_BITS: Final = (24, 32)
"""Prefix lengths, in bits, of the IPv4 addresses that count as one network and one visitor. /24 is
the longest prefix that is routed on the internet."""
TRANSLATED: Final = ipaddress.IPv6Network("64:ff9b::/96")
"""IPv6 network into which translators map IPv4 addresses (RFC 6052)."""


def visitor_at(host: str) -> str:
    """Return the name of the visitor at an IP address; other names are returned as they are."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host.replace(PSEUDONYM_SEPARATOR, "")
    if isinstance(address, ipaddress.IPv6Address):
        address = _embedded(address) or address
    bits = IPV4_BITS if isinstance(address, ipaddress.IPv4Address) else IPV6_BITS
    networks = [ipaddress.ip_network((address, length), strict=False) for length in bits]
    return PSEUDONYM_SEPARATOR.join(str(network).removesuffix("/32") for network in networks)


def _embedded(address: ipaddress.IPv6Address) -> ipaddress.IPv4Address | None:
    """Return the IPv4 address that an IPv6 address contains; None for others.

    A translator maps all IPv4 visitors into one /64, and 6to4 gives each IPv4 address a whole /48.
    Counted as IPv6, the former would be one visitor, and each of the latter could be many.
    """
    if address in TRANSLATED:
        return ipaddress.IPv4Address(int(address) & 0xFFFF_FFFF)
    return address.ipv4_mapped or address.sixtofour


def networks_of(visitor: str) -> tuple[str, ...]:
    """Return the names of the networks around a visitor, widest first; empty if unknown."""
    parts = visitor.split(PSEUDONYM_SEPARATOR)
    return tuple(PSEUDONYM_SEPARATOR.join(parts[: k + 1]) for k in range(len(parts) - 1))


def hidden(visitor: str, secret: bytes) -> str:
    """Return a pseudonym of the same form that does not reveal the addresses."""

    def digest(name: str, digits: int) -> str:
        return hmac.new(secret, name.encode(), hashlib.sha256).hexdigest()[:digits]

    networks = [digest(name, 12) for name in networks_of(visitor)]
    # 58 of the 64 characters of the column, with the digits of two networks
    own_digest = digest(visitor.rpartition(PSEUDONYM_SEPARATOR)[2], 32)
    return PSEUDONYM_SEPARATOR.join((*networks, own_digest))
