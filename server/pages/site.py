"""A static website: gallery, folds, paper and benchmarks for any web host, or for a folder.

The pages are those of the service. Their links are relative, and each address that a template uses
is recorded, so that its file is written and no link is broken.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from markupsafe import Markup

from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.plan.module_values import values_in
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.storage.files import write_whole
from foldback.server.pages.facts import fold_facts
from foldback.server.pages.fold import drawing_in
from foldback.server.pages.kiosk import exhibits
from foldback.server.pages.page import rendered
from foldback.server.pages.paper import paper_data, paper_files, paper_values
from foldback.server.pages.share import standalone_page
from foldback.server.pages.static import ELEMENT
from foldback.server.store.fold_source import LocatedFold
from foldback.server.viewing.fold_notes import draft_of, steps_in
from foldback.web.static_files import STATIC, code_of
from foldback.web.timeline.folding_drawing import folding_drawing
from foldback.web.timeline.view import TimelineView
from foldback.web.viser.client import client
from foldback.web.viser.standalone import (
    ENTRY_SCRIPT,
    FILMS_SCRIPT,
    KIOSK_SCRIPT,
    entry_of,
    film_script,
    packed_scripts,
)
from foldback.words.fold import ShownFold
from foldback.words.gallery import CARD_STATUS_LABELS, method_of

SCRIPTS_FILE: Final = "static/foldback.js"
"""File with the scripts of all pages."""
MOVING_CARDS_SCRIPT: Final = "js/lib/moving_cards.js"
"""Script that moves the drawings of the gallery's cards; the gallery contains it."""
VIEW_FILE: Final = "view.html"
"""File with viser's client, which pages of folds show in a frame."""
FILES: Final = {
    "/": "index.html",
    "/gallery": "index.html",
    "/paper": "paper.html",
    "/benchmarks": "benchmarks.html",
    "/kiosk": "kiosk.html",
}
"""Pages of a site by their addresses in the service."""
FOLD_ADDRESS: Final = re.compile(r"/folds/([A-Za-z0-9_-]+)(/drawing\.svg)?")
FILE_ADDRESS: Final = re.compile(r"/((?:static|paper)/.+)")


@dataclass(frozen=True, slots=True)
class Site:
    """A static website while it is written.

    Attributes:
        out: Directory of the site.
        service_address: Address of a service that folds visitors' shapes; None without one.
        project_address: Address of foldback's project; None if unknown.
        file_names: Names of the files that pages refer to.
    """

    out: Path
    service_address: str | None = None
    project_address: str | None = None
    file_names: set[str] = field(default_factory=set)

    def at(self, root: str, address: str) -> str:
        """Return an address of the service as a page of the site refers to it.

        Args:
            root: Relative path from the page's directory to the site's.
            address: Path in the service.

        Raises:
            ValueError: If a site has no such file.
        """
        name = FILES.get(address)
        if name is None and (fold := FOLD_ADDRESS.fullmatch(address)):
            name = f"folds/{fold[1]}.{'svg' if fold[2] else 'html'}"
        elif name is None and (file := FILE_ADDRESS.fullmatch(address)):
            name = file[1]
        if name is None:
            raise ValueError(
                f"got a link to {address}, expected a page or file of the static website"
            )
        self.file_names.add(name)
        return root + name

    def rendered(self, template: str, root: str = "", /, **values: object) -> str:
        """Return a page rendered from a template of the service."""
        return rendered(template, **values, site=self, at=partial(self.at, root))

    def films(self, _page_name: str) -> Markup:
        """Return the tag of the scripts of the page with the paper's experiments."""
        return Markup('<script defer src="{}" data-entry="{}"></script>').format(
            self.at("", f"/{SCRIPTS_FILE}"), entry_of(FILMS_SCRIPT)
        )

    def write(self, name: str, content: str | bytes) -> None:
        """Write a file."""
        path = self.out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content.encode() if isinstance(content, str) else content)


