"""Known figures of the Rubik's snake and known snake cubes, by name; `figures.json` states both."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Any

from foldback.planner.errors import InputError
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.snake_code import SnakeCode


@dataclass(frozen=True, slots=True, kw_only=True)
class SnakeFigure:
    """A figure of the Rubik's snake that collections name.

    Attributes:
        name: Name in a collection; others may use it for another figure.
        code: The figure.
        closed: True if its ends meet.
        cells: Numbers of cells along the sides of the smallest box around it.
        sources: Repositories with collections in which it stands.
    """

    name: str
    code: SnakeCode
    closed: bool
    cells: tuple[int, int, int]
    sources: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownSnakeCube:
    """A snake cube that is sold or described.

    Attributes:
        names: Names of those who sell or describe it.
        sequence: Its pieces.
        side: Side of the cube that it folds into, in pieces.
        solutions: Number of ways to fold it so, up to rotations and mirror images.
    """

    names: tuple[str, ...]
    sequence: CubeSequence
    side: int
    solutions: int


@cache
def snake_figures() -> tuple[SnakeFigure, ...]:
    """Return the known figures of the Rubik's snake, in the order of the file; read once."""
    return tuple(
        SnakeFigure(
            name=row["name"],
            code=SnakeCode(tuple(map(int, row["code"]))),
            closed=row["closed"],
            cells=tuple(row["cells"]),
            sources=tuple(row["sources"]),
        )
        for row in _data()["figures"]
    )


@cache
def known_snake_cubes() -> tuple[KnownSnakeCube, ...]:
    """Return the known snake cubes, in the order of the file; read once."""
    return tuple(
        KnownSnakeCube(
            names=tuple(row["names"]),
            sequence=CubeSequence(tuple(digit == "1" for digit in row["sequence"])),
            side=row["side"],
            solutions=row["solutions"],
        )
        for row in _data()["cubes"]
    )


def snake_figure(name: str) -> SnakeFigure | None:
    """Return the figure of a name, in which case, spaces, _ and - do not matter; None if unknown.

    Raises:
        InputError: ``several-figures``, with their codes, if several have it.
    """
    matches = [figure for figure in snake_figures() if _plain(figure.name) == _plain(name)]
    if len(matches) > 1:
        codes = " or ".join(figure.code.text() for figure in matches)
        raise InputError(
            "several-figures", f"got {name!r}, the name of several figures; use the code {codes}."
        )
    return matches[0] if matches else None


def known_snake_cube(name: str) -> KnownSnakeCube | None:
    """Return the snake cube of a name, in which case, spaces, _ and - do not matter, or None."""
    for puzzle in known_snake_cubes():
        if _plain(name) in map(_plain, puzzle.names):
            return puzzle
    return None


def names_of(code: SnakeCode) -> tuple[str, ...]:
    """Return names of a figure, read from either end; of its mirror image too."""
    mirrored = code.mirrored()
    same = {code, mirrored, code.from_other_end(), mirrored.from_other_end()}
    return tuple(figure.name for figure in snake_figures() if figure.code in same)


def cube_names_of(sequence: CubeSequence) -> tuple[str, ...]:
    """Return names of a snake cube, read from either end."""
    same = (sequence, sequence.from_other_end())
    return tuple(
        name for puzzle in known_snake_cubes() if puzzle.sequence in same for name in puzzle.names
    )


def nearest_names(name: str) -> tuple[str, ...]:
    """Return up to four names of figures and snake cubes that are similar to a name."""
    names = [f.name for f in snake_figures()] + [n for c in known_snake_cubes() for n in c.names]
    plain = {_plain(known_name): known_name for known_name in names}
    return tuple(plain[match] for match in get_close_matches(_plain(name), plain, n=4, cutoff=0.5))


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]+", "", name).lower()


@cache
def _data() -> dict[str, Any]:
    return json.loads(files("foldback.planner.twist_chains").joinpath("figures.json").read_bytes())
