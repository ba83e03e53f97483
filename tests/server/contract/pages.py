"""Visible texts of pages: shown or read aloud by a browser, or passed to scripts for display."""

import json
from collections.abc import Iterator
from html.parser import HTMLParser

import httpx

from tests.server.contract.folds import NAMES, SHIPPED
from tests.server.routes import pages

SHOWN_ATTRIBUTES = ("title", "alt", "placeholder", "aria-label", "content", "data-hint", "label")
"""Attributes that browsers show or read aloud."""
SILENT_TAGS = ("script", "style")
PAGES = {
    **{
        page.strip("/").replace("/", "-") or "landing": page for page in pages() if page != "/paper"
    },
    "compare": "/compare?a=pawn&b=cube",
    "compare-missing": "/compare?a=pawn&b=nosuchfold",
    "fold-missing": "/folds/nosuchfold",
}
"""Pages of more than one fold, or of none, by their names; without that of the paper, whose text
the programs of `bench.reproduction` write."""


class _Texts(HTMLParser):
    """Collector of the lines of one page."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._silent = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect the attributes that are shown."""
        self._silent = tag in SILENT_TAGS
        for name, value in attrs:
            if name in SHOWN_ATTRIBUTES and value:
                self.lines.append(f"[{name}] {' '.join(value.split())}")

    def handle_endtag(self, tag: str) -> None:
        """Leave a script or a style."""
        self._silent = False

    def handle_data(self, data: str) -> None:
        """Collect a text."""
        if not self._silent and (text := " ".join(data.split())):
            self.lines.append(text)


def visible(html: str) -> list[str]:
    """Return the texts of a page, one a line."""
    texts = _Texts()
    texts.feed(html)
    return texts.lines


def flat(value: object, name: str = "") -> Iterator[str]:
    """Return nested values as lines: one for each value without other lists or objects in it."""
    if isinstance(value, dict) and any(
        isinstance(element, dict | list) for element in value.values()
    ):
        for key, element in value.items():
            yield from flat(element, f"{name}.{key}" if name else key)
    elif isinstance(value, list) and any(isinstance(element, dict | list) for element in value):
        for number, element in enumerate(value):
            yield from flat(element, f"{name}[{number}]")
    else:
        yield f"{name}: {json.dumps(value, ensure_ascii=False)}"


def page_texts(http: httpx.Client) -> dict[str, str]:
    """Return the texts of all folds' pages, and of pages about several folds, by file name."""
    texts = {name: visible(http.get(address).text) for name, address in PAGES.items()}
    for kind in ("folds", "embed"):
        pages = {name: visible(http.get(f"/{kind}/{name}").text) for name in NAMES}
        common = set.intersection(*(set(lines) for lines in pages.values()))
        texts[f"{kind}-common"] = [line for line in pages[NAMES[0]] if line in common]
        for name, lines in pages.items():
            own_lines = [line for line in lines if line not in common]
            texts[name] = [*texts.get(name, []), f"--- /{kind}/{name}", *own_lines]
    for name in NAMES:
        facts = http.get(f"/folds/{name}/facts").json()
        texts[name] += [f"--- /folds/{name}/facts", *flat(facts)]
    for name in SHIPPED:
        state = http.get(f"/api/folds/{name}").json()
        texts[name] += [f"--- /api/folds/{name}", *flat(state["links"], "links")]
    return {f"pages/{name}.txt": "\n".join(lines) + "\n" for name, lines in texts.items()}
