"""Cards: the example shapes as pages show them, and the status of each on this service."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Final

from planner.readers.gallery import Gallery, GalleryShape
from server.store.folds import FoldRow, Store
from words.fold import ShownFold, shown_name
from words.gallery import (
    CARD_STATUS_LABELS,
    CHAIN_LABELS,
    TAG_LABELS,
    WORLD_LABELS,
    method_of,
    module_count,
    rest_of,
)

TETRAHEDRA_TAG: Final = "tetrahedra"
"""Tag of gallery shapes whose chains consist of tetrahedra. The list of tags omits it, as the
gallery has a separate choice between kinds of modules."""
_CARD_STATUSES: Final = {
    "verified": "verified",
    "running": "running",
    "queued": "running",
    "failed": "failed",
}
MAX_INCLUDED_FOLDS: Final = 10_000
"""Maximum number of public folds, newest first, among which pages look for the finished folds that
come with the package. With more public folds some of these would be missing from pages; a larger
value takes longer. Chosen."""
FEATURED_SHAPES: Final = (
    "tetra-ring",
    "wrench-24",
    "heart",
    "wrench-80",
    "guitar",
    "mallet-160",
    "tetra-wrench",
    "giraffe",
    "robot",
    "castle",
    "torus",
    "elephant",
)
"""Names of the gallery shapes on the landing page: chains of every kind of module, from the
shortest to the longest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Card(GalleryShape):
    """Texts of one example shape; the content of its file is left out."""

    data: bytes = b""

    @property
    def rests(self) -> str | None:
        """Requirement for folding on a table, in words; the torque is rounded up."""
        return rest_of(self.rests_within)

    @property
    def count(self) -> str:
        """Number of modules in words."""
        return module_count(self.modules, self.module)

    @property
    def words(self) -> str:
        """Searchable words, in lower case."""
        kinds = (TAG_LABELS.get(tag, tag) for tag in self.tags)
        return " ".join([self.title, self.name, self.count, *kinds]).lower()


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldStatus:
    """Status of a shape's fold on this service.

    Attributes:
        status: One of ``CARD_STATUS_LABELS``.
        fold: Id of the fold; None if there is none.
        method: Method of that fold in words, see ``method_of``; empty for the default one.
    """

    status: str = "new"
    fold: str | None = None
    method: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class GalleryFilter:
    """Filter of the gallery's cards. An empty field, or None, accepts all.

    Each of the ``words`` must be the beginning of a word of the card.
    """

    module: str = ""
    kind: str = ""
    status: str = ""
    world: str = ""
    words: str = ""
    least: int | None = None
    most: int | None = None

    @classmethod
    def of(cls, query: Mapping[str, str]) -> GalleryFilter:
        """Return the filter in a query, ``?type=cube&modules=100-200``; ignore invalid parts."""
        found = re.fullmatch(r"(\d{0,6})-(\d{0,6})", query.get("modules", ""))
        least, most = found.groups() if found else (query.get("least", ""), query.get("most", ""))

        def one_of(name: str, known: Mapping[str, str]) -> str:
            value = query.get(name, "")
            return value if value in known else ""

        return cls(
            module=one_of("type", CHAIN_LABELS),
            kind=one_of("kind", TAG_LABELS),
            status=one_of("status", CARD_STATUS_LABELS),
            world=one_of("world", WORLD_LABELS),
            words=" ".join(query.get("q", "")[:100].split()),
            least=int(least) if re.fullmatch(r"\d{1,6}", least) else None,
            most=int(most) if re.fullmatch(r"\d{1,6}", most) else None,
        )

    def lets(self, card: Card, standing: FoldStatus) -> bool:
        """Return True if the filter accepts a card."""
        return (
            self.module in ("", card.module)
            and (not self.kind or self.kind in card.tags)
            and self.status in ("", standing.status)
            and (not self.world or card.rests_within is not None)
            and (self.least is None or card.modules >= self.least)
            and (self.most is None or card.modules <= self.most)
            and all(f" {word}" in f" {card.words}" for word in self.words.lower().split())
        )


@cache
def cards(gallery: Gallery) -> tuple[Card, ...]:
    """Return all example shapes, shortest chain first."""
    return tuple(
        Card(**asdict(replace(shape, title=shown_name(shape.title), data=b"")))
        for shape in gallery.shapes()
    )


def selected(gallery: Gallery) -> list[Card]:
    """Return the cards of the landing page."""
    by_name = {card.name: card for card in cards(gallery)}
    return [by_name[name] for name in FEATURED_SHAPES if name in by_name]


@cache
def kinds(gallery: Gallery) -> list[tuple[str, str]]:
    """Return the kinds of shape and their names, the most common first.

    The kind of module is left out, because it is chosen separately.
    """
    counts = Counter(tag for card in cards(gallery) for tag in card.tags if tag != TETRAHEDRA_TAG)
    return [(tag, TAG_LABELS.get(tag) or tag.capitalize()) for tag, _ in counts.most_common()]


def included_folds(store: Store) -> list[ShownFold]:
    """Return the finished folds that came with the package, shortest chain first."""
    rows = [row for row in store.list_public(limit=MAX_INCLUDED_FOLDS) if "included" in row.summary]
    return [ShownFold.of(row) for row in sorted(rows, key=lambda row: (row.modules, row.name))]


def fold_statuses(store: Store) -> dict[str, FoldStatus]:
    """Return the status of each folded shape; the best of several folds counts."""
    best: dict[str, FoldRow] = {}
    order = list(CARD_STATUS_LABELS)

    def rank(row: FoldRow) -> int:
        return order.index(_CARD_STATUSES[row.status])

    for row in store.list_public(limit=MAX_INCLUDED_FOLDS):
        if row.shape is None or row.status not in _CARD_STATUSES:
            continue
        if row.shape not in best or rank(row) < rank(best[row.shape]):
            best[row.shape] = row
    return {
        shape: FoldStatus(
            status=_CARD_STATUSES[row.status], fold=row.id, method=method_of(row.preset, row.world)
        )
        for shape, row in best.items()
    }
