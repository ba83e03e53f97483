"""Ground shadow: the soft shadow of a chain on the ground, computed without rendering.

A shadow map of OpenGL gives hard, jagged shadows. This shadow is that of an extended light: sharp
where a module touches the ground, wider and fainter the higher the module is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from foldback.web.pictures.meshes import DISPLAYED_MODULE_SIZE

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

SHADOW_CELLS: Final = 512
"""Number of pixels of a ground shadow's texture along each side."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundShadow:
    """A shadow on a square of the ground.

    Attributes:
        middle: (2,) centre of the square, pitches.
        side: Side length of the square, pitches.
        shade: (C, C) darkness from 0 to 1, rows along y, columns along x. It is 0 at the edge.
    """

    middle: Array
    side: float
    shade: Array


def ground_shadow(positions: Array, *, ground: float, lean: Array) -> GroundShadow:
    """Return the shadow of modules on the ground.

    Each module is a square, blurred by a Gaussian whose width grows with its height; the fraction
    exp(-Σ) of the light passes all of them, where Σ is the sum of their coverages.

    Args:
        positions: (n, 3) centres of the modules in pitches.
        ground: Height of the ground.
        lean: (2,) horizontal shift of a shadow per pitch of height, pitches.
    """
    height = np.maximum(positions[:, 2] - ground, 0.0)
    blur = 0.3 + 0.07 * height
    at = positions[:, :2] + height[:, None] * lean
    free = 3.0 * float(blur.max()) + DISPLAYED_MODULE_SIZE
    low, high = at.min(axis=0) - free, at.max(axis=0) + free
    middle, side = (low + high) / 2, float((high - low).max())
    lines = (np.arange(SHADOW_CELLS) + 0.5) / SHADOW_CELLS * side - side / 2
    along_x, along_y = (
        _covered(lines[None, :] + middle[k] - at[:, k, None], blur) for k in range(2)
    )
    shade = 1.0 - np.exp(-(along_y.T @ along_x))
    return GroundShadow(middle=middle, side=side, shade=shade)


def _covered(off: Array, blur: Array) -> Floats:
    """Return the (n, C) coverage of a blurred bar of a module's width at distances ``off``."""
    scale = 1.0 / blur[:, None]
    covered = ndtr((off + DISPLAYED_MODULE_SIZE / 2) * scale) - ndtr(
        (off - DISPLAYED_MODULE_SIZE / 2) * scale
    )
    return covered.astype(np.float32)
