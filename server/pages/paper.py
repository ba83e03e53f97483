"""The paper's experiments, run again: their page, films and pictures (``make reproduction``)."""

from __future__ import annotations

import asyncio
import json
from functools import cache
from pathlib import Path
from typing import Final, TypedDict

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.storage.file_names import CHAIN
from foldback.server.http.downloads import BINARY_MEDIA_TYPE, revalidated
from foldback.server.http.security import INDEXED_HEADERS
from foldback.server.pages.page import not_found, origin_of, page, rendered
from foldback.web.static_files import STATIC
from foldback.web.viser.scene_bundle import bundle_of

router = APIRouter(include_in_schema=False)

PAPER_DIR: Final = STATIC.parent / "paper"
PICTURE_MEDIA_TYPE: Final = "image/webp"


class Card(TypedDict):
    """One experiment; the page's template reads further keys."""

    id: str
    film: bool
    tone: str


class Section(TypedDict):
    """Experiments on one statement of the paper."""

    cards: list[Card]


class PaperPage(TypedDict):
    """Values that ``make reproduction`` writes; the page's template reads further keys."""

    sections: list[Section]


@router.get("/paper", response_class=HTMLResponse)
async def paper(request: Request) -> Response:
    """Return the page that compares the paper's experiments with our own runs."""
    values = await asyncio.to_thread(paper_values)
    return page("paper.html", listed=True, origin=origin_of(request), **values)


@router.get("/paper/settings")
async def settings(request: Request) -> Response:
    """Return the fields of the published method's settings, for pages that have none."""
    return revalidated(request, rendered("paper_settings.html").encode(), "text/html")


@router.get("/paper/{name}/{part}")
async def part_of_experiment(request: Request, name: str, part: str) -> Response:
    """Return a film, its scene bundle, or a still picture."""
    path = (await asyncio.to_thread(paper_files)).get((name, part))
    if path is None:
        return not_found()
    kind = PICTURE_MEDIA_TYPE if path.suffix == ".webp" else BINARY_MEDIA_TYPE
    return revalidated(request, await asyncio.to_thread(paper_data, path), kind, INDEXED_HEADERS)


@cache
def paper_values() -> dict[str, object]:
    """Return the values of the page's template."""
    paper_page: PaperPage = json.loads((PAPER_DIR / "page.json").read_bytes())
    cards = {card["id"]: card for section in paper_page["sections"] for card in section["cards"]}
    headline = next((c for c in cards.values() if c["film"] and c["tone"] == "good"), None)
    return {**paper_page, "cards": cards, "headline": headline}


@cache
def paper_files() -> dict[tuple[str, str], Path]:
    """Return the files by experiment and part, so that no path is built from a request."""
    paths = {(path.parent.name, path.name): path for path in sorted(PAPER_DIR.glob("*/*"))}
    return {
        (name, "bundle" if part == CHAIN else part): path for (name, part), path in paths.items()
    }


@cache
def paper_data(path: Path) -> bytes:
    """Return the content of a file of ``paper_files``; for a chain, its scene bundle."""
    data = path.read_bytes()
    return bundle_of(chain_from_attributes(json.loads(data))) if path.name == CHAIN else data
