"""Drawn modules: projected and shaded triangles of modules, for drawing without OpenGL."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.module import Module
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD, View
from foldback.web.pictures.lighting import Theme, fill_light, key_light, share_left
from foldback.web.pictures.module_faces import drawn_faces
from foldback.web.pictures.visible_modules import visible_modules

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

SUPERSAMPLING: Final = 2
"""Factor by which pictures are drawn wider and higher than requested before they are averaged
down."""


class Camera:
    """Projection of points in space into a picture."""

    def __init__(self, view: View, width: int, height: int) -> None:
        self.view = view
        self.size = (width, height)
        self._eye = view.position
        right, up, out = view.axes
        self._axes = np.array([right, -up, -out])
        self._scale = height / 2 / float(np.tan(FIELD_OF_VIEW_RAD / 2))

    def seen(self, points: Array) -> Array:
        """Project (…, 3) points to (…, 3) pixels from the left, pixels from the top, and depths."""
        local = (points - self._eye) @ self._axes.T
        flat = self._scale * local[..., :2] / local[..., 2:] + np.array(self.size) / 2
        return np.concatenate([flat, local[..., 2:]], axis=-1)

    def on_plane(self, corner: Array, along: Array, across: Array) -> tuple[float, ...]:
        """Return the eight coefficients that map a pixel to the point (u, v) of a plane.

        The point ``corner + u · along + v · across`` is seen at the pixel H (u, v, 1). The
        coefficients are those of H⁻¹, scaled so that the last one is 1, as Pillow expects.
        """
        aim = np.array(self.size) / 2
        scaling = np.diag([self._scale, self._scale, 1.0])
        scaling[:2, 2] = aim
        lead = scaling @ self._axes @ np.column_stack([along, across, corner - self._eye])
        lag = np.linalg.inv(lead)
        return tuple((lag / lag[2, 2]).ravel()[:8].tolist())


def module_triangles(
    module: Module,
    positions: Array,
    rotations: Array,
    colours: Bytes,
    camera: Camera,
    theme: Theme,
) -> tuple[Floats, Floats]:
    """Return the (T, 3, 3) projected corners of modules' triangles and their (T, 3, 3) colours.

    Args:
        module: Kind of the modules.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
        colours: (n, 3) sRGB.
        camera: Camera of the picture.
        theme: Theme with the lights.
    """
    view = camera.view
    # Modules behind the camera, or too close to it, cannot be projected.
    ahead = (view.position - positions) @ view.axes[2] > 2.0 * module.radius
    drawn = visible_modules(positions, module, target=view.target)
    drawn = drawn[ahead[drawn]]
    free_share = share_left(
        module, drawn, positions[drawn], rotations[drawn], view=view, theme=theme
    )
    lights = (
        (key_light(view), theme.key_colour),
        (fill_light(view), theme.fill * np.ones(3)),
    )
    pieces = module.piece_numbers[drawn % len(module.pattern)]
    corners: list[Floats] = []
    tones: list[Floats] = []
    for number, piece in enumerate(module.pieces):
        rows = np.flatnonzero(pieces == number)
        members = drawn[rows]
        turns, at = rotations[members], positions[members, None]
        paint = colours[members, None].astype(np.float64)
        for f, face in enumerate(drawn_faces(piece)):
            normals = np.einsum("nij,vj->nvi", turns, face.normals)
            shine = theme.ambient + sum(
                np.maximum(normals @ towards, 0.0)[..., None] * colour for towards, colour in lights
            )
            # as bright as in movies, where faces have a specular highlight
            lit = paint * np.minimum(shine, 1.0) * 1.1 * free_share[rows, f, None, None]
            places = camera.seen(np.einsum("nij,vj->nvi", turns, face.vertices) + at)
            corners.append(places[:, face.triangles].reshape(-1, 3, 3).astype(np.float32))
            tones.append(lit[:, face.triangles].reshape(-1, 3, 3).astype(np.float32))
    return np.concatenate(corners), np.concatenate(tones)