def write_site(
    out: Path,
    folds: Sequence[LocatedFold],
    service_address: str | None = None,
    sweeps: Sequence[str] = (),
    project_address: str | None = None,
) -> None:
    """Write a site.

    Args:
        out: Directory of the site.
        folds: Finished folds with different ids, after which their files are named.
        service_address: Address of a service that folds visitors' shapes.
        sweeps: Names of sweeps, whose pages are in the folder ``sweeps``.
        project_address: Address to which the first page links the name of foldback; its page about
            the paper if None.

    Raises:
        OSError: If a file cannot be written.
        PlannerError: If the files of a fold cannot be read.
    """
    site = Site(out, service_address, project_address)
    for fold in folds:
        site.write(f"folds/{fold.row.id}.html", _fold_page(site, fold))
        site.write(f"folds/{fold.row.id}.svg", drawing_in(fold.directory))
        timeline = TimelineView(result_path(fold.directory, TIMELINE))
        if moving := folding_drawing(timeline):
            site.write(f"folds/{fold.row.id}/motion.svg", moving)
    gallery = site.rendered(
        "site.html",
        finished=[fold.row for fold in folds],
        statuses=CARD_STATUS_LABELS,
        method_of=method_of,
        moving_cards=Markup(code_of(MOVING_CARDS_SCRIPT)),
        sweeps=sweeps,
    )
    site.write("index.html", gallery)
    site.write("benchmarks.html", site.rendered("benchmarks.html"))
    films = site.rendered("paper.html", **paper_values(), origin="", entry=site.films)
    site.write("paper.html", films)
    kiosk_folds = exhibits([ShownFold.of(fold.row) for fold in folds], "folds/{}.html")
    script = entry_of(KIOSK_SCRIPT)
    site.write("kiosk.html", site.rendered("kiosk.html", exhibits=kiosk_folds, script=script))
    _shared_files(site)


def write_players(out: Path, folds: Iterable[LocatedFold], home: str) -> None:
    """Write pages that play folds.

    Args:
        out: Directory of the pages and of the files that they share.
        folds: Finished folds with different ids, after which their pages are named.
        home: Relative address of the page to which they lead back.
    """
    site = Site(out)
    for fold in folds:
        site.write(f"folds/{fold.row.id}.html", _fold_page(site, fold))
    site.write("index.html", f'<meta http-equiv="refresh" content="0; url={home}">')
    _shared_files(site)


def _fold_page(site: Site, fold: LocatedFold) -> bytes:
    render = partial(site.rendered, "standalone.html", "../", details=True)
    timeline = TimelineView(result_path(fold.directory, TIMELINE))
    facts = fold_facts(fold, api=False)
    stored_parts = {
        "tour": draft_of(fold),
        "values": values_in(fold.directory, fold.row.modules),
        "steps": steps_in(fold),
    }
    return standalone_page(
        fold, timeline, facts, render, view=f"../{VIEW_FILE}", stored_parts=stored_parts
    )


def _shared_files(site: Site) -> None:
    """Write all files that pages refer to besides pages."""
    site.write(VIEW_FILE, client().html)
    site.write(ELEMENT, code_of(ELEMENT))
    for name in sorted(site.file_names):
        folder, _, file_name = name.partition("/")
        if name == SCRIPTS_FILE:
            site.write(name, packed_scripts(ENTRY_SCRIPT, FILMS_SCRIPT, KIOSK_SCRIPT))
        elif folder == "static":
            site.write(name, (STATIC / file_name).read_bytes())
        elif folder == "paper" and "/" in file_name:
            experiment, _, picture = file_name.partition("/")
            site.write(name, paper_data(paper_files()[experiment, picture]))
        elif folder == "paper":
            parts = {
                part: paper_data(paper_files()[file_name, part]) for part in ("bundle", "batch")
            }
            site.write(f"{name}.js", film_script(name, **parts))
