"""Drawings of folded chains of any module as small SVG files, without perspective."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.corners import placed_faces
from foldback.planner.chain.module import Module
from foldback.web.palette import own_colours
from foldback.web.pictures.isometric import (
    COSINE,
    DRAWING_MARGIN_PITCH,
    PITCH_UNITS,
    QUARTER_TURN,
    SINE,
    Drawing,
    isometric_drawing,
)

Array = NDArray[np.float64]
AZIMUTH_RAD, ELEVATION_RAD = math.radians(33.0), math.radians(27.0)
"""Direction of the camera, in rad. It differs from that of cells, because from (1, 1, 1) some faces
of a tetrahedron are seen edge-on."""
RIGHT_DIRECTION: Final = np.array([-math.sin(AZIMUTH_RAD), math.cos(AZIMUTH_RAD), 0.0])
EYE_DIRECTION: Final = np.array(
    [
        math.cos(AZIMUTH_RAD) * math.cos(ELEVATION_RAD),
        math.sin(AZIMUTH_RAD) * math.cos(ELEVATION_RAD),
        math.sin(ELEVATION_RAD),
    ]
)
UP_DIRECTION: Final = np.cross(EYE_DIRECTION, RIGHT_DIRECTION)
LIGHT_DIRECTION: Final = np.array([0.1, 0.25, 0.96]) / math.sqrt(0.1**2 + 0.25**2 + 0.96**2)
DARKEST, BRIGHTEST = (112, 124, 140), (240, 242, 245)
DIMMEST_SHARE: Final = 0.5
"""Fraction of a module's own colour that a face turned away from the light keeps."""
SEAM_COLOUR: Final = "#646d79"
MODULE_PITCH_UNITS: Final = PITCH_UNITS / 2.0
"""Length of one pitch in drawings of modules that do not fill a cell, in user units."""
TONE_STEPS: Final = 12
"""Number of steps of the brightness of faces in an isometric drawing."""


def chain_svg(chain: Chain, *, size: int = 320, title: str | None = None) -> str:
    """Draw a folded chain from above, z upward: cubes as cells, others face by face.

    Args:
        chain: The chain.
        size: Width and height in CSS pixels; the drawing scales.
        title: Text for screen readers; without one the drawing counts as decoration.
    """
    return chain_drawing(chain).svg(size=size, title=title)


def chain_drawing(chain: Chain) -> Drawing:
    """Return the content of ``chain_svg``."""
    poses = chain.folded_poses
    return modules_drawing(chain.module, poses.positions, poses.rotations)


def modules_drawing(module: Module, positions: Array, rotations: Array) -> Drawing:
    """Draw modules in given poses, as ``chain_svg`` does.

    Args:
        module: Kind of the modules.
        positions: (n, 3) centres of the modules, pitches.
        rotations: (n, 3, 3) orientations of the modules.
    """
    if module.fills_cell:
        return isometric_drawing(np.rint(positions).astype(np.int64))
    positions, rotations = positions @ QUARTER_TURN.T, QUARTER_TURN @ rotations
    faces = placed_faces(module, positions, rotations, np.arange(len(positions)))
    # Faces that two modules share are not drawn.
    visible = np.flatnonzero((faces.normals @ EYE_DIRECTION > 1e-6) & faces.outer())
    visible = visible[np.argsort(faces.middles[visible] @ EYE_DIRECTION, kind="stable")]
    colours = own_colours(module, len(positions))
    outlines: list[Array] = []
    drawn: list[str] = []
    for k in visible.tolist():
        corners, middle = faces.corners[k], faces.middles[k]
        outlines.append(_project(corners) * MODULE_PITCH_UNITS)
        # The rest appears as a dark seam.
        inner = _project(middle + 0.94 * (corners - middle)) * MODULE_PITCH_UNITS
        colour = colours[faces.modules[k]] if module.colours else None
        drawn.append(
            f'<path fill="{SEAM_COLOUR}" d="{_path(outlines[-1])}"/>'
            f'<path fill="{_tone(faces.normals[k], colour)}" d="{_path(inner)}"/>'
        )
    flat = np.concatenate(outlines)
    low, high = flat.min(axis=0), flat.max(axis=0)
    margin = DRAWING_MARGIN_PITCH * MODULE_PITCH_UNITS
    box = " ".join(f"{v:.1f}" for v in (*(low - margin), *(high - low + 2 * margin)))
    return Drawing("".join(drawn), box)


def projected(module: Module, points: Array) -> Array:
    """Return (…, 2) user units of a drawing of modules where (…, 3) points appear, in pitches."""
    turned = points @ QUARTER_TURN.T
    if not module.fills_cell:
        return _project(turned) * MODULE_PITCH_UNITS
    x, y, z = np.moveaxis(turned, -1, 0)
    return np.stack([(y - x) * COSINE, (x + y) * SINE - z], axis=-1) * PITCH_UNITS


def _project(points: Array) -> Array:
    return np.stack([points @ RIGHT_DIRECTION, -(points @ UP_DIRECTION)], axis=-1)


def _path(points: Array) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "z"


def _tone(normal: Array, colour: NDArray[np.uint8] | None) -> str:
    share = round(TONE_STEPS * (0.5 + 0.5 * float(normal @ LIGHT_DIRECTION))) / TONE_STEPS
    darkest, brightest = (
        (DARKEST, BRIGHTEST) if colour is None else (DIMMEST_SHARE * colour, colour.astype(float))
    )
    mixed = (round(a + (b - a) * share) for a, b in zip(darkest, brightest, strict=True))
    return "#" + "".join(f"{value:02x}" for value in mixed)
