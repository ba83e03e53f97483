"""Occlusion: the light that other modules block from each face.

One number per face is computed without a shadow map, which would have jagged edges, need a second
rendering pass and flicker from frame to frame.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

MAX_OCCLUDER_DISTANCE: Final = 5.0
"""Distance beyond which a module casts no shadow on a face, in pitches."""


def face_light(
    middles: Array, normals: Array, positions: Array, *, radius: float, towards_light: Array
) -> tuple[Floats, Floats]:
    """Return the fractions of sky light and of key light that reach each face.

    Modules are approximated by balls. A ball of radius r at distance d in direction u blocks the
    fraction r²/d² (n·u) of a uniform sky from a face with normal n (far-field approximation). It
    blocks the part of the wide ray towards the light that passes within its radius.

    Args:
        middles: (n, F, 3) centres of the faces of the modules.
        normals: (n, F, 3) unit normals of the faces.
        positions: (n, 3) centres of the modules.
        radius: Radius of the balls, pitches.
        towards_light: (3,) unit vector towards the key light.

    Returns:
        (n, F) fractions of the sky light and (n, F) fractions of the key light, 0 to 1.
    """
    return _face_light(
        middles.astype(np.float32),
        normals.astype(np.float32),
        positions.astype(np.float32),
        np.float32(radius),
        towards_light.astype(np.float32),
    )


@njit(cache=True, fastmath=True)
def _face_light(middles, normals, positions, radius, light):  # pyright: ignore
    n, faces = middles.shape[0], middles.shape[1]
    sky = np.ones((n, faces), np.float32)
    lit = np.ones((n, faces), np.float32)
    far = np.float32(MAX_OCCLUDER_DISTANCE)
    for i in range(n):
        for j in range(n):
            if i == j:
                continue
            ax = positions[j, 0] - positions[i, 0]
            ay = positions[j, 1] - positions[i, 1]
            az = positions[j, 2] - positions[i, 2]
            apart = ax * ax + ay * ay + az * az
            if apart > far * far:
                continue
            fade = np.float32(1.0) - apart / (far * far)
            for f in range(faces):
                dx = positions[j, 0] - middles[i, f, 0]
                dy = positions[j, 1] - middles[i, f, 1]
                dz = positions[j, 2] - middles[i, f, 2]
                square = dx * dx + dy * dy + dz * dz
                ahead = dx * normals[i, f, 0] + dy * normals[i, f, 1] + dz * normals[i, f, 2]
                if ahead > 0.0:
                    weight = fade * ahead * radius * radius / (square * np.sqrt(square) + 1e-9)
                    sky[i, f] *= 1.0 - min(weight, np.float32(1.0))
                along = dx * light[0] + dy * light[1] + dz * light[2]
                if along > 0.0:
                    off = np.sqrt(max(square - along * along, np.float32(0.0)))
                    soft = np.float32(0.25) + np.float32(0.35) * along
                    inside = (radius - off) / soft + np.float32(0.5)
                    share = min(max(inside, np.float32(0.0)), np.float32(1.0))
                    lit[i, f] *= 1.0 - fade * share * share * (3.0 - 2.0 * share)
    return sky, lit
