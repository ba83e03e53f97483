"""Names of known figures and snake cubes."""

from foldback.planner.twist_chains.cube_sequence import CubeSequence, sequence_of_legs
from foldback.planner.twist_chains.figures import (
    known_snake_cube,
    known_snake_cubes,
    names_of,
    nearest_names,
    snake_figure,
    snake_figures,
)
from foldback.planner.twist_chains.snake_code import SnakeCode
from tests.case import case
from tests.refusal import refused


def test_sixty_figures_and_five_cubes_have_sources() -> None:
    assert len(snake_figures()) == 60
    assert all(figure.sources and figure.code.prisms == 24 for figure in snake_figures())
    assert [len(puzzle.sequence) for puzzle in known_snake_cubes()] == [27] * 5


def test_names_are_found_as_people_write_them() -> None:
    for name, stored in (("ball", "Ball"), ("Candle_Stick", "Candle Stick"), ("tri-1", "tri1")):
        with case(name):
            figure = snake_figure(name)
            assert figure is not None
            assert figure.name == stored
    assert snake_figure("no such figure") is None
    puzzle = known_snake_cube("cubra blue")
    assert puzzle is not None
    assert "skolicki" in puzzle.names
    assert known_snake_cube("Ball") is None
    assert "Snowman" in nearest_names("snow man 2")


def test_codes_decide_which_figure_it_is() -> None:
    ball = SnakeCode(tuple(map(int, "11331311313311331311313")))
    for image in (ball, ball.mirrored(), ball.from_other_end()):
        assert names_of(image) == ("Ball",)
    assert names_of(SnakeCode((0,) * 23)) == ()
    dogs = [snake_figure(name) for name in ("dog", "Dog1")]
    assert dogs[0] != dogs[1]


def test_sequences_and_their_legs() -> None:
    for puzzle in known_snake_cubes():
        with case(puzzle.names):
            sequence = puzzle.sequence
            assert sum(sequence.legs) == len(sequence) - 1
            assert sequence_of_legs(sequence.legs) == sequence
            assert sequence.from_other_end().from_other_end() == sequence
            assert sequence.corner_count == len(sequence.legs) - 1
    assert CubeSequence((False, False)).legs == (1,)
    with refused("corner-at-end"):
        CubeSequence((False, True))
    with refused("wrong-count"):
        CubeSequence((False,))
    with refused("bad-digit"):
        SnakeCode((0, 4))
    with refused("wrong-count"):
        SnakeCode(())
