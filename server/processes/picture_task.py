"""Picture task: draws the social picture of a fold in a child process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.errors import InputError
from foldback.planner.storage.file_names import CHAIN
from foldback.server.processes.scratch import MOMENT_FILE, PICTURE
from foldback.web.pictures.caption import Caption
from foldback.web.pictures.picture_view import PictureView
from foldback.web.pictures.social_picture import FOLDED_VIEW, Moment, social_picture


def draw(directory: Path) -> dict[str, Any]:
    """Draw the chain in a directory and write the picture to the same directory.

    Raises:
        InputError: If the file contains no chain.
    """
    try:
        chain = chain_from_attributes(json.loads((directory / CHAIN).read_bytes()))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError("not-a-chain", f"{CHAIN}: got {error!r}, expected a chain.") from error
    (directory / PICTURE).write_bytes(_picture(chain, directory / MOMENT_FILE))
    return {}


def _picture(chain: Chain, path: Path) -> bytes:
    """Return the picture of a chain, with the options of ``server.files.pictures.moment_of``."""
    if not path.exists():
        return social_picture(chain)
    request = json.loads(path.read_bytes())
    frame = request["frame"]
    moment = None
    if frame is not None:
        errors = np.array(frame["errors_rad"], dtype=np.float64)  # None becomes NaN
        poses = chain.poses(
            np.array(frame["angles_rad"]), np.array(frame["position"]), np.array(frame["wxyz"])
        )
        moment = Moment(poses=poses, errors_rad=errors, error_scale_rad=frame["scale_rad"])
    return social_picture(
        chain,
        caption=Caption(**request["caption"]),
        view=PictureView.from_short(request["view"] or "") or FOLDED_VIEW,
        moment=moment,
    )
