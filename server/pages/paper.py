"""The paper's experiments, run again: their page, films and pictures; ``make reproduction``."""

from __future__ import annotations

import asyncio
import json
from functools import cache
from pathlib import Path
from typing import Final, TypedDict

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from planner.motion.timeline import chain_from_attributes
from server.pages.page import origin_of, page
from server.pages.static import etag_response
from web.static_files import STATIC
from web.viser.scene_bundle import bundle_of

router = APIRouter(include_in_schema=False)

KEPT: Final = STATIC.parent / "paper"
CHAIN: Final = "chain.json"
BINARY: Final = "application/octet-stream"
PICTURE: Final = "image/webp"


class Card(TypedDict):
    """One experiment; its template reads more."""

    id: str
    film: bool
    tone: str


class Section(TypedDict):
    """Experiments to one statement of the paper."""

    cards: list[Card]


class PaperPage(TypedDict):
    """What ``make reproduction`` tells; its template reads more."""

    sections: list[Section]


@router.get("/paper", response_class=HTMLResponse)
async def paper(request: Request) -> Response:
    """Return the page that compares each experiment of the paper with ours."""
    told = await asyncio.to_thread(_told)
    cards = {card["id"]: card for section in told["sections"] for card in section["cards"]}
    headline = next((c for c in cards.values() if c["film"] and c["tone"] == "good"), None)
    return page(
        "paper.html",
        listed=True,
        origin=origin_of(request),
        **told,
        cards=cards,
        headline=headline,
    )


@router.get("/paper/{name}/{part}")
async def part_of_experiment(request: Request, name: str, part: str) -> Response:
    """Return a film, its scene bundle, or a still picture."""
    found = (await asyncio.to_thread(_files)).get((name, part))
    if found is None:
        return Response("not found", status_code=404, media_type="text/plain")
    kind = PICTURE if found.suffix == ".webp" else BINARY
    return etag_response(request, await asyncio.to_thread(_data, found), kind, listed=True)


@cache
def _told() -> PaperPage:
    return json.loads((KEPT / "page.json").read_bytes())


@cache
def _files() -> dict[tuple[str, str], Path]:
    """What there is, by experiment and part: no path is made of what somebody asks for."""
    found = {(path.parent.name, path.name): path for path in sorted(KEPT.glob("*/*"))}
    return {
        (name, "bundle" if part == CHAIN else part): path for (name, part), path in found.items()
    }


@cache
def _data(path: Path) -> bytes:
    data = path.read_bytes()
    return bundle_of(chain_from_attributes(json.loads(data))) if path.name == CHAIN else data
