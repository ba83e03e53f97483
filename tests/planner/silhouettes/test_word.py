import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.readers import read
from foldback.planner.shapes.bridges import parts_of
from foldback.planner.silhouettes.word import Word


def rows_of(word: str) -> list[str]:
    return ["".join("#" if cell else "." for cell in row) for row in Word.of(word).drawing]


def test_letters_stand_on_a_bar_with_one_foot_each() -> None:
    assert rows_of("in") == [
        "###.#...#",
        ".#..##..#",
        ".#..###.#",
        ".#..#.###",
        "###.#..##",
        ".#..#....",
        "#########",
    ]


def test_hebrew_is_drawn_from_right_to_left() -> None:
    # Read from the right: shin, vav.
    assert rows_of("שו")[:5] == ["##.#.#.#", ".#.#.#.#", ".#.#.#.#", ".#.#.#.#", ".#.#####"]


@pytest.mark.parametrize("word", ["Ä", "Σοφία", "Мария", "I♥U?", "Größe", "שלום", "O'Neil 2"])
def test_word_has_a_path_in_each_script(word: str) -> None:
    preparation = prepare(f"word:{word}".encode(), "word.txt")
    assert preparation.kind == "word"
    assert preparation.name == word.upper()
    assert len(preparation.chain) % 8 == 0
    assert np.ptp(preparation.cells[:, 1]) == 1  # two modules thick
    assert len(parts_of(Word.of(word).drawing)[1]) <= len(word) + 1


def test_thickness_multiplies_the_modules() -> None:
    thin = prepare(b"word: A", None, PathOptions())
    thick = prepare(b"word: A", None, PathOptions(thickness=2))
    assert len(thick.chain) == 2 * len(thin.chain)


@pytest.mark.parametrize(
    ("word", "code", "text"),
    [
        ("", "empty", "expected 1 to 12 letters"),
        ("abcdefghijklm", "too-long", "got 13 letters"),
        ("x" * 1_000_000, "too-long", "got 1000000 letters"),
        ("Aس", "unknown-letter", "arabic letter seen"),
        ("漢字", "unknown-letter", "make a picture of the word"),
        ("a\x01", "unknown-letter", "U+0001"),
        ("שA", "mixed-directions", "one direction"),
    ],
)
def test_word_that_cannot_be_drawn_is_refused(word: str, code: str, text: str) -> None:
    with pytest.raises(InputError) as refusal:
        read(f"word:{word}".encode())
    assert refusal.value.code == code
    assert text in refusal.value.detail
