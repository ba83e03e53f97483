"""``foldback-path/1`` and bare lists of cells."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from foldback.planner.chain.path import DEFAULT_PITCH_M, Path
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, described, too_many
from foldback.planner.readers.strict_json import name_field, pitch_field, refuse_unread_keys
from foldback.planner.readers.text import path_or_shape
from foldback.planner.shapes.shape import Shape

PATH_KEYS: Final = ("format", "name", "cells", "pitch_m")


def read_path(document: dict[str, Any], source: Source) -> Path | Shape:
    """Return a path from a ``foldback-path/1`` object.

    Raises:
        InputError: The input is invalid; names the key or the cell.
    """
    refuse_unread_keys(document, PATH_KEYS)
    rows = document.get("cells")
    if not isinstance(rows, list):
        value = "nothing" if "cells" not in document else described(rows)
        raise InputError("wrong-type", f"got {value}, expected a list of [x, y, z].", where="cells")
    return path_from_rows(
        cast("list[Any]", rows),
        source,
        name=name_field(document),
        pitch_m=pitch_field(document),
        field="cells",
    )


def read_voxels(document: dict[str, Any], source: Source) -> Shape:
    """Return a shape from a ``foldback-voxels/1`` object.

    Raises:
        InputError: The input is invalid; names the key or the cell.
    """
    shape = read_path(document, replace(source, as_voxels=True))
    assert isinstance(shape, Shape)
    return shape


def path_from_rows(
    rows: list[Any], source: Source, *, name: str, field: str, pitch_m: float = DEFAULT_PITCH_M
) -> Path | Shape:
    """Return a path from parsed JSON rows, or a shape if ``source.as_voxels`` is set.

    Raises:
        InputError: The input is invalid; names the cell.
    """
    if len(rows) > source.max_cells:
        raise too_many(len(rows), source.max_cells)
    if not rows:
        raise InputError(
            "empty",
            f"got no cells, expected at least {'one' if source.as_voxels else 'three'}.",
            where=field,
        )
    for index, row in enumerate(rows):
        if not isinstance(row, list) or len(cast("list[Any]", row)) != 3:
            raise InputError(
                "wrong-count",
                "got {got}, expected [x, y, z].",
                where="cell {cells}",
                got=described(cast("object", row)),
                cells=index,
            )
        for value, axis in zip(cast("list[Any]", row), "xyz", strict=True):
            if type(value) is not int and type(value) is not float:
                raise InputError(
                    "not-a-number",
                    "got {got} for {axis}, expected a whole number"
                    f"{' without quotation marks' if isinstance(value, str) else ''}.",
                    where="cell {cells}",
                    got=described(value),
                    axis=axis,
                    cells=index,
                )
    return path_or_shape(np.array(rows, dtype=np.float64), source, name=name, pitch_m=pitch_m)
