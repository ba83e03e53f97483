"""Client address: the visitor that a request counts for in limits per visitor."""

from __future__ import annotations

from starlette.requests import HTTPConnection

from foldback.server.limits.networks import visitor_at


def address_of(connection: HTTPConnection) -> str:
    """Return the name of a request's visitor with its networks, as in ``visitor_at``."""
    return visitor_at(connection.client.host if connection.client else "unknown")
