"""Pages: the landing page, the page of a fold, and the few files they are made of."""

from __future__ import annotations

import asyncio
import hashlib
import json
import mimetypes
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, JSONResponse, Response
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from planner.errors import InputError, PlannerError
from planner.motion.timeline import chain_from_attributes
from planner.pipeline.attempt_folders import CHAIN, result
from planner.readers import read
from server.api.context import context_of
from server.api.finding import find_now, viewing_of
from server.http.problems import Problem
from server.http.response_cache import mark
from server.http.security import LISTED
from server.pages.cards import cards, selected
from server.pages.choice_words import WISHES
from server.pages.facts import FoldFacts, fold_facts
from server.pages.pictures import picture_answer
from server.pages.quantities import sentence
from server.pages.setting_words import ROWS, SOURCES
from server.store.folds import Store
from server.store.shown import Found
from web.pictures.isometric import isometric_svg
from web.pictures.isometric_modules import chain_svg
from web.static_files import STATIC, scripts_of
from web.viser.scene_bundle import bundle_of

if TYPE_CHECKING:
    from server.store.gallery import Gallery, GalleryShape

router = APIRouter(include_in_schema=False)

BATCH: Final = STATIC.parent / "featured.batch"
FEATURED: Final = "wrench-160"
LARGEST_DRAWING: Final = 4000
SWAGGER: Final = ("swagger-ui-bundle.js", "swagger-ui.css")
"""Files of the package ``fastapi_offline``, served from here."""
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


@cache
def entry(page_name: str) -> Markup:
    """The entry module of a page, and all that it imports, to be fetched at the same time."""
    first, *others = (f"/static/{name}" for name in scripts_of(f"js/pages/{page_name}.js"))
    preloads = (Markup('<link rel="modulepreload" href="{}">').format(name) for name in others)
    script = Markup('<script type="module" src="{}"></script>').format(first)
    return Markup("").join((*preloads, script))


KNOWN: Final[dict[str, object]] = {
    "paper_settings": ROWS,
    "wishes": WISHES,
    "setting_sources": SOURCES,
    "entry": entry,
}
"""Values that every template gets."""
HEADINGS: Final = {
    404: "There is nothing here",
    429: "This is a little too much at once",
    503: "Not just now",
    507: "There is no room just now",
}
PAWN: Final = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1))


@router.get("/", response_class=HTMLResponse)
async def landing(request: Request) -> Response:
    """The first page."""
    context = context_of(request)
    featured = await asyncio.to_thread(_featured, context.store)
    still = await asyncio.to_thread(_still, context.gallery, FEATURED, 480)
    return page(
        "landing.html",
        listed=True,
        shapes=selected(context.gallery),
        count=len(cards(context.gallery)),
        featured=featured,
        origin=_origin(request),
        still=still or isometric_svg(PAWN),
    )


@router.get("/what-folds", response_class=HTMLResponse)
async def what_folds() -> Response:
    """The success map, and what it says: ``make success-map`` draws it."""
    return page("what_folds.html", listed=True)


@router.get("/featured/bundle")
async def featured_bundle(request: Request) -> Response:
    """What is known of the chain on the first page."""
    gallery = context_of(request).gallery
    return kept_answer(
        request, await asyncio.to_thread(lambda: bundle_of(_featured_chain(gallery)))
    )


@router.get("/featured/picture.png")
async def featured_picture(request: Request) -> Response:
    """What networks show beside a link to the first page."""
    picture = await asyncio.to_thread(_social, context_of(request).gallery)
    return picture_answer(picture, listed=True)


def warm_up(gallery: Gallery) -> None:
    """Draws the shape of the first page, which loads what all pages need."""
    bundle_of(_featured_chain(gallery))
    _still(gallery, FEATURED, 480)
    for name in ("landing.html", "fold.html", "gallery.html"):
        _templates().get_template(name)


