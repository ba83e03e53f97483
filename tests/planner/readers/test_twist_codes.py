"""Codes of Rubik's snakes and snake cubes: notations, ambiguous texts and other pitfalls."""

import random
from pathlib import Path

import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.readers import read
from foldback.planner.readers.twist_codes import (
    CUBE_NOTATIONS,
    EXAMPLES,
    MAX_CODE_CHARACTERS,
    SNAKE_NOTATIONS,
    Family,
    is_twist_code,
    read_twist_code,
)
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.figures import known_snake_cubes, snake_figures
from foldback.planner.twist_chains.snake_code import SnakeCode
from tests.case import case
from tests.refusal import refused

BALL = "11331311313311331311313"
CAT = "02202201022022022000000"
WOODEN = "001010101111010111011011100"


def snake(text: str) -> str:
    code = read_twist_code(text, "snake")
    assert isinstance(code, SnakeCode)
    return code.text()


def cubes(text: str) -> str:
    sequence = read_twist_code(text, "snake-cube")
    assert isinstance(sequence, CubeSequence)
    return sequence.text()


def test_all_notations_of_the_known_figures() -> None:
    for figure in snake_figures():
        with case(figure.name):
            for image in (figure.code, figure.code.mirrored(), figure.code.from_other_end()):
                for name in SNAKE_NOTATIONS:
                    assert read_twist_code(f"{name}: {image.text(name)}") == image
                assert read_twist_code(image.text("wolter")) == image
                assert read_twist_code(image.text()) == image


def test_all_notations_of_the_known_cubes() -> None:
    for puzzle in known_snake_cubes():
        with case(puzzle.names):
            for sequence in (puzzle.sequence, puzzle.sequence.from_other_end()):
                for name in CUBE_NOTATIONS:
                    assert read_twist_code(f"{name}: {sequence.text(name)}") == sequence
                    assert read_twist_code(sequence.text(name), "snake-cube") == sequence


def test_a_list_of_wolter_counts_quarter_turns_on_the_left_the_other_way() -> None:
    """The cat, as encyclopedias state it in both notations."""
    cat = "9R2-9L2-8L2-7R2-6R2-6L2-5L3-4L2-3R2-2R2-2L2"
    assert snake(cat) == CAT
    assert snake(cat.replace("-", ", ").lower()) == CAT
    assert snake(cat.replace("-", "")) == CAT
    assert snake("5L3")[7] == "1"
    assert snake("5R3")[8] == "3"
    assert snake("5L1")[7] == "3"
    assert snake("wolter: 1R0") == "0" * 23


def test_a_list_of_wolter_for_longer_snakes() -> None:
    assert len(snake("18R1")) == 35
    assert len(snake("60 prisms: 18R1")) == 59
    assert len(snake("25 prisms wolter: 13L2")) == 24


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1L2", "1R, 2L, 2R … to 12R"),
        ("24 prisms: 13L1", "no such joint"),
        ("3R1 3R2", "an earlier step"),
        ("wolter: 3R4", "0 to 3 quarter turns"),
        ("0R1", "no such joint"),
    ],
)
def test_wrong_steps_are_refused(text: str, words: str) -> None:
    with refused("bad-code", match=words):
        read_twist_code(text, "snake")


def test_the_two_alphabets() -> None:
    assert snake("DLURD") == "01230"
    assert snake("d l u r d") == "01230"
    assert snake("ZRPLZ") == "01230"
    assert snake("ZERO, RIGHT, PIN, LEFT") == "0123"
    assert snake("fiore: LRLLR") == "13113"
    assert snake("glsnake: LRLLR") == "31331"
    with refused("ambiguous-code", match="fiore:, glsnake:"):
        read_twist_code("LRLLR")
    with refused("bad-code"):
        read_twist_code("DLPZ")
    with refused("bad-code", match="only D, L, U and R"):
        read_twist_code("fiore: DLZ")


def test_the_digit_that_closes_a_figure() -> None:
    assert snake(f"{BALL}(3)") == BALL
    assert snake(f"{BALL} [3]") == BALL
    for last in "0123":  # without a meaning
        assert snake(BALL + last) == BALL
    assert len(snake("0" * 36)) == 35
    assert len(snake("25 prisms: " + "0" * 24)) == 24
    assert len(snake("24 prisms: " + "0" * 24)) == 23
    assert snake("131012103130321(2)") == "131012103130321"
    for text in (f"{BALL}(1)", f"{CAT}(0)"):
        with refused("closing-digit"):
            read_twist_code(text)
    with refused("wrong-count"):
        read_twist_code("26 prisms: " + "0" * 24)


def test_any_length_of_a_snake() -> None:
    for digits in ("0", "12", "0" * 21, "0" * 22, "01" * 17, "0" * 59, "0" * 71, "0" * 999):
        assert snake(f"digits: {digits}") == digits
    assert snake("0132 0132\n0132") == "013201320132"
    assert snake("0,1,3,2,0,1") == "013201"


def test_a_figure_whose_prisms_overlap_is_refused_with_their_numbers() -> None:
    with pytest.raises(InputError) as refusal:
        read_twist_code("002222")
    assert (refusal.value.code, refusal.value.values) == ("overlap", {"modules": [1, 5]})
    assert "prisms 2 and 6 would lie in one another" in refusal.value.message


