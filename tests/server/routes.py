"""Addresses that the routers of the service answer."""

import re

from fastapi.responses import HTMLResponse
from fastapi.routing import APIRoute

from foldback.server.app import ROUTERS


def paths(parameter: str = "", *, html: bool = False) -> list[str]:
    """Return the paths of routes that answer GET, such as ``/folds/{fold_id}``.

    Args:
        parameter: Name of a parameter that the paths contain; empty for all paths.
        html: True for pages only.
    """
    return [
        route.path
        for module in ROUTERS
        for route in module.router.routes
        if isinstance(route, APIRoute)
        and "GET" in (route.methods or ())
        and (not parameter or f"{{{parameter}" in route.path)
        and (not html or route.response_class is HTMLResponse)
    ]


def filled(path: str, value: str, **values: str) -> str:
    """Return a path with values of its parameters; ``value`` is that of all others."""
    return re.sub(r"{(\w+)[^}]*}", lambda match: values.get(match[1], value), path)


def pages() -> list[str]:
    """Return the addresses of all pages without parameters."""
    return [path for path in paths(html=True) if "{" not in path]


def fold_addresses(fold_id: str) -> list[str]:
    """Return the addresses of all pages and data of a fold, except its endless events."""
    routes = [path for path in paths("fold_id") if not path.endswith("/events")]
    return [
        *(filled(route, "csv", fold_id=fold_id) for route in routes),
        f"/compare?a={fold_id}&b={fold_id}",
    ]
