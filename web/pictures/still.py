"""Still: a picture of modules anywhere in space, drawn without OpenGL.

Nothing is behind them: what is not a module is transparent, for pages that are light or dark.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from planner.chain.module import Module
from planner.chain.rotations import matrix_from_wxyz
from web.pictures.camera import AZIMUTH_RAD, ELEVATION_RAD, FIELD_OF_VIEW_RAD, View, framing
from web.pictures.lighting import THEMES, UPWARD, Theme, fill_light, key_light, share_left, unit
from web.pictures.module_faces import module_faces
from web.pictures.rasteriser import draw_triangles
from web.pictures.visible_modules import visible_modules

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

STILL_PX: Final = (640, 400)
"""Default width and height of a still picture of a chain, in pixels. Chosen."""
SUPERSAMPLING: Final = 2
"""Factor by which pictures are drawn wider and higher than requested before they are averaged down.
A larger value smooths edges more and is slower. Chosen."""
STILL_FILL: Final = (0.88, 0.86)
"""Fractions of a still picture's width and height that the chain fills. Smaller values leave a
wider margin. Chosen."""
TRIED_TURNS_RAD: Final = tuple(float(turn) for turn in np.deg2rad(np.arange(0, 360, 30)))
TRIED_ELEVATIONS_RAD: Final = (ELEVATION_RAD, float(np.deg2rad(55.0)))
MIN_OPENNESS: Final = 0.6
"""Smallest apparent extent of a chain in the default view, as a fraction of the largest in all
tried views; below it a still picture uses the view with the largest one. A larger value leaves the
default view more often. Chosen."""
EXPOSURE: Final = 1.1
"""Factor on the brightness of faces in still pictures, which makes them as bright as in movies,
where faces have a specular highlight. A larger value makes pictures brighter. Chosen."""


def still(
    module: Module,
    positions: NDArray[np.floating[Any]],
    wxyzs: NDArray[np.floating[Any]],
    colours: Bytes,
    *,
    size: tuple[int, int] = STILL_PX,
    around: NDArray[np.floating[Any]] | None = None,
) -> Image.Image:
    """Modules as an RGBA picture.

    Args:
        module: Their kind.
        positions: (n, 3) centres in pitches.
        wxyzs: (n, 4) orientations.
        colours: (n, 3) sRGB.
        size: Width and height in pixels.
        around: (m, 3) points to have in view; all centres when None.
    """
    width, height = (SUPERSAMPLING * side for side in size)
    seen = np.asarray(positions if around is None else around, dtype=np.float64)
    camera = Camera(_open_view(seen, module.radius, width / height), width, height)
    places, rotations = positions.astype(np.float64), matrix_from_wxyz(wxyzs.astype(np.float64))
    corners, tones = module_triangles(module, places, rotations, colours, camera, THEMES["light"])
    picture, cover = (np.zeros((height, width, 3), np.uint8) for _ in range(2))
    draw_triangles(picture, corners, tones)
    draw_triangles(cover, corners, np.full_like(tones, 255.0))
    drawn = Image.fromarray(np.concatenate([picture, cover[..., :1]], axis=-1))
    return drawn.resize(size, Image.Resampling.BOX)


def _open_view(points: Array, radius: float, aspect: float) -> View:
    """Return the default view of points, or one that does not show a flat shape by its edge."""
    usual = framing(points, radius=radius, aspect=aspect, margin=STILL_FILL)
    sights = [(AZIMUTH_RAD + turn, up) for turn in TRIED_TURNS_RAD for up in TRIED_ELEVATIONS_RAD]
    best = max(sights, key=lambda sight: _spread(points, *sight))
    here = _spread(points, usual.azimuth_rad, usual.elevation_rad)
    if here >= MIN_OPENNESS * _spread(points, *best):
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

    The width is a standard deviation. A row of modules looks the same from everywhere.
    """
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    flat = np.cos(elevation)
    out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    seen = (points - points.mean(axis=0)) @ np.column_stack([right, np.cross(out, right)])
    narrow = float(np.linalg.eigvalsh(seen.T @ seen / len(points))[0])
    return max(0.5, np.sqrt(max(narrow, 0.0)))


class Camera:
    """Projection of points in space into a picture."""

    def __init__(self, view: View, width: int, height: int) -> None:
        self.view = view
        self.size = (width, height)
        self._eye = view.position
        forward = unit(view.target - view.position)
        right = unit(np.cross(forward, UPWARD))
        self._axes = np.array([right, -np.cross(right, forward), forward])
        self._scale = height / 2 / float(np.tan(FIELD_OF_VIEW_RAD / 2))

    def seen(self, points: Array) -> Array:
        """(…, 3) points to pixels from the left, from the top, and distances (…, 3)."""
        local = (points - self._eye) @ self._axes.T
        flat = self._scale * local[..., :2] / local[..., 2:] + np.array(self.size) / 2
        return np.concatenate([flat, local[..., 2:]], axis=-1)

    def on_plane(self, corner: Array, along: Array, across: Array) -> tuple[float, ...]:
        """Eight numbers that lead from a pixel to where it lies on a plane.

        The point ``corner + u · along + v · across`` is seen at the pixel H (u, v, 1); the numbers
        are those of H⁻¹, scaled so that the last one is 1, as Pillow takes them.
        """
        aim = np.array(self.size) / 2
        seen = np.diag([self._scale, self._scale, 1.0])
        seen[:2, 2] = aim
        lead = seen @ self._axes @ np.column_stack([along, across, corner - self._eye])
        back = np.linalg.inv(lead)
        return tuple((back / back[2, 2]).ravel()[:8].tolist())


def module_triangles(
    module: Module,
    positions: Array,
    rotations: Array,
    colours: Bytes,
    camera: Camera,
    theme: Theme,
) -> tuple[Floats, Floats]:
    """(T, 3, 3) corners of modules as a camera sees them and (T, 3, 3) their colours.

    Args:
        module: Their kind.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
        colours: (n, 3) sRGB.
        camera: Camera of the picture.
        theme: The light on them.
    """
    view = camera.view
    pieces = module_faces(module)
    # What is behind the camera, or nearly, has no place in the picture.
    ahead = (positions - view.position) @ unit(view.target - view.position) > 2.0 * module.radius
    drawn = visible_modules(positions, module, target=view.target)
    drawn = drawn[ahead[drawn]]
    turns, centres, paint = rotations[drawn], positions[drawn], colours[drawn].astype(np.float64)
    at = centres[:, None]
    left = share_left(
        np.einsum("nij,fj->nfi", turns, np.array([p.middle for p in pieces])) + at,
        np.einsum("nij,fj->nfi", turns, np.array([p.normal for p in pieces])),
        centres,
        module=module,
        view=view,
        theme=theme,
    )
    lights = (
        (key_light(view), theme.key_colour),
        (fill_light(view), theme.fill * np.ones(3)),
    )
    corners: list[Floats] = []
    tones: list[Floats] = []
    for f, piece in enumerate(pieces):
        normals = np.einsum("nij,vj->nvi", turns, piece.normals)
        shine = theme.ambient + sum(
            np.maximum(normals @ towards, 0.0)[..., None] * colour for towards, colour in lights
        )
        lit = paint[:, None] * np.minimum(shine, 1.0) * EXPOSURE * left[:, f, None, None]
        places = camera.seen(np.einsum("nij,vj->nvi", turns, piece.vertices) + at)
        corners.append(places[:, piece.triangles].reshape(-1, 3, 3).astype(np.float32))
        tones.append(lit[:, piece.triangles].reshape(-1, 3, 3).astype(np.float32))
    return np.concatenate(corners), np.concatenate(tones)
