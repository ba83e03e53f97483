"""Pages: the landing page, the page of a fold, and the few files they are made of."""

from __future__ import annotations

import asyncio
import hashlib
import json
import mimetypes
import secrets
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, JSONResponse, Response
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from planner.errors import PlannerError
from planner.readers import read
from planner.timeline import chain_from_attributes
from server.routes.facts import fold_facts, shown_name
from server.routes.finding import Found, find_fold
from web.colours import ERROR, NEUTRAL, UNKNOWN, css
from web.isometric import isometric_svg

if TYPE_CHECKING:
    from server.gallery import Gallery

router = APIRouter(include_in_schema=False)

STATIC: Final = Path(__file__).parents[2] / "web" / "static"
FEATURED: Final = "wrench-160"
LARGEST_DRAWING: Final = 4000
POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "frame-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'self'",
    )
)
PAWN: Final = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1))


@router.get("/", response_class=HTMLResponse)
async def landing(request: Request) -> Response:
    """The first page."""
    context = request.app.state.context
    shapes = await asyncio.to_thread(_cards, context.gallery)
    featured = await asyncio.to_thread(_featured, context.store)
    still = next((s["still"] for s in shapes if s["name"] == FEATURED), None)
    if still is None:
        still = shapes[0]["still"] if shapes else isometric_svg(PAWN)
    return _page("landing.html", shapes=shapes, featured=featured, visitor=_visitor(), still=still)


@router.get("/folds/{fold_id}", response_class=HTMLResponse)
async def fold_page(request: Request, fold_id: str) -> Response:
    """The page of a fold."""
    found = await find_fold(request.app, fold_id)
    if found is None:
        return not_found_page(
            "There is no such fold", "The link may be incomplete, or the fold was deleted."
        )
    facts = await asyncio.to_thread(fold_facts, found, api=_has_api(request))
    facts["visitor"] = visitor = _visitor()
    drawing = await asyncio.to_thread(_drawing, found)
    return _page(
        "fold.html",
        facts=facts,
        facts_json=_script_json(facts),
        visitor=visitor,
        drawing=drawing,
        colours={"none": css(NEUTRAL), "full": css(ERROR), "unknown": css(UNKNOWN)},
    )


@router.get("/folds/{fold_id}/facts")
async def facts_of_fold(request: Request, fold_id: str) -> Response:
    """What the page says about the fold, for a page that is open when it ends."""
    found = await find_fold(request.app, fold_id)
    if found is None:
        return JSONResponse({"detail": "There is no such fold."}, status_code=404)
    facts = await asyncio.to_thread(fold_facts, found, api=_has_api(request))
    return JSONResponse(facts, headers={"Cache-Control": "no-store"})


@router.get("/static/{name}")
async def static_file(request: Request, name: str) -> Response:
    """A style sheet, a script or a picture."""
    found = _static().get(name)
    if found is None:
        return Response("not found", status_code=404, media_type="text/plain")
    data, kind, etag = found
    headers = {"ETag": etag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers=headers)
    return Response(data, media_type=kind, headers=headers)


def not_found_page(heading: str, text: str, *, status_code: int = 404) -> Response:
    """A page that says in words why there is nothing to see."""
    drawing = isometric_svg(PAWN)
    return _page("message.html", status_code, heading=heading, text=text, drawing=drawing)


def _page(template: str, status_code: int = 200, /, **values: Any) -> Response:
    html = _templates().get_template(template).render(**values)
    headers = {"Content-Security-Policy": POLICY, "Cache-Control": "no-store"}
    return HTMLResponse(html, status_code=status_code, headers=headers)


@cache
def _templates() -> Environment:
    return Environment(
        loader=PackageLoader("web", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def _static() -> dict[str, tuple[bytes, str, str]]:
    kinds = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
    found: dict[str, tuple[bytes, str, str]] = {}
    for path in sorted(STATIC.iterdir()):
        data = path.read_bytes()
        kind = kinds.get(path.suffix) or mimetypes.guess_type(path.name)[0]
        etag = f'"{hashlib.sha256(data).hexdigest()[:20]}"'
        found[path.name] = (data, kind or "application/octet-stream", etag)
    return found


@cache
def _cards(gallery: Gallery) -> list[dict[str, Any]]:
    """The gallery as cards."""
    cards: list[dict[str, Any]] = []
    for shape in gallery.shapes():
        try:
            cells = _cells(read(shape.data, filename=shape.filename))
        except PlannerError:
            continue
        cards.append(
            {
                "name": shape.name,
                "title": shown_name(shape.title),
                "modules": shape.modules,
                "drawing": isometric_svg(cells),
                "still": isometric_svg(cells, size=480),
            }
        )
    return cards


def _featured(store: Any) -> Any:
    """The fold in motion on the first page: the featured shape if it is there, or the newest."""
    rows = [row for row in store.list_public() if row.status in ("verified", "running")]
    rows.sort(key=lambda r: (getattr(r, "shape", None) == FEATURED, r.status == "verified"))
    for row in reversed(rows):
        if (Path(store.directory(row.id)) / "timeline.zarr").exists():
            return {"id": row.id, "name": shown_name(row.name), "modules": row.modules}
    return None


def _drawing(found: Found) -> str:
    """The folded shape, shown until the view is there."""
    chain = found.directory / "chain.json"
    return _drawing_of(chain if chain.exists() else found.directory / "input", chain.exists())


@lru_cache(maxsize=256)
def _drawing_of(path: Path, is_chain: bool) -> str:
    """A drawing of a chain that is known, or of an input that is still to be read."""
    cells: Any = np.array(PAWN)
    try:
        if is_chain:
            attributes = json.loads(path.read_text(encoding="utf-8"))
            folded = chain_from_attributes(attributes).folded_poses.positions
            cells = np.rint(folded).astype(int)
        else:
            cells = _cells(read(path.read_bytes()))
    except (PlannerError, OSError, ValueError, KeyError):
        pass  # a drawing is not worth an error
    return isometric_svg(cells) if len(cells) <= LARGEST_DRAWING else ""


def _cells(read_in: Any) -> Any:
    if hasattr(read_in, "cells"):
        return read_in.cells
    return np.rint(read_in.folded_poses.positions).astype(int)


def _visitor() -> str:
    return secrets.token_urlsafe(18)


def _has_api(request: Request) -> bool:
    return getattr(request.app.state.context, "jobs", None) is not None


def _script_json(value: Any) -> str:
    """JSON that may stand inside a script element."""
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
