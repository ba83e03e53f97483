"""Moving drawings of recorded motions."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from foldback.planner.readers.gallery import Gallery
from foldback.web.pictures.isometric_modules import projected
from foldback.web.pictures.moving_drawing import (
    MAX_FRAMES,
    MAX_POINTS,
    folding_svg,
    frames_of_motion,
)

SVG = "{http://www.w3.org/2000/svg}"


def points_in(line: str) -> np.ndarray:
    """Return the corners of a path of relative steps."""
    return np.cumsum(np.array(re.findall(r"-?\d+", line), dtype=float).reshape(-1, 2), axis=0)


def test_motion_ends_in_the_drawn_shape_however_the_chain_turned() -> None:
    shape = Gallery().shape("wrench-24")
    assert shape is not None
    chain = shape.chain
    folded = chain.folded_poses.positions
    straight = np.arange(len(chain))[:, None] * [1.0, 0.0, 0.0]
    turned = folded @ Rotation.from_euler("xyz", [40, -70, 130], degrees=True).as_matrix().T
    frames = [straight + share * (turned + 5 - straight) for share in np.linspace(0, 1, 60)]
    root = ElementTree.fromstring(folding_svg(chain, frames))
    animations = {one.get("attributeName"): one for one in root.iter(f"{SVG}animate")}
    pictures = animations["d"].get("values", "").split(";")
    assert len(pictures) <= MAX_FRAMES + 1
    at_rest = points_in(pictures[-1])
    assert np.abs(at_rest - projected(chain.module, folded)).max() <= 1.0
    assert np.ptp(points_in(pictures[0]), axis=0).max() > 2 * np.ptp(at_rest, axis=0).max()
    # All animations of a motion have a value for each of their times.
    for one in root.iter(f"{SVG}animate"):
        assert len(one.get("values", "").split(";")) == len(one.get("keyTimes", "").split(";"))
        assert re.fullmatch(r"0;.*;1", one.get("keyTimes", ""))


def test_long_chains_get_fewer_frames_or_no_moving_drawing() -> None:
    assert frames_of_motion(100, 10) == MAX_FRAMES
    assert frames_of_motion(100, 400) * 400 <= MAX_POINTS
    assert frames_of_motion(3, 10) == 3
    assert frames_of_motion(100, 1000) == 0
