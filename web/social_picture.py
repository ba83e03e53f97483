"""Social picture: the folded shape as networks show it beside a link, in the look of the movies.

It is drawn without OpenGL, so that every link has one on every machine, and quickly.
"""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from planner.chain import Chain
from web.camera import FIELD_OF_VIEW_RAD, View, framing
from web.camera_path import GROUND_GAP
from web.colours import NEUTRAL
from web.drawn import drawn_modules
from web.ground_shadow import ground_shadow
from web.lighting import (
    LEAN,
    THEMES,
    UP,
    Theme,
    fill_light,
    key_light,
    shade_colours,
    share_left,
    unit,
)
from web.module_faces import module_faces
from web.rasteriser import draw_triangles

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

SIZE: Final = (1200, 630)
"""What Open Graph and its kin ask for."""
TIMES: Final = 2
MARGIN: Final = (0.82, 0.8)
EXPOSURE: Final = 1.1
"""Brings the tones to those of movies, where faces shine a little."""


def social_picture(chain: Chain) -> bytes:
    """A folded chain as a PNG file of ``SIZE`` pixels."""
    theme = THEMES["light"]
    poses = chain.folded_poses
    width, height = (TIMES * side for side in SIZE)
    view = framing(
        poses.positions, radius=chain.module.radius, aspect=width / height, margin=MARGIN
    )
    camera = _Camera(view, width, height)
    picture = np.array(_ground(poses.positions, camera, theme))
    draw_triangles(picture, *_triangles(chain, camera, theme))
    small = Image.fromarray(picture).resize(SIZE, Image.Resampling.BOX)
    file = io.BytesIO()
    small.save(file, "PNG", optimize=True)
    return file.getvalue()


class _Camera:
    """Where points of space are in a picture."""

    def __init__(self, view: View, width: int, height: int) -> None:
        self.view = view
        self.size = (width, height)
        self._eye = view.position
        forward = unit(view.target - view.position)
        right = unit(np.cross(forward, UP))
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


def _ground(positions: Array, camera: _Camera, theme: Theme) -> Image.Image:
    """The ground with the shadow on it."""
    ground = float(positions[:, 2].min()) - 0.5 - GROUND_GAP
    shadow = ground_shadow(positions, ground=ground, lean=-LEAN * key_light(camera.view)[:2])
    texture = Image.fromarray(shade_colours(shadow, theme))
    step = shadow.side / texture.width
    corner = np.array([*(shadow.middle - shadow.side / 2), ground])
    way = camera.on_plane(corner, step * np.array([1.0, 0, 0]), step * np.array([0, 1.0, 0]))
    return texture.transform(
        camera.size,
        Image.Transform.PERSPECTIVE,
        way,
        resample=Image.Resampling.BILINEAR,
        fillcolor=theme.ground,
    )


def _triangles(chain: Chain, camera: _Camera, theme: Theme) -> tuple[Floats, Floats]:
    """(T, 3, 3) corners as the camera sees them and (T, 3, 3) their colours."""
    poses, view = chain.folded_poses, camera.view
    pieces = module_faces(chain.module)
    drawn = drawn_modules(poses.positions, chain.module, target=view.target)
    turns, centres = poses.rotations[drawn], poses.positions[drawn]
    at = centres[:, None]
    left = share_left(
        np.einsum("nij,fj->nfi", turns, np.array([p.middle for p in pieces])) + at,
        np.einsum("nij,fj->nfi", turns, np.array([p.normal for p in pieces])),
        centres,
        module=chain.module,
        view=view,
        theme=theme,
    )
    lights = (
        (key_light(view), theme.key_colour),
        (fill_light(view), theme.fill * np.ones(3)),
    )
    corners: list[Floats] = []
    colours: list[Floats] = []
    for f, piece in enumerate(pieces):
        normals = np.einsum("nij,vj->nvi", turns, piece.normals)
        shine = theme.ambient + sum(
            np.maximum(normals @ towards, 0.0)[..., None] * colour for towards, colour in lights
        )
        tones = np.array(NEUTRAL) * np.minimum(shine, 1.0) * EXPOSURE * left[:, f, None, None]
        places = camera.seen(np.einsum("nij,vj->nvi", turns, piece.vertices) + at)
        corners.append(places[:, piece.triangles].reshape(-1, 3, 3).astype(np.float32))
        colours.append(tones[:, piece.triangles].reshape(-1, 3, 3).astype(np.float32))
    return np.concatenate(corners), np.concatenate(colours)
