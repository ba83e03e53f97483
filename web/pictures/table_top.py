"""Table top: the displayed table that a chain folds on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain
from foldback.web.pictures.meshes import Mesh, hull_mesh

Array = NDArray[np.float64]
TABLE_RGB: Final = (206, 190, 166)
"""Colour of the displayed table top in the light theme, sRGB; ``js/viewer/sketch.js`` has that of
the dark theme."""
TABLE_MARGIN_PITCH: Final = 2.5
"""Width of the displayed table beyond the space that the chain's motion covers, on each side, in
pitches."""
MIN_TABLE_SIDE_PITCH: Final = 10.0
"""Minimum width and length of the displayed table, in pitches."""
DISC_SIDES: Final = 48
"""Number of sides of the polygon that approximates the disc under a module that presses on the
table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableTop:
    """A displayed table. Lengths are in pitches.

    Attributes:
        height: Height of the top.
        middle: Centre of the top.
        sides: Lengths of the top along x and y.
    """

    height: float
    middle: tuple[float, float]
    sides: tuple[float, float]

    @classmethod
    def under(cls, chain: Chain, positions: Array | None = None) -> TableTop:
        """Return the table that a chain stands on when folded.

        Args:
            chain: The chain.
            positions: (..., 3) positions of its modules during the motion; None if not known yet:
                the table then fits the straight chain in every direction.
        """
        if positions is None:
            folded = chain.folded_poses.positions
            low = folded.min(axis=0) - len(chain)
            high = folded.max(axis=0) + len(chain)
        else:
            points = positions.reshape(-1, 3)
            low, high = points.min(axis=0), points.max(axis=0)
        sides = np.maximum(high - low + 1.0 + 2.0 * TABLE_MARGIN_PITCH, MIN_TABLE_SIDE_PITCH)[:2]
        middle = ((low + high) / 2)[:2]
        return cls(
            height=chain.table_height,
            middle=(float(middle[0]), float(middle[1])),
            sides=(float(sides[0]), float(sides[1])),
        )

    @property
    def thickness(self) -> float:
        """Thickness of the table in pitches."""
        return max(0.45, 0.025 * max(self.sides))

    def outline(self) -> Array:
        """Return the (k, 2) outline with rounded corners, counterclockwise."""
        radius = 0.12 * min(self.sides)
        inner = np.array(self.sides) / 2 - radius
        turn = np.linspace(0.0, np.pi / 2, 12)
        parts = [
            inner * sign + radius * np.column_stack([np.cos(turn + k), np.sin(turn + k)])
            for sign, k in (
                ((1, 1), 0.0),
                ((-1, 1), np.pi / 2),
                ((-1, -1), np.pi),
                ((1, -1), 1.5 * np.pi),
            )
        ]
        return np.concatenate(parts) + np.array(self.middle)

    def mesh(self) -> Mesh:
        """Return the table's slab with a bevelled upper edge."""
        ring, middle = self.outline(), np.array(self.middle)
        bevel = min(0.24 * self.thickness, 0.5)
        shrunk = middle + (ring - middle) * (1.0 - 2.0 * bevel / np.array(self.sides))
        levels = [
            (shrunk, self.height),
            (ring, self.height - bevel),
            (ring, self.height - self.thickness),
        ]
        return hull_mesh(
            np.concatenate([np.column_stack([flat, np.full(len(ring), z)]) for flat, z in levels])
        )


def disc_mesh() -> Mesh:
    """Return a flat disc of radius 1 that faces up."""
    turn = np.linspace(0.0, 2 * np.pi, DISC_SIDES, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(DISC_SIDES)])
    corner = np.arange(1, DISC_SIDES - 1)
    return Mesh(vertices=ring, faces=np.column_stack([np.zeros_like(corner), corner, corner + 1]))
