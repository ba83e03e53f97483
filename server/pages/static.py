"""Static files: style sheets, scripts, pictures, and their caching."""

from __future__ import annotations

import mimetypes
import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response

from foldback.server.http.downloads import Asset
from foldback.server.http.security import INDEXED_HEADERS
from foldback.server.pages.page import not_found
from foldback.web.static_files import STATIC, VERSIONED, code_of, scripts_version

router = APIRouter(include_in_schema=False)

IMMUTABLE_CACHE_CONTROL: Final = "public, max-age=31536000, immutable"
"""Value of the header ``Cache-Control`` for files whose content never changes under their address:
browsers need not ask for them again for a year (RFC 8246)."""
ELEMENT: Final = "foldback-fold.js"
"""Custom element with which pages of other sites show folds."""
ELEMENT_HEADERS: Final = {
    "Access-Control-Allow-Origin": "*",
    "Cross-Origin-Resource-Policy": "cross-origin",
    "Cache-Control": "public, max-age=86400",
}
"""Headers with which pages of other sites may load the element, and cache it for a day."""
SWAGGER_FILES: Final = ("swagger-ui-bundle.js", "swagger-ui.css")
"""Files of the package ``fastapi_offline`` that this service offers as static files, for the API
documentation without internet access."""

CHECKERS: Final = (
    "foldback_check.py",
    "foldback_check_refusals.py",
    "foldback_check_exhaustion.py",
)
"""Programs that prove from files alone a plan's clearance, the reason of a failure, or that no
turns lead to a figure: visitors can download them."""


ROBOTS_TXT: Final = """\
# Pages of folds and previews send "noindex, nofollow", because their links are secret.
# They are not listed here: a crawler that may not read a page cannot see its "noindex".
User-agent: *
Disallow: /api/
"""


@router.get("/robots.txt")
async def robots() -> Response:
    """Return the rules for search engines; they contain no secret links."""
    return Response(ROBOTS_TXT, media_type="text/plain", headers={"Cache-Control": "no-cache"})


WEB_MANIFEST: Final = {
    "name": "foldback",
    "short_name": "foldback",
    "description": "Turn any shape into a chain of robot cubes that folds itself.",
    "start_url": ".",
    "display": "browser",
    "background_color": "#f7f5f1",
    "theme_color": "#f7f5f1",
    "icons": [
        {"src": f"static/icon-{size}.png", "sizes": f"{size}x{size}", "type": "image/png"}
        for size in (192, 512)
    ],
}
"""Web app manifest (W3C): name and icons with which a browser or a phone stores a link to the
service. Its addresses are relative to its own."""


@router.get("/favicon.ico")
async def favicon(request: Request) -> Response:
    """Return the icon for browser tabs; some programs always request it by this name."""
    return _static("favicon.ico").response(request, INDEXED_HEADERS)


@router.get("/manifest.webmanifest")
async def manifest() -> Response:
    """Return the web app manifest."""
    headers = {"Cache-Control": "public, max-age=86400", **INDEXED_HEADERS}
    return JSONResponse(WEB_MANIFEST, media_type="application/manifest+json", headers=headers)


@router.get("/static/{name:path}")
async def static_file(request: Request, name: str) -> Response:
    """Return a style sheet, a script or a picture.

    Browsers cache a script whose address contains the current version. A page that was opened
    before an update requests scripts of an earlier version: the browser then gets the current
    script, does not cache it, and requests it again each time.
    """
    headers = dict(INDEXED_HEADERS)
    if (versioned := re.fullmatch(rf"{VERSIONED}/([0-9a-f]+)/(js/.+\.js)", name)) is not None:
        name = versioned[2]
        if versioned[1] == scripts_version():
            headers["Cache-Control"] = IMMUTABLE_CACHE_CONTROL
    if name == ELEMENT:
        headers |= ELEMENT_HEADERS
    asset = _static(name) if name in _paths() else None
    if asset is None:
        return not_found()
    return asset.response(request, headers)


@cache
def _static(name: str) -> Asset:
    path = _paths()[name]
    kinds = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
    kind = kinds.get(path.suffix) or mimetypes.guess_type(path.name)[0]
    is_script = path.suffix == ".js" and path.is_relative_to(STATIC)
    data = code_of(name).encode() if is_script else path.read_bytes()
    return Asset.of(data, kind or "application/octet-stream")


@cache
def _paths() -> dict[str, Path]:
    """Return the paths of the files by their names in addresses."""
    swagger_dir = Path(str(files("fastapi_offline"))) / "static"
    static_paths = {
        path.relative_to(STATIC).as_posix(): path for path in sorted(STATIC.rglob("*.*"))
    }
    return {
        **static_paths,
        **{name: swagger_dir / name for name in SWAGGER_FILES},
        **{name: STATIC.parents[1] / name for name in CHECKERS},
    }
