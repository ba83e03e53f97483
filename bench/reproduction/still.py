"""Still: a picture of modules at any positions, drawn without OpenGL.

The background is transparent, for light and dark pages.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.web.pictures.camera import AZIMUTH_RAD, ELEVATION_RAD, View, framing
from foldback.web.pictures.drawn_modules import SUPERSAMPLING, Camera, module_triangles
from foldback.web.pictures.lighting import THEMES
from foldback.web.pictures.rasteriser import draw_triangles

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

STILL_PX: Final = (640, 400)
"""Default width and height of a still picture of a chain, in pixels."""
STILL_FILL: Final = (0.88, 0.86)
"""Fractions of a still picture's width and height that the chain fills."""
TRIED_TURNS_RAD: Final = tuple(float(turn) for turn in np.deg2rad(np.arange(0, 360, 30)))
TRIED_ELEVATIONS_RAD: Final = (ELEVATION_RAD, float(np.deg2rad(55.0)))
MIN_OPENNESS: Final = 0.6
"""Smallest apparent extent of a chain in the default view, as a fraction of the largest in all
tried views; below it a still picture uses the view with the largest one."""


def still(
    module: Module,
    positions: NDArray[np.floating[Any]],
    wxyzs: NDArray[np.floating[Any]],
    colours: Bytes,
    *,
    size: tuple[int, int] = STILL_PX,
    around: NDArray[np.floating[Any]] | None = None,
) -> Image.Image:
    """Draw modules as an RGBA picture.

    Args:
        module: Kind of the modules.
        positions: (n, 3) centres in pitches.
        wxyzs: (n, 4) orientations.
        colours: (n, 3) sRGB.
        size: Width and height in pixels.
        around: (m, 3) points that the picture must show; all centres if None.
    """
    width, height = (SUPERSAMPLING * side for side in size)
    seen_positions = np.asarray(positions if around is None else around, dtype=np.float64)
    camera = Camera(_open_view(seen_positions, module.radius, width / height), width, height)
    places, rotations = positions.astype(np.float64), matrix_from_wxyz(wxyzs.astype(np.float64))
    corners, tones = module_triangles(module, places, rotations, colours, camera, THEMES["light"])
    picture, cover = (np.zeros((height, width, 3), np.uint8) for _ in range(2))
    draw_triangles(picture, corners, tones)
    draw_triangles(cover, corners, np.full_like(tones, 255.0))
    drawn = Image.fromarray(np.concatenate([picture, cover[..., :1]], axis=-1))
    return drawn.resize(size, Image.Resampling.BOX)


def _open_view(points: Array, radius: float, aspect: float) -> View:
    """Return the default view of points, or one that does not show a flat shape edge-on."""
    usual = framing(points, radius=radius, aspect=aspect, margin=STILL_FILL)
    sights = [(AZIMUTH_RAD + turn, up) for turn in TRIED_TURNS_RAD for up in TRIED_ELEVATIONS_RAD]
    best = max(sights, key=lambda sight: _spread(points, *sight))
    spread_m = _spread(points, usual.azimuth_rad, usual.elevation_rad)
    if spread_m >= MIN_OPENNESS * _spread(points, *best):
        return usual
    return framing(
        points,
        radius=radius,
        aspect=aspect,
        azimuth_rad=best[0],
        elevation_rad=best[1],
        margin=STILL_FILL,
    )


def _spread(points: Array, azimuth: float, elevation: float) -> float:
    """Return the width of points across their longest side in a view, at least half a pitch.

    The width is a standard deviation. A row of modules has the same appearance in all views.
    """
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    flat = np.cos(elevation)
    out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    visited = (points - points.mean(axis=0)) @ np.column_stack([right, np.cross(out, right)])
    narrow = float(np.linalg.eigvalsh(visited.T @ visited / len(points))[0])
    return max(0.5, np.sqrt(max(narrow, 0.0)))
