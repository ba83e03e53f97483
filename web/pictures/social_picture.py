"""Social picture: the preview of a fold's link in social networks, in the style of the movies.

It is drawn without OpenGL, so that it is fast and available on every machine.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.web.palette import NO_ERROR_RGB, error_colours, module_errors
from foldback.web.pictures import SOCIAL_PICTURE_PX
from foldback.web.pictures.camera import GROUND_GAP_PITCH
from foldback.web.pictures.caption import Caption, write_caption
from foldback.web.pictures.drawn_modules import SUPERSAMPLING, Camera, module_triangles
from foldback.web.pictures.ground_shadow import ground_shadow
from foldback.web.pictures.lighting import (
    SHADOW_SHIFT_PER_HEIGHT,
    THEMES,
    Theme,
    key_light,
    shade_colours,
)
from foldback.web.pictures.picture_view import PictureView
from foldback.web.pictures.rasteriser import draw_triangles

Array = NDArray[np.float64]

FOLDED_VIEW: Final = PictureView(frame=0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """A chain at one moment of its fold.

    Attributes:
        poses: Poses of its modules.
        errors_rad: (J,) joint errors; NaN where none is recorded.
        error_scale_rad: Error at which a module is fully red.
    """

    poses: Poses
    errors_rad: Array
    error_scale_rad: float


def social_picture(
    chain: Chain,
    *,
    caption: Caption | None = None,
    view: PictureView = FOLDED_VIEW,
    moment: Moment | None = None,
) -> bytes:
    """Return a chain as a PNG file of ``SOCIAL_PICTURE_PX`` pixels.

    Args:
        chain: The chain.
        caption: Caption of the picture.
        view: The camera.
        moment: The moment that is shown; the folded chain when None.
    """
    theme = THEMES["light"]
    module = chain.module
    poses = chain.folded_poses if moment is None else moment.poses
    width, height = (SUPERSAMPLING * side for side in SOCIAL_PICTURE_PX)
    social_camera = view.camera(
        poses.positions,
        radius=module.radius,
        aspect=width / height,
        margin=(0.82, 0.8 if caption is None else 0.6),
    )
    camera = Camera(social_camera, width, height)
    picture = np.array(_ground(poses.positions, camera, theme))
    colours = np.tile(np.array(NO_ERROR_RGB, np.uint8), (len(chain), 1))
    if moment is not None:
        errors = module_errors(moment.errors_rad, module, len(chain))
        if np.isfinite(errors).any():
            colours = error_colours(errors, moment.error_scale_rad)
    draw_triangles(
        picture,
        *module_triangles(chain.module, poses.positions, poses.rotations, colours, camera, theme),
    )
    small = Image.fromarray(picture).resize(SOCIAL_PICTURE_PX, Image.Resampling.BOX)
    if caption is not None:
        write_caption(small, caption)
    file = io.BytesIO()
    small.save(file, "PNG", optimize=True)
    return file.getvalue()


def _ground(positions: Array, camera: Camera, theme: Theme) -> Image.Image:
    """Return a picture of the ground with the chain's shadow."""
    ground = float(positions[:, 2].min()) - 0.5 - GROUND_GAP_PITCH
    shadow = ground_shadow(
        positions, ground=ground, lean=-SHADOW_SHIFT_PER_HEIGHT * key_light(camera.view)[:2]
    )
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
