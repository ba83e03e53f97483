"""Rasteriser: draws triangles into a picture without OpenGL, the nearest one at each pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foldback.planner import core

Floats = NDArray[np.float32]


def draw_triangles(picture: NDArray[np.uint8], corners: Floats, colours: Floats) -> None:
    """Draw triangles over a picture.

    Args:
        picture: (H, W, 3) sRGB bytes, changed in place.
        corners: (T, 3, 3) pixels from the left, pixels from the top, and depths. Triangles that are
            clockwise in the picture face away and are not drawn.
        colours: (T, 3, 3) sRGB values 0 to 255 at the corners.
    """
    nearness = np.zeros(picture.shape[:2], np.float32)
    core.draw_triangles(picture, nearness, corners.astype(np.float32), colours.astype(np.float32))
