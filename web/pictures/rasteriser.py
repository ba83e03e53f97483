"""Rasteriser: draws triangles into a picture without OpenGL, the nearest one at each pixel."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
    _draw(picture, nearness, corners.astype(np.float32), colours.astype(np.float32))


@njit(cache=True)
def _draw(picture, nearness, corners, colours):  # pyright: ignore
    height, width = nearness.shape
    for t in range(corners.shape[0]):
        ax, ay, bx, by, cx, cy = (
            corners[t, 0, 0],
            corners[t, 0, 1],
            corners[t, 1, 0],
            corners[t, 1, 1],
            corners[t, 2, 0],
            corners[t, 2, 1],
        )
        # Rows count downwards, so the area of a counterclockwise triangle is negative.
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= 0.0:
            continue
        near = 1.0 / corners[t, :, 2]  # unlike depth, it is linear across a picture
        x0, right = max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 1, width)
        top, bottom = max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, height)
        for row in range(top, bottom):
            y = row + 0.5
            for column in range(x0, right):
                x = column + 0.5
                a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                c = 1.0 - a - b
                if a < 0.0 or b < 0.0 or c < 0.0:
                    continue
                depth = a * near[0] + b * near[1] + c * near[2]
                if depth > nearness[row, column]:
                    nearness[row, column] = depth
                    for k in range(3):
                        value = a * colours[t, 0, k] + b * colours[t, 1, k] + c * colours[t, 2, k]
                        picture[row, column, k] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
