"""Social picture: the folded shape as networks show it beside a link, in the look of the movies.

It is drawn without OpenGL, so that every link has one on every machine, and quickly.
"""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from planner.chain.chain import Chain
from web.pictures.camera import framing
from web.pictures.camera_path import GROUND_GAP
from web.pictures.colours import NEUTRAL
from web.pictures.ground_shadow import ground_shadow
from web.pictures.lighting import LEAN, THEMES, Theme, key_light, shade_colours
from web.pictures.rasteriser import draw_triangles
from web.pictures.still import Camera, module_triangles

Array = NDArray[np.float64]

SIZE: Final = (1200, 630)
"""Width and height in pixels, as Open Graph recommends."""
TIMES: Final = 2
MARGIN: Final = (0.82, 0.8)


def social_picture(chain: Chain) -> bytes:
    """A folded chain as a PNG file of ``SIZE`` pixels."""
    theme = THEMES["light"]
    poses = chain.folded_poses
    width, height = (TIMES * side for side in SIZE)
    view = framing(
        poses.positions, radius=chain.module.radius, aspect=width / height, margin=MARGIN
    )
    camera = Camera(view, width, height)
    picture = np.array(_ground(poses.positions, camera, theme))
    colours = np.tile(np.array(NEUTRAL, np.uint8), (len(chain), 1))
    draw_triangles(
        picture,
        *module_triangles(chain.module, poses.positions, poses.rotations, colours, camera, theme),
    )
    small = Image.fromarray(picture).resize(SIZE, Image.Resampling.BOX)
    file = io.BytesIO()
    small.save(file, "PNG", optimize=True)
    return file.getvalue()


def _ground(positions: Array, camera: Camera, theme: Theme) -> Image.Image:
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
