"""Codes of folded snakes and snake cubes as text, in all notations; the first line can be read."""

from __future__ import annotations

from foldback.planner.errors import InputError
from foldback.planner.plan.plan import Plan
from foldback.planner.twist_chains.cube_sequence import NOTATIONS as CUBE_NOTATIONS
from foldback.planner.twist_chains.figures import cube_names_of, names_of
from foldback.planner.twist_chains.folded_chains import (
    cube_sequence_of,
    quarters_of,
    snake_code_of,
)
from foldback.planner.twist_chains.prism_lattice import closing_digit
from foldback.planner.twist_chains.snake_code import NOTATIONS as SNAKE_NOTATIONS
from foldback.planner.twist_chains.snake_code import SnakeCode


def write(plan: Plan) -> bytes:
    """Return the code of a plan's folded shape.

    Raises:
        InputError: ``no-code`` if the plan is not one of a Rubik's snake or a snake cube.
    """
    code = snake_code_of(plan.chain)
    if code is not None:
        return _text(_snake_lines(code))
    sequence = cube_sequence_of(plan.chain)
    if sequence is None:
        raise InputError(
            "no-code",
            "this plan has no code, because only Rubik's snakes and snake cubes that are folded by "
            "quarter turns have one; use another format.",
        )
    lines = {name: sequence.text(name) for name in CUBE_NOTATIONS}
    lines["pieces"] = str(len(sequence))
    if names := cube_names_of(sequence):
        lines["known as"] = ", ".join(names)
    if (quarters := quarters_of(plan.chain)) is not None:
        lines["quarter turns from the zigzag"] = " ".join(map(str, quarters % 4))
    return _text(lines)


def _snake_lines(code: SnakeCode) -> dict[str, str]:
    closing, names = closing_digit(code), names_of(code)
    end = "" if closing is None else f"({closing})"
    return {
        "digits": code.text() + end,
        **{name: code.text(name) for name in SNAKE_NOTATIONS[1:]},
        "mirror image": code.mirrored().text() + end.translate(str.maketrans("13", "31")),
        "from the other end": code.from_other_end().text() + end,
        "prisms": str(code.prisms),
        **({"known as": ", ".join(names)} if names else {}),
    }


def _text(lines: dict[str, str]) -> bytes:
    return "".join(f"{name}: {value}\n" for name, value in lines.items()).encode()
