"""Cards of the gallery: which of them an address asks for, and what has become of a shape."""

from __future__ import annotations

from dataclasses import replace

import pytest

from planner.readers.gallery import Gallery
from server.pages.cards import (
    FEATURED_SHAPES,
    Card,
    FoldStatus,
    GalleryFilter,
    cards,
    fold_statuses,
    kinds,
    selected,
)
from server.store.folds import Store
from tests.server.rows import SOMEBODY
from tests.server.store.test_rows import row
from words.gallery import CHAIN_LABELS, TAG_LABELS, method_of

HEART = Card(
    name="heart", title="Heart", module="cube", modules=216, tags=("sign",), rests_within=1.94
)
RING = Card(
    name="tetra-ring",
    title="Ring of twelve",
    module="tetrahedron",
    modules=12,
    tags=("tetrahedra", "ring"),
)
VERIFIED = FoldStatus(status="verified", fold="a")


@pytest.mark.parametrize(
    ("query", "found"),
    [
        ({}, "both"),
        ({"type": "cube"}, "heart"),
        ({"type": "tetrahedron"}, "ring"),
        ({"type": "<script>"}, "both"),
        ({"kind": "ring"}, "ring"),
        ({"status": "verified"}, "heart"),
        ({"status": "new"}, "ring"),
        ({"world": "table"}, "heart"),
        ({"world": "moon"}, "both"),
        ({"modules": "100-200"}, ""),
        ({"modules": "-100"}, "ring"),
        ({"modules": "216-216"}, "heart"),
        ({"modules": "nonsense"}, "both"),
        ({"least": "13", "most": ""}, "heart"),
        ({"q": "  HEART "}, "heart"),
        ({"q": "twelve ring"}, "ring"),
        ({"q": "signs"}, "heart"),
        ({"q": "216 modules"}, "heart"),
        ({"q": "heart ring"}, ""),
        ({"q": "eart"}, ""),
        ({"q": "t"}, "ring"),
    ],
)
def test_an_address_says_which_are_wanted(query: dict[str, str], found: str) -> None:
    sieve = GalleryFilter.of(query)
    let = [
        name
        for name, card, standing in (("heart", HEART, VERIFIED), ("ring", RING, FoldStatus()))
        if sieve.lets(card, standing)
    ]
    assert let == {"both": ["heart", "ring"], "": []}.get(found, [found])


def test_every_selected_shape_is_there_and_every_kind_has_a_name() -> None:
    gallery = Gallery()
    assert [card.name for card in selected(gallery)] == list(FEATURED_SHAPES)
    assert len(cards(gallery)) == len(gallery.shapes())
    assert {tag for tag, _ in kinds(gallery)} <= set(TAG_LABELS)
    assert not {text for _, text in kinds(gallery)} & set(CHAIN_LABELS.values())


def test_the_best_of_several_folds_counts(store: Store) -> None:
    folds = [
        ("heart", "failed"),
        ("heart", "verified"),
        ("heart", "running"),
        ("cat", "queued"),
        ("cat", "failed"),
        ("dog", "cancelled"),
        (None, "verified"),
    ]
    for number, (shape, status) in enumerate(folds):
        values = {"id": f"fold{number}", "shape": shape, "status": status, "public": True}
        assert store.add(row(None, **values), SOMEBODY)
    assert store.add(
        row(None, id="private", shape="dog", status="verified", public=False), SOMEBODY
    )
    assert fold_statuses(store) == {
        "heart": FoldStatus(status="verified", fold="fold1"),
        "cat": FoldStatus(status="running", fold="fold3"),
    }


def test_cards_say_within_what_a_shape_rests_on_a_table() -> None:
    assert HEART.rests == "Can be folded on a table (needs 2.0× a module's weight × width)"
    assert RING.rests is None
    assert (
        replace(HEART, rests_within=0.0).rests == "Can be folded on a table (needs no motor torque)"
    )
    known = [card for card in cards(Gallery()) if card.rests]
    assert known
    assert {card.module for card in known} == {"cube"}


@pytest.mark.parametrize(
    ("preset", "world", "words"),
    [
        ("default", "floating", ""),
        ("direct", "floating", "direct servoing"),
        ("paper", "floating", "published method"),
        ("default", "table", "on a table"),
    ],
)
def test_card_of_an_unusual_fold_says_its_method(preset: str, world: str, words: str) -> None:
    assert method_of(preset, world) == words
