"""Occlusion: the light that other modules block from each face.

One number per face is computed without a shadow map, which would have jagged edges, need a second
rendering pass and flicker from frame to frame.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner import core

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
    return core.face_light(
        middles.astype(np.float32),
        normals.astype(np.float32),
        positions.astype(np.float32),
        radius,
        towards_light.astype(np.float32),
        MAX_OCCLUDER_DISTANCE,
    )
