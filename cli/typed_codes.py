"""Codes and names of Rubik's snakes and snake cubes as arguments of commands."""

from __future__ import annotations

from typing import Annotated

import typer

from foldback.planner.errors import InputError
from foldback.planner.readers.twist_codes import (
    CUBE_NOTATIONS,
    SNAKE_NOTATIONS,
    is_twist_code,
    read_twist_code,
)
from foldback.planner.readers.word_text import PREFIX, is_word
from foldback.planner.silhouettes.word import MAX_LETTERS
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.figures import (
    known_snake_cube,
    known_snake_cubes,
    names_of,
    nearest_names,
    snake_figure,
    snake_figures,
)
from foldback.planner.twist_chains.snake_code import SnakeCode

Snake = Annotated[
    str | None,
    typer.Option(
        metavar="CODE",
        help="Instead of INPUT, a figure of a Rubik's snake: a digit for each joint (0 straight, 1 "
        "and 3 quarter turns, 2 a half turn), its code in another notation with a name before it "
        f"({', '.join(f'{name}:' for name in SNAKE_NOTATIONS)}), or the name of a known figure.",
    ),
]
SnakeCube = Annotated[
    str | None,
    typer.Option(
        metavar="PIECES",
        help="Instead of INPUT, a snake cube to be folded into a cube: a digit for each piece (1 "
        "corner, 0 straight or end), a list of runs, another notation with a name before it "
        f"({', '.join(f'{name}:' for name in CUBE_NOTATIONS)}), or the name of a known one.",
    ),
]

TypedWord = Annotated[
    str | None,
    typer.Option(
        "--word",
        metavar="LETTERS",
        help=f"Instead of INPUT, a word of up to {MAX_LETTERS} letters, folded as block letters.",
    ),
]


def typed_code(text: str) -> tuple[bytes, str] | None:
    """Return the bytes and name of a file for a code or name; None if a text is neither.

    Raises:
        InputError: ``several-figures``.
    """
    if snake_figure(text) is not None:
        return typed_snake(text)
    if known_snake_cube(text) is not None:
        return typed_snake_cube(text)
    return (text.encode(), "") if is_word(text) or is_twist_code(text) else None


def typed_word(text: str) -> tuple[bytes, str]:
    """Return the bytes and name of a file with a word that was typed."""
    return f"{PREFIX}{text}".encode(), "word.txt"


def typed_snake(text: str) -> tuple[bytes, str]:
    """Return the bytes and name of a file with the code of a figure that was typed or named.

    Raises:
        InputError: If it is neither a code nor a name.
    """
    figure = snake_figure(text)
    if figure is not None:
        code, name = figure.code, figure.name
    else:
        code = _code(text, "snake")
        assert isinstance(code, SnakeCode)
        name = next(iter(names_of(code)), "snake")
    return f"{code.prisms} prisms digits: {code.text()}".encode(), f"{name}.txt"


def typed_snake_cube(text: str) -> tuple[bytes, str]:
    """Return the bytes and name of a file with the pieces of a snake cube, typed or named.

    Raises:
        InputError: If they are neither a sequence nor a name.
    """
    return f"cube: {typed_sequence(text).text()}".encode(), "snake cube.txt"


def typed_sequence(text: str) -> CubeSequence:
    """Return the pieces of a snake cube that were typed or named.

    Raises:
        InputError: If they are neither a sequence nor a name.
    """
    puzzle = known_snake_cube(text)
    if puzzle is not None:
        return puzzle.sequence
    sequence = _code(text, "snake-cube")
    assert isinstance(sequence, CubeSequence)
    return sequence


def _code(text: str, family: str) -> SnakeCode | CubeSequence:
    try:
        return read_twist_code(text, "snake" if family == "snake" else "snake-cube")
    except InputError as error:
        if error.code != "bad-code" or ":" in text:
            raise
        near = ", ".join(nearest_names(text))
        count = len(snake_figures()) if family == "snake" else len(known_snake_cubes())
        raise error.changed(
            f"{error.template.removesuffix('.')}, or the name of one of {count} known ones"
            f"{f', such as {near}' if near else ''}."
        ) from None
