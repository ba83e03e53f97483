"""Limits that every reader keeps, and what readers say of what they found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from planner.errors import InputError
from planner.shapes.solid import MOST_TRIANGLES

MOST_CELLS: Final = 200_000
MOST_BYTES: Final = 64 << 20
BYTES_A_CELL: Final = 96
SPARE_BYTES: Final = 65_536
LONGEST_QUOTE: Final = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """What a reader is told of the file besides its content.

    Attributes:
        name: What to call the shape when the file does not say; may be empty.
        most_cells: More cells, or modules, are refused.
        most_triangles: More triangles are refused.
        as_voxels: Lists of cells are voxels in no order.
    """

    name: str
    most_cells: int = MOST_CELLS
    most_triangles: int = MOST_TRIANGLES
    as_voxels: bool = False


def quote(found: object) -> str:
    """What was found, short enough and clean enough for a message."""
    text = found if isinstance(found, str) else repr(found)
    shown = "".join(c if c.isprintable() else "·" for c in text[: LONGEST_QUOTE + 1])
    return f"{shown[:LONGEST_QUOTE]}…" if len(text) > LONGEST_QUOTE else shown


def megabytes(count: int) -> str:
    """A size of a file in words, as people read it elsewhere."""
    return f"{count / 2**20:.3g} MB" if count >= 2**17 else f"{count} bytes"


def check_bytes(data: bytes, most_bytes: int) -> None:
    """Refuses empty files and those of more bytes than any kind may have.

    Raises:
        InputError: ``empty`` or ``too-large``.
    """
    if not data:
        raise InputError("empty", "got an empty file, expected cells or joint angles, or a mesh.")
    if len(data) > most_bytes:
        raise InputError(
            "too-large",
            f"got {megabytes(len(data))}, expected at most {megabytes(most_bytes)}; simplify the "
            "model.",
        )


def check_size(data: bytes, most_cells: int) -> None:
    """Refuses files too large to hold ``most_cells`` cells.

    Raises:
        InputError: ``too-large``.
    """
    most = SPARE_BYTES + BYTES_A_CELL * most_cells
    if len(data) > most:
        raise InputError(
            "too-large",
            f"got {megabytes(len(data))}, expected at most {megabytes(most)}, enough for "
            f"{most_cells} cells.",
        )


def too_many(found: int, most: int, what: str = "cells") -> InputError:
    """The refusal of more cells than the limit."""
    return InputError(
        "too-many-cells",
        f"got {found} {what}, expected at most {most}; use a coarser shape.",
    )
