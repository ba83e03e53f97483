"""Lighting: the lights in pictures of a chain, and the light that reaches each face."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Ints
from foldback.planner.chain.module import Module
from foldback.web.palette import Rgb
from foldback.web.pictures.camera import View
from foldback.web.pictures.ground_shadow import GroundShadow
from foldback.web.pictures.module_faces import drawn_faces
from foldback.web.pictures.occlusion import face_light

Array = NDArray[np.float64]

UPWARD: Final = np.array([0.0, 0.0, 1.0])
KEY_LIGHT_RGB: Final = np.array([1.0, 0.985, 0.955])
"""Colour of the key light as factors on linear red, green and blue: slightly warm."""
SHADOW_SHIFT_PER_HEIGHT: Final = 0.25
"""Factor on the horizontal direction of the key light, which gives the shift of a module's ground
shadow in pitches per pitch of height. It is smaller than the light's angle demands, so that shadows
stay near the modules."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Theme:
    """Colours of the ground and strengths of the lights.

    Attributes:
        ground: Colour of the ground.
        shade: Colour of the ground in full shadow.
        key: Strength of the key light, 0 to 1.
        fill: Strength of the fill light.
        ambient: Strength of the ambient light.
        dimmest: Fraction of a colour that remains in full shadow.
    """

    ground: Rgb
    shade: Rgb
    key: float
    fill: float
    ambient: float
    dimmest: float

    @property
    def key_colour(self) -> Array:
        """(3,) strengths of the key light in red, green and blue."""
        return self.key * KEY_LIGHT_RGB


THEMES: Final = {
    "light": Theme(
        ground=(247, 245, 241),
        shade=(172, 164, 154),
        key=0.62,
        fill=0.2,
        ambient=0.44,
        dimmest=0.42,
    ),
    "dark": Theme(
        ground=(30, 35, 42), shade=(6, 8, 10), key=0.62, fill=0.16, ambient=0.34, dimmest=0.24
    ),
}

TABLE_THEMES: Final = {
    "light": replace(THEMES["light"], ground=(222, 214, 200), shade=(139, 127, 108)),
    "dark": replace(THEMES["dark"], ground=(76, 83, 93), shade=(26, 30, 35)),
}
"""Colours and lights of movies and pictures of chains on a table, by theme; the colours are those
of ``js/viewer/sketch.js``."""


def key_light(view: View) -> Array:
    """Return the (3,) unit vector towards the key light, which moves with the camera."""
    return _beside(view, (-0.5, 0.6, 1.0))  # right, towards the camera, up


def fill_light(view: View) -> Array:
    """Return the (3,) unit vector towards the fill light, which moves with the camera."""
    return _beside(view, (0.9, 0.6, 0.1))  # right, towards the camera, up


def share_left(
    module: Module, numbers: Ints, positions: Array, turns: Array, *, view: View, theme: Theme
) -> Array:
    """Return the fraction of each face's colour that remains in the shadows of other modules.

    Args:
        module: Kind of the modules.
        numbers: (n,) numbers of the modules in their chain.
        positions: (n, 3) centres of the modules.
        turns: (n, 3, 3) orientations of the modules.
        view: The camera, with which the lights move.
        theme: Theme with the darkest tone.

    Returns:
        (n, F) fractions, 0 to 1, in the order of ``drawn_faces``; F is the largest number of faces
        of a piece.
    """
    faces = [drawn_faces(piece) for piece in module.pieces]
    places = np.zeros((2, len(faces), max(map(len, faces)), 3))  # of middles and normals
    for k, of_piece in enumerate(faces):
        places[:, k, : len(of_piece)] = (
            [face.middle for face in of_piece],
            [face.normal for face in of_piece],
        )
    pieces = module.piece_numbers[numbers % len(module.pattern)]
    middles, normals = np.einsum("nij,knfj->knfi", turns, places[:, pieces])
    sky, lit = face_light(
        middles + positions[:, None],
        normals,
        positions,
        radius=_shadow_radius(module),
        towards_light=key_light(view),
    )
    bright = (sky * (1.0 - 0.35 * (1.0 - lit))).astype(np.float64)
    return theme.dimmest + (1.0 - theme.dimmest) * bright


def _shadow_radius(module: Module) -> float:
    """Return the radius of the ball that takes as much light as a module, pitches."""
    of_volume = float(np.cbrt(3.0 * module.volume / (4.0 * np.pi)))
    return max(1.12 * module.inner_radius, 0.7 * of_volume)


def shade_colours(shadow: GroundShadow, theme: Theme) -> NDArray[np.uint8]:
    """Return (C, C, 3) sRGB bytes of the ground with a shadow on it."""
    low, high = np.array(theme.ground, np.float64), np.array(theme.shade, np.float64)
    steps = np.rint(low + (high - low) * np.linspace(0, 1, 256)[:, None]).astype(np.uint8)
    return steps[np.rint(shadow.shade * 255.0).astype(np.uint8)]


def _beside(view: View, way: tuple[float, float, float]) -> Array:
    right = view.axes[0]
    towards = way[0] * right + way[1] * np.cross(right, UPWARD) + way[2] * UPWARD
    return towards / np.linalg.norm(towards)