@cache
def _social(gallery: Gallery) -> bytes:
    # Drawing brings kernels along that the start of the server need not wait for.
    from web.pictures.social_picture import social_picture

    return social_picture(_featured_chain(gallery))


@cache
def _featured_chain(gallery: Gallery) -> Chain:
    shape = gallery.shape(FEATURED)
    assert shape is not None, f"{FEATURED} is in the gallery"
    return _chain(shape)


@router.get("/featured/batch")
async def featured_batch(request: Request) -> Response:
    """Its fold, recorded: ``examples/make_featured.py``."""
    return kept_answer(request, await asyncio.to_thread(_recorded))


@cache
def _recorded() -> bytes:
    return BATCH.read_bytes()


def kept_answer(
    request: Request, data: bytes, kind: str = "application/octet-stream", *, listed: bool = False
) -> Response:
    """Something that browsers keep until it changes; ``listed`` as of a page."""
    headers = {"ETag": f'"{hashlib.sha256(data).hexdigest()[:20]}"', "Cache-Control": "no-cache"}
    if listed:
        headers |= LISTED
    if request.headers.get("if-none-match") == headers["ETag"]:
        return Response(status_code=304, headers=headers)
    return Response(data, media_type=kind, headers=headers)


@router.get("/shapes/{name}.svg")
async def drawing_of_shape(request: Request, name: str) -> Response:
    """The drawing of a gallery shape."""
    svg = await asyncio.to_thread(_still, context_of(request).gallery, name, 160)
    if svg is None:
        return Response("not found", status_code=404, media_type="text/plain")
    headers = {
        "Cache-Control": "public, max-age=3600",
        "Content-Security-Policy": "default-src 'none'",
        **LISTED,
    }
    return Response(svg, media_type="image/svg+xml", headers=headers)


@router.get("/folds/{fold_id}", response_class=HTMLResponse)
async def fold_page(request: Request, fold_id: str) -> Response:
    """The page of a fold."""
    return await asyncio.to_thread(_fold_page, request, fold_id)


def _fold_page(request: Request, fold_id: str) -> Response:
    found = find_now(request, fold_id)
    if found is None:
        return not_found_page(
            "There is no such fold", "The link may be incomplete, or the fold was deleted."
        )
    mark(request, found.row)
    facts = _facts(request, found)
    return page(
        "fold.html",
        listed=found.row.public,
        facts=facts,
        facts_json=script_json(facts),
        drawing=_drawing(found),
        details=True,
        origin=_origin(request),
    )


@router.get("/folds/{fold_id}/facts")
async def facts_of_fold(request: Request, fold_id: str) -> Response:
    """What the page says about the fold, for a page that is open when it ends."""

    def answer() -> Response:
        found = find_now(request, fold_id)
        if found is None:
            return JSONResponse({"detail": "There is no such fold."}, status_code=404)
        return JSONResponse(_facts(request, found), headers={"Cache-Control": "no-store"})

    return await asyncio.to_thread(answer)


@router.get("/static/{name:path}")
async def static_file(request: Request, name: str) -> Response:
    """A style sheet, a script or a picture."""
    found = _static().get(name)
    if found is None:
        return Response("not found", status_code=404, media_type="text/plain")
    data, kind, etag = found
    headers = {"ETag": etag, "Cache-Control": "no-cache", **LISTED}
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers=headers)
    return Response(data, media_type=kind, headers=headers)


@router.get("/docs")
async def api_page() -> Response:
    """The API for people: its description, drawn by Swagger UI out of a package of its own."""
    return page("api.html")


def not_found_page(heading: str, text: str, *, status_code: int = 404) -> Response:
    """A page that says in words why there is nothing to see."""
    drawing = isometric_svg(PAWN)
    return page("message.html", status_code, heading=heading, text=text, drawing=drawing)


def problem_page(problem: Problem) -> Response:
    """The same for whatever went wrong."""
    heading = HEADINGS.get(problem.status, "This did not work")
    answer = not_found_page(heading, sentence(problem.detail), status_code=problem.status)
    answer.headers.update(problem.headers)
    return answer