def test_lists_of_runs_and_legs_are_told_apart_by_their_sums() -> None:
    assert cubes("3,1,1,2,1,2,1,1,2,2,1,1,1,2,2,2,2") == WOODEN[::-1]
    assert cubes("3,2,2,3,2,3,2,2,3,3,2,2,2,3,3,3,3") == WOODEN[::-1]
    assert cubes("[2,1,1,2,1,2,1,1,2,2,1,1,1,2,2,2,2]") == WOODEN[::-1]
    assert cubes("legs: 3 3") == "0001000"
    assert cubes("runs: 3 3") == "00100"
    assert cubes("run-and-legs: 3 3") == "001000"
    with refused("ambiguous-code", match="runs:, legs:, run-and-legs:"):
        read_twist_code("3 3", "snake-cube")
    for text in ("runs: 3,1", "legs: 0,2", "runs: a", "cube: 012", "letters: EXE", "runs:"):
        with case(text), refused("bad-code"):
            read_twist_code(text)


def test_letters_and_digits_of_cubes() -> None:
    assert cubes("ESCCSCE") == cubes("sscCSCS") == cubes("0011010") == "0011010"
    for text in ("1010", "0101", "letters: CSS"):
        with case(text), refused("corner-at-end"):
            read_twist_code(text, "snake-cube")


def test_texts_that_may_be_a_snake_or_a_cube_are_refused() -> None:
    with refused("ambiguous-code", match="digits:, cube:"):
        read_twist_code(WOODEN)
    with refused("ambiguous-code", match="digits:, run-and-legs:"):
        read_twist_code("3,1,1,2,1,2,1,1,2,2,1,1,1,2,2,2,2")
    assert read_twist_code("0110") == SnakeCode((0, 1, 1, 0))


def test_a_notation_of_the_other_family_is_refused() -> None:
    families: tuple[tuple[str, Family], ...] = (("cube: 010", "snake"), ("digits: 1", "snake-cube"))
    for text, family in families:
        with case(text), refused("bad-code", match="expected one of"):
            read_twist_code(text, family)
    with refused("bad-code", match="expected one of"):
        read_twist_code("morse: 010")


def test_examples_of_all_notations_can_be_read() -> None:
    assert set(EXAMPLES) == {*SNAKE_NOTATIONS, *CUBE_NOTATIONS}
    for example in EXAMPLES.values():
        with case(example):
            assert is_twist_code(example)
            read_twist_code(example)


@pytest.mark.parametrize(
    ("text", "is_code"),
    [
        ("0123012301", True),
        ("0, 1, 2, 3, 0", True),
        ("0\n1\n2\n3\n0\n", True),
        ("9R2-9L2", True),
        ("LRLLR", True),
        (WOODEN, True),
        ("0 0 0\n1 0 0\n1 1 0\n", False),
        ("0,0,0\n1,0,0\n", False),
        ("0 0 0 1\n1 0 0 1\n", False),
        ("1 2 3", False),
        ("0 1 0 1 1\n0 1 1 1 1", False),
        ("0 - - + 0", False),
        ("0.0 1.0 2.0 3.0 1.0", False),
        ("0, 90, -90.0, 180, 0, 90", False),
        ("hello", False),
        ("x,y,z", False),
        ("", False),
        (" \n ", False),
    ],
)
def test_lists_of_cells_and_prose_are_no_codes(text: str, is_code: bool) -> None:
    assert is_twist_code(text) == is_code


def test_no_text_breaks_the_reader() -> None:
    random_texts = random.Random(1)
    for _ in range(2000):
        text = "".join(
            random_texts.choices("01234LRSCE:-,([) \nprisms", k=random_texts.randint(0, 12))
        )
        with case(text):
            try:
                read_twist_code(text)
            except Exception as error:
                assert type(error).__name__ == "InputError"
            is_twist_code(text)
    with refused("too-many-cells"):
        read_twist_code("0" * (MAX_CODE_CHARACTERS + 1))
    with refused("too-many-cells"):
        read_twist_code("legs: 999999, 999999")
    with refused("too-many-cells"):
        read_twist_code("999999R1")


def test_files_with_codes() -> None:
    for data, prisms in (
        ((Path(__file__).parent / "data" / "k11_snake_digits.txt").read_bytes(), 11),
        (BALL.encode(), 24),
        (b"\xef\xbb\xbfDLUR\r\nDLURD", 10),
        (b"wolter: 2L1", 24),
        (b"snake:Ball", 24),
        (b"snake:0132", 5),
    ):
        with case(data):
            snake_chain = read(data)
            assert isinstance(snake_chain, Chain)
            assert (snake_chain.module.name, len(snake_chain)) == ("snake-prism", prisms)
    named = read(BALL.encode())
    assert isinstance(named, Chain)
    assert named.name == "Ball"
    assert read(b"cube: " + WOODEN.encode()) == read_twist_code(WOODEN, "snake-cube")
    assert read(b"snake-cube:" + WOODEN.encode()) == read_twist_code(WOODEN, "snake-cube")
    with refused("ambiguous-code"):
        read(WOODEN.encode())
    with refused("bad-code"):
        read(b"snake:Bull")
    with refused("too-many-cells"):
        read(b"digits: 0000000000", max_cells=10)
