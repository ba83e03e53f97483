"""Social picture: the folded shape as networks show it beside a link, in the look of the movies.

It is drawn without OpenGL, so that every link has one on every machine: face by face from far to
near, at twice the size, on the ground that movies have.
"""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from planner.chain import Chain
from web.camera import FIELD_OF_VIEW_RAD, View, framing
from web.camera_path import GROUND_GAP
from web.colours import NEUTRAL
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
from web.meshes import BEVEL
from web.module_faces import module_faces
from web.sketch import sketch_outline

Array = NDArray[np.float64]

SIZE: Final = (1200, 630)
"""What Open Graph and its kin ask for."""
TIMES: Final = 2
MARGIN: Final = (0.82, 0.8)
EDGE: Final = 1.06
"""How much brighter a bevel is than its face."""


def social_picture(chain: Chain) -> bytes:
    """A folded chain as a PNG file of ``SIZE`` pixels."""
    theme = THEMES["light"]
    poses = chain.folded_poses
    width, height = (TIMES * side for side in SIZE)
    view = framing(
        poses.positions, radius=chain.module.radius, aspect=width / height, margin=MARGIN
    )
    camera = _Camera(view, width, height)
    picture = _ground(poses.positions, camera, theme)
    draw = ImageDraw.Draw(picture)
    for corners, colour in _faces(chain, view, theme):
        middle = corners.mean(axis=0)
        edge = np.minimum(colour * EDGE, 255.0)
        for points, tone in ((corners, edge), (_inset(corners, middle), colour)):
            flat = camera.seen(points)
            draw.polygon(
                [(float(x), float(y)) for x, y in flat], fill=tuple(np.rint(tone).astype(int))
            )
    small = picture.resize(SIZE, Image.Resampling.BOX)
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
        """(…, 3) points to (…, 2) pixels from the left and from the top."""
        local = (points - self._eye) @ self._axes.T
        return self._scale * local[..., :2] / local[..., 2:] + np.array(self.size) / 2

    def distance(self, points: Array) -> Array:
        """(…) how far points are."""
        return np.linalg.norm(points - self._eye, axis=-1)

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


def _faces(chain: Chain, view: View, theme: Theme) -> list[tuple[Array, Array]]:
    """Corners (C, 3) and colour (3,) of all faces that can be seen, the farthest module first."""
    poses, module = chain.folded_poses, chain.module
    outline = sketch_outline(module, len(chain))
    pieces = module_faces(module)
    middles = np.einsum("nij,fj->nfi", poses.rotations, np.array([p.middle for p in pieces]))
    middles = middles + poses.positions[:, None]
    normals = np.einsum("nij,fj->nfi", poses.rotations, np.array([p.normal for p in pieces]))
    left = share_left(
        middles, normals, poses.positions, module=module, view=view, theme=theme
    ).astype(np.float64)
    lit = [
        np.maximum(normals @ light, 0.0)[..., None] * colour
        for light, colour in (
            (key_light(view), theme.key_colour),
            (fill_light(view), theme.fill * np.ones(3)),
        )
    ]
    shine = np.minimum(theme.ambient + lit[0] + lit[1], 1.0)
    colours = np.array(NEUTRAL) * shine * left[..., None]
    corners = np.array(outline["corners"])
    eye = view.position
    towards = np.einsum("nfi,nfi->nf", normals, eye - middles) > 0
    found: list[tuple[Array, Array]] = []
    for k in np.argsort(-np.linalg.norm(poses.positions - eye, axis=1), kind="stable"):
        for f in np.flatnonzero(towards[k]):
            placed = corners[outline["faces"][f]] @ poses.rotations[k].T + poses.positions[k]
            found.append((placed, colours[k, f]))
    return found


def _inset(corners: Array, middle: Array) -> Array:
    """A face without its bevels."""
    reach = float(np.linalg.norm(corners - middle, axis=1).max())
    return middle + (1.0 - 1.3 * BEVEL / reach) * (corners - middle)
