"""Readers: from the bytes of a file to a path or a chain.

The content decides which reader takes a file; its name is only used to name the shape.
"""

from __future__ import annotations

from typing import Final

from planner.chain import Chain
from planner.errors import InputError
from planner.paths import Path
from planner.readers.csv_cells import is_csv, read_csv
from planner.readers.json_files import is_json, read_json
from planner.readers.kinds import refuse_other_kinds
from planner.readers.limits import MOST_CELLS, Source, check_size, clean_name
from planner.readers.npy import is_npy, read_npy
from planner.readers.text import decode, refuse_prose
from planner.readers.xyz import read_xyz

FORMATS: Final = (
    "foldback-path/1 or foldback-chain/1 JSON, a bare JSON list, CSV, XYZ or .npy (N, 3)"
)


def read(data: bytes, *, filename: str | None = None, most_cells: int = MOST_CELLS) -> Path | Chain:
    """Reads a path or a chain from a file's bytes.

    Args:
        data: The whole file.
        filename: What the file was called; names the shape where the file itself does not.
        most_cells: Larger files are refused before much memory is spent on them.

    Returns:
        A ``Path`` for lists of cells, a ``Chain`` for ``foldback-chain/1``.

    Raises:
        InputError: Saying what was found, where, what was expected and what to do.
    """
    source = Source(name=clean_name(_stem(filename)), most_cells=most_cells)
    check_size(data, most_cells)
    if is_npy(data):
        return read_npy(data, source)
    refuse_other_kinds(data, FORMATS)
    text = decode(data, FORMATS)
    if not text.strip():
        raise InputError("empty", f"got a file of nothing but white space, expected {FORMATS}.")
    if is_json(text):
        return read_json(text, source)
    refuse_prose(text, FORMATS)
    if is_csv(text):
        return read_csv(text, source)
    return read_xyz(text, source)


def _stem(filename: str | None) -> str:
    base = (filename or "").replace("\\", "/").rpartition("/")[2]
    stem, dot, _ = base.rpartition(".")
    return stem if dot and stem else base


__all__ = ["FORMATS", "MOST_CELLS", "read"]