def page(
    template: str, status_code: int = 200, /, *, listed: bool = False, **values: object
) -> Response:
    """A page made of a template, under the policy of all pages.

    Args:
        template: Its name.
        status_code: Of the answer.
        listed: Whether search engines may show it.
        values: What the template is filled in with.
    """
    html = rendered(template, **values)
    headers = {"Content-Security-Policy": POLICY, "Cache-Control": "no-store"}
    if listed:
        headers |= LISTED
    return HTMLResponse(html, status_code=status_code, headers=headers)


def rendered(template: str, /, **values: object) -> str:
    """A template filled in."""
    return _templates().get_template(template, globals=KNOWN).render(**values)


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
    drawn = Path(str(files("fastapi_offline"))) / "static"
    ours = {path.relative_to(STATIC).as_posix(): path for path in sorted(STATIC.rglob("*.*"))}
    for name, path in {**ours, **{name: drawn / name for name in SWAGGER}}.items():
        data = path.read_bytes()
        kind = kinds.get(path.suffix) or mimetypes.guess_type(path.name)[0]
        etag = f'"{hashlib.sha256(data).hexdigest()[:20]}"'
        found[name] = (data, kind or "application/octet-stream", etag)
    return found


def _still(gallery: Gallery, name: str, size: int) -> str | None:
    """The drawing of a gallery shape; None when there is no such shape, or it can't be drawn."""
    return None if gallery.shape(name) is None else _drawn(gallery, name, size)


@cache
def _drawn(gallery: Gallery, name: str, size: int) -> str | None:
    shape = gallery.shape(name)
    if shape is None:
        return None
    try:
        return chain_svg(_chain(shape), size=size)
    except PlannerError:
        return None


def _featured(store: Store) -> str | None:
    """The fold of the shape that plays on the first page, if somebody has folded it here."""
    rows = [
        row for row in store.list_public() if row.shape == FEATURED and row.status == "verified"
    ]
    return rows[-1].id if rows else None


def _drawing(found: Found) -> str:
    """The folded shape, shown until the view is there; empty while nobody knows what it will be."""
    for path in (result(found.directory, CHAIN), found.directory / "cells.json"):
        if path.exists():
            return _drawing_of(path, path.name == CHAIN)
    return ""


@lru_cache(maxsize=256)
def _drawing_of(path: Path, is_chain: bool) -> str:
    """A drawing of a chain, or of the cells that were noted when the upload was read."""
    try:
        noted = json.loads(path.read_text(encoding="utf-8"))
        if is_chain:
            chain = chain_from_attributes(noted)
            return chain_svg(chain) if len(chain) <= LARGEST_DRAWING else ""
        cells = np.array(noted, dtype=int).reshape(-1, 3)
    except (PlannerError, OSError, ValueError, KeyError):
        return ""  # a drawing is not worth an error
    return isometric_svg(cells) if 0 < len(cells) <= LARGEST_DRAWING else ""


def _chain(shape: GalleryShape) -> Chain:
    match read(shape.data, filename=shape.filename):
        case Chain() as chain:
            return chain
        case CellPath() as path:
            return Chain.from_path(path)
        case other:
            got = type(other).__name__.lower()
            detail = f"{shape.name} is a {got}; gallery shapes are paths or chains."
            raise InputError("not-a-path", detail)


def _origin(request: Request) -> str:
    """Scheme and host that the page was asked for at."""
    return str(request.base_url).rstrip("/")


def _facts(request: Request, found: Found) -> FoldFacts:
    viewing = viewing_of(request)
    settings = viewing.settings
    embed = settings is not None and bool(settings.embed_origins)
    return fold_facts(found, api=viewing.jobs is not None, embed=embed)


def script_json(value: object) -> str:
    """JSON that may stand inside a script element."""
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
