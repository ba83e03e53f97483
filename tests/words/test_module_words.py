"""What modules are called that foldback does not ship: only their words are stored."""

from dataclasses import replace

from foldback.planner.certificate.figures import CertificateFigures
from foldback.planner.chain.built_in_modules import (
    CUBE,
    MODULE_NAMES,
    described_words,
    filling_named,
    module_named,
    words_named,
)
from foldback.planner.chain.module import ModuleWords
from foldback.planner.chain.module_file import with_pattern
from foldback.words.fold import ShownFold
from foldback.words.gallery import CHAIN_LABELS
from foldback.words.tour import draft_stops
from foldback.words.verdict import verdict_of

ROLLER = ModuleWords("roller", "rollers")
FOLD = ShownFold(
    id="",
    name="coil",
    status="verified",
    modules=8,
    preset="default",
    seed=0,
    module="roller-mk2",
    module_words={"singular": "roller", "plural": "rollers"},
    summary={"certificate": {"frames": 9, "verified": True}, "joints": 7},
)


def test_words_of_described_modules_are_stored_beside_their_name() -> None:
    for name in MODULE_NAMES:
        assert described_words(module_named(name)) is None
        assert words_named(name, None) == module_named(name).words
        assert filling_named(name) == module_named(name).filling
    described = replace(CUBE, name="roller-mk2", words=ROLLER)
    assert words_named("roller-mk2", described_words(described)) == ROLLER
    assert words_named("of-another-version", None).counted(2) == "2 modules"
    snake = with_pattern(module_named("snake-cube"), ["straight", "corner", "corner"])
    assert described_words(snake) is None


def test_pages_call_described_modules_by_their_words() -> None:
    certificate = CertificateFigures()
    assert FOLD.counted == "8 rollers" and replace(FOLD, modules=1).counted == "1 roller"
    verdict = verdict_of(FOLD, FOLD.summary, certificate, None)
    assert verdict["text"].endswith("8\N{NO-BREAK SPACE}rollers")
    captions = [draft.stop.caption for draft in draft_stops(FOLD, 9)]
    assert captions[0] == "The chain is straight: 8 rollers in a row, with 7 joints. Now it folds."


def test_labels_are_the_plurals_of_shipped_modules() -> None:
    assert list(CHAIN_LABELS) == list(MODULE_NAMES)
    assert CHAIN_LABELS["tetrahedron"] == "Tetrahedra"
