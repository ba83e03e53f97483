"""Cards of the gallery: their selection by address, and the status of shapes."""

from dataclasses import replace

from foldback.planner.readers.gallery import Gallery, GalleryShape
from foldback.server.pages.cards import (
    FEATURED_SHAPES,
    CardFacts,
    FoldStatus,
    GalleryFilter,
    fold_statuses,
    kinds,
    selected,
)
from foldback.server.store.folds import Store
from foldback.words.fold import ShownFold
from foldback.words.gallery import CHAIN_LABELS, TAG_LABELS, method_of, rest_of
from tests.server.rows import SOMEBODY
from tests.server.store.test_rows import row

CUBES = GalleryShape(name="heart", title="Heart", modules=216, data=b"", tags=("sign",))
HEART = replace(CUBES, rests_within=1.94)
RING = replace(
    CUBES, name="ring", title="Ring of twelve", module="tetrahedron", modules=12, tags=("ring",)
)
VERIFIED = FoldStatus(status="verified", fold="a")


FILTERS: tuple[tuple[dict[str, str], str], ...] = (
    ({}, "heart ring"),
    ({"type": "cube"}, "heart"),
    ({"type": "<script>"}, "heart ring"),
    ({"kind": "ring"}, "ring"),
    ({"status": "verified"}, "heart"),
    ({"world": "table"}, "heart"),
    ({"world": "moon"}, "heart ring"),
    ({"modules": "100-200"}, ""),
    ({"modules": "-100"}, "ring"),
    ({"modules": "nonsense"}, "heart ring"),
    ({"least": "13", "most": ""}, "heart"),
    ({"q": "  HEART "}, "heart"),
    ({"q": "twelve ring"}, "ring"),
    ({"q": "signs"}, "heart"),
    ({"q": "216 modules"}, "heart"),
    ({"q": "eart"}, ""),
    ({"q": "t"}, "ring"),
)


def test_gallery_filter_selects_cards() -> None:
    card_folds = {"heart": (HEART, VERIFIED), "ring": (RING, FoldStatus())}
    for query, expected in FILTERS:
        sieve = GalleryFilter.of(query)
        names = [
            name
            for name, (card, status) in card_folds.items()
            if sieve.lets(CardFacts.of_shape(card, status))
        ]
        assert " ".join(names) == expected, query


def test_gallery_filter_selects_finished_folds() -> None:
    facts = ShownFold(
        id="a",
        name="mallet-80",
        refold="wrench-80",
        status="verified",
        modules=80,
        preset="",
        seed=0,
    )
    card = CardFacts.of_fold(facts)
    for query, expected in (
        ({"q": "wrench"}, True),
        ({"q": "mallet 80 modules"}, True),
        ({"q": "heart"}, False),
        ({"type": "tetrahedron"}, False),
        ({"modules": "80-80", "status": "verified"}, True),
        ({"world": "table"}, False),
        ({"status": "new"}, False),
        ({"kind": "tool"}, False),
    ):
        assert GalleryFilter.of(query).lets(card) == expected, query


def test_selected_shapes_exist_and_kinds_have_names() -> None:
    gallery = Gallery()
    assert [shape.name for shape in selected(gallery)] == list(FEATURED_SHAPES)
    assert {tag for tag, _ in kinds(gallery)} <= set(TAG_LABELS)
    assert not {text for _, text in kinds(gallery)} & set(CHAIN_LABELS.values())


def test_status_of_a_shape_is_that_of_its_best_public_fold(store: Store) -> None:
    folds = [("heart", status) for status in ("failed", "verified", "running")]
    folds += [("cat", "queued"), ("cat", "failed"), ("dog", "cancelled"), (None, "verified")]
    for number, (shape, status) in enumerate(folds):
        store.add(row(id=f"fold{number}", shape=shape, status=status, public=True), SOMEBODY)
    store.add(row(id="private", shape="dog", status="verified", public=False), SOMEBODY)
    assert fold_statuses(store) == {
        "heart": FoldStatus(status="verified", fold="fold1"),
        "cat": FoldStatus(status="running", fold="fold3"),
    }


def test_cards_show_the_torque_needed_on_a_table() -> None:
    assert rest_of(1.94).endswith("(joints must hold 2.0 modules at a distance of one spacing)")
    assert rest_of(None) is None
    assert rest_of(0.0) == "Can be folded on a table (needs almost no motor torque)"
    shapes = [shape for shape in Gallery().shapes() if rest_of(shape.rests_within)]
    assert {shape.module for shape in shapes} == {"cube"}


def test_card_of_an_unusual_fold_shows_its_method() -> None:
    for preset, world, words in (
        ("default", "floating", ""),
        ("direct", "floating", "joints turned directly"),
        ("paper", "floating", "method from the paper"),
        ("default", "table", "on a table"),
    ):
        assert method_of(preset, world) == words
