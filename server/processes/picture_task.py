"""Picture task: what a child does that draws the social picture of a fold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from planner.errors import InputError
from planner.motion.timeline import chain_from_attributes
from server.processes.scratch import CHAIN, PICTURE
from web.pictures.social_picture import social_picture


def warm_up() -> None:
    """Draw a small picture, so that the kernels that it takes are compiled."""
    social_picture(Chain.from_path(CellPath.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0)])))


def draw(directory: Path) -> dict[str, Any]:
    """Write the picture of the chain in a directory beside it.

    Raises:
        InputError: When the file holds no chain.
    """
    try:
        chain = chain_from_attributes(json.loads((directory / CHAIN).read_bytes()))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError("not-a-chain", f"{CHAIN}: got {error!r}, expected a chain.") from error
    (directory / PICTURE).write_bytes(social_picture(chain))
    return {}
