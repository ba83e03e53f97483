"""Cards of the example shapes: their selection, and the status of each on this service."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

from foldback.planner.readers.gallery import Gallery, GalleryShape
from foldback.server.store.folds import FoldRow, Store
from foldback.words.fold import ShownFold
from foldback.words.gallery import (
    CARD_STATUS_LABELS,
    CHAIN_LABELS,
    TAG_LABELS,
    WORLD_LABELS,
    method_of,
)

_CARD_STATUSES: Final = {
    "verified": "verified",
    "running": "running",
    "queued": "running",
    "failed": "failed",
}
MAX_SHIPPED_FOLDS: Final = 10_000
"""Maximum number of public folds, newest first, among which pages look for the finished folds that
come with the package."""
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
class CardFacts:
    """Facts about a card in the gallery, by which it is filtered.

    Attributes:
        module, modules: Kind and number of modules of the chain.
        kinds: Kinds of the shape, see ``TAG_LABELS``.
        status: One of ``CARD_STATUS_LABELS``.
        world: ``table`` if the shape can be folded on a table, or if its fold is; else empty.
        words: Searchable words in lower case.
    """

    module: str
    modules: int
    kinds: tuple[str, ...]
    status: str
    world: str
    words: str

    @classmethod
    def of_shape(cls, shape: GalleryShape, status: FoldStatus) -> CardFacts:
        """Return the facts about an example shape."""
        return cls(
            module=shape.module,
            modules=shape.modules,
            kinds=shape.tags,
            status=status.status,
            world="" if shape.rests_within is None else "table",
            words=search_words(shape),
        )

    @classmethod
    def of_fold(cls, fold: ShownFold) -> CardFacts:
        """Return the facts about a finished fold, which is of no kind of shape."""
        return cls(
            module=fold.module,
            modules=fold.modules,
            kinds=(),
            status=_CARD_STATUSES.get(fold.status, "new"),
            world="table" if fold.world == "table" else "",
            words=f"{fold.title} {fold.counted} {fold.modules} modules".lower(),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class GalleryFilter:
    """Filter of the gallery's cards. An empty field, or None, accepts all.

    Each of the ``words`` must be the beginning of a word of ``search_words``.
    """

    module: str = ""
    kind: str = ""
    status: str = ""
    world: str = ""
    words: str = ""
    min_modules: int | None = None
    max_modules: int | None = None

    @classmethod
    def of(cls, query: Mapping[str, str]) -> GalleryFilter:
        """Return the filter in a query, ``?type=cube&modules=100-200``; ignore invalid parts."""
        match = re.fullmatch(r"(\d{0,6})-(\d{0,6})", query.get("modules", ""))
        smallest, largest = (
            match.groups() if match else (query.get("least", ""), query.get("most", ""))
        )

        def one_of(name: str, choices: Mapping[str, str]) -> str:
            value = query.get(name, "")
            return value if value in choices else ""

        return cls(
            module=one_of("type", CHAIN_LABELS),
            kind=one_of("kind", TAG_LABELS),
            status=one_of("status", CARD_STATUS_LABELS),
            world=one_of("world", WORLD_LABELS),
            words=" ".join(query.get("q", "")[:100].split()),
            min_modules=int(smallest) if re.fullmatch(r"\d{1,6}", smallest) else None,
            max_modules=int(largest) if re.fullmatch(r"\d{1,6}", largest) else None,
        )

    def lets(self, card: CardFacts) -> bool:
        """Return True if the filter accepts a card."""
        return (
            self.module in ("", card.module)
            and (not self.kind or self.kind in card.kinds)
            and self.status in ("", card.status)
            and self.world in ("", card.world)
            and (self.min_modules is None or card.modules >= self.min_modules)
            and (self.max_modules is None or card.modules <= self.max_modules)
            and all(f" {word}" in f" {card.words}" for word in self.words.lower().split())
        )


def search_words(shape: GalleryShape) -> str:
    """Return the searchable words of a shape, in lower case."""
    named = (TAG_LABELS.get(tag, tag) for tag in shape.tags)
    counts = (shape.counted, f"{shape.modules} modules")
    return " ".join([shape.title, shape.name, *counts, *named]).lower()


def selected(gallery: Gallery) -> list[GalleryShape]:
    """Return the shapes of the landing page."""
    by_name = {shape.name: shape for shape in gallery.shapes()}
    return [by_name[name] for name in FEATURED_SHAPES if name in by_name]


@cache
def kinds(gallery: Gallery) -> list[tuple[str, str]]:
    """Return the kinds of shape and their names, the most common first.

    The kind of module is left out, because it is chosen separately.
    """
    counts = Counter(
        tag for shape in gallery.shapes() for tag in shape.tags if tag != shape.words.plural
    )
    return [(tag, TAG_LABELS.get(tag) or tag.capitalize()) for tag, _ in counts.most_common()]


def shipped_folds(store: Store) -> list[ShownFold]:
    """Return the finished folds that came with the package, shortest chain first."""
    rows = [row for row in store.list_public(limit=MAX_SHIPPED_FOLDS) if "shipped" in row.summary]
    return [ShownFold.of(row) for row in sorted(rows, key=lambda row: (row.modules, row.name))]


def fold_statuses(store: Store) -> dict[str, FoldStatus]:
    """Return the status of each folded shape; the best of several folds counts."""
    best: dict[str, FoldRow] = {}
    order = list(CARD_STATUS_LABELS)

    def rank(row: FoldRow) -> int:
        return order.index(_CARD_STATUSES[row.status])

    for row in store.list_public(limit=MAX_SHIPPED_FOLDS):
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
