"""Writers of the shape files that people exchange. ``planner.readers`` reads the files back."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from foldback.planner.chain.built_in_modules import module_value
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.readers.json_formats import CHAIN_FORMAT, PATH_FORMAT, VOXELS_FORMAT
from foldback.planner.shapes.shape import Shape

ROWS_PER_LINE = 8
"""Number of cells or joint angles on one line of an exported JSON file of a path, shape or chain,
so that people can read and edit it."""


def write_path(path: Path, *, title: str | None = None) -> bytes:
    """Return a path as ``foldback-path/1``.

    Args:
        path: Path to write.
        title: A longer name for people, which readers leave alone.
    """
    head: dict[str, object] = {"format": PATH_FORMAT, "name": path.name}
    if title is not None:
        head["title"] = title
    head["pitch_m"] = path.pitch_m
    return _document(head, "cells", path.cells.tolist())


def write_chain(
    chain: Chain, *, title: str | None = None, tags: Sequence[str] | None = None
) -> bytes:
    """Return the folded configuration of a chain as ``foldback-chain/1``.

    Args:
        chain: Chain to write.
        title: A longer name for people, which readers leave alone.
        tags: Kinds of shapes that it belongs to; readers ignore them as well.
    """
    head: dict[str, object] = {"format": CHAIN_FORMAT, "name": chain.name}
    if title is not None:
        head["title"] = title
    if tags is not None:
        head["tags"] = list(tags)
    head["module"] = module_value(chain.module)
    head["pitch_m"] = chain.pitch_m
    head["first_position"] = chain.folded_position.tolist()
    head["first_wxyz"] = chain.folded_wxyz.tolist()
    angles = np.rad2deg(chain.folded_rad)
    rounded = np.round(angles)
    # Right angles are written as 90, not as what is left of them after two roundings.
    angles = np.where(np.deg2rad(rounded) == chain.folded_rad, rounded, angles) + 0.0
    hinges = chain.module.hinges_per_joint
    rows: list[object] = [
        row if hinges > 1 else row[0] for row in angles.reshape(-1, hinges).tolist()
    ]
    return _document(head, "joint_angles_deg", rows)


def write_shape(shape: Shape) -> bytes:
    """Return a shape as ``foldback-voxels/1``."""
    head: dict[str, object] = {
        "format": VOXELS_FORMAT,
        "name": shape.name,
        "pitch_m": shape.pitch_m,
    }
    return _document(head, "cells", shape.cells.tolist())


def _document(head: dict[str, object], key: str, rows: Sequence[object]) -> bytes:
    lines = [
        ", ".join(json.dumps(row, separators=(",", ":")) for row in rows[i : i + ROWS_PER_LINE])
        for i in range(0, len(rows), ROWS_PER_LINE)
    ]
    fields = [f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in head.items()]
    fields.append(f"  {json.dumps(key)}: [\n    " + ",\n    ".join(lines) + "\n  ]")
    return ("{\n" + ",\n".join(fields) + "\n}\n").encode()
