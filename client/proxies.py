"""Proxies of the environment, such as ``HTTP_PROXY``: which one leads to a service."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass


def is_loopback(url: str) -> bool:
    """Return True if an address is on this machine, where no proxy can reach it."""
    host = urlsplit(url).hostname or ""
    if host == "localhost" or host.endswith(".localhost"):
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def proxy_of(url: str) -> str | None:
    """Return the variable that names the proxy for an address; None if there is no proxy."""
    parts = urlsplit(url)
    if is_loopback(url) or proxy_bypass(parts.hostname or ""):
        return None
    proxies = getproxies()
    name = parts.scheme if parts.scheme in proxies else "all"
    return _shown(name, proxies[name]) if name in proxies else None


def environment_proxies() -> str:
    """Return all variables that name proxies, without passwords."""
    return ", ".join(_shown(name, proxy) for name, proxy in getproxies().items() if name != "no")


def _shown(name: str, proxy: str) -> str:
    scheme, separator, place = proxy.rpartition("://")
    return f"{name.upper()}_PROXY={scheme}{separator}{place.rpartition('@')[2]}"
