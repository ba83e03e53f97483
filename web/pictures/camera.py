"""Camera: the view that shows the whole chain. Pages compute it by the same equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain

Array = NDArray[np.float64]

FIELD_OF_VIEW_RAD: Final = np.deg2rad(32.0)
"""Vertical field of view of all cameras, in rad."""
AZIMUTH_RAD: Final = np.deg2rad(-62.0)
"""Default azimuth of the camera as seen from the chain, in rad from the x axis around the vertical
z axis."""
ELEVATION_RAD: Final = np.deg2rad(24.0)
"""Default elevation of the camera above the horizontal plane, in rad."""
ORBIT_SPEED_RAD_S: Final = np.deg2rad(5.0)
"""Angular speed with which the camera orbits around the chain while a web page plays a motion by
itself, in rad/s."""
GROUND_GAP_PITCH: Final = 0.35
"""Gap between the lowest module and the drawn ground in movies and pictures of chains without a
table, in pitches."""


_DIRECTIONS_13: Final = np.array(
    [
        *((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        *((0, 1, 1), (0, 1, -1), (1, 0, 1), (1, 0, -1), (1, 1, 0), (1, -1, 0)),
        *((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)),
    ],
    dtype=np.float64,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Position and direction of a camera: ``target`` (3,), direction angles and distance."""

    target: Array
    azimuth_rad: float
    elevation_rad: float
    distance: float

    @property
    def axes(self) -> Array:
        """(3, 3) unit vectors to the right, up and towards the camera, one in each row."""
        return _axes(self.azimuth_rad, self.elevation_rad)

    @property
    def position(self) -> Array:
        """(3,) position of the camera, pitches."""
        return self.target + self.distance * self.axes[2]


def few_points(points: NDArray[np.floating[Any]]) -> Array:
    """Return some of (n, 3) points that represent all of them in a view.

    They are every k-th point, and the extreme points in both directions along ``_DIRECTIONS_13``.
    """
    by = max(1, len(points) // 600)
    sample = points[::by].astype(np.float64)
    if by == 1:
        return sample
    along = points.astype(np.float64) @ _DIRECTIONS_13.T
    ends = np.stack([along.argmin(axis=0), along.argmax(axis=0)], axis=1).ravel()
    return np.concatenate([sample, points[ends].astype(np.float64)])


def straight_stretch(chain: Chain) -> int:
    """Return the number of straight modules kept in view beside a long fold's folded part."""
    extent = float(np.ptp(chain.folded_poses.positions, axis=0).max())
    return max(40, round(1.5 * extent))


def modules_framed(chain: Chain, last: int, stretch: int) -> int:
    """Return the number of modules, from the first on, that a camera shows of a long chain.

    Shown whole, a chain of ten thousand modules would be thinner than a pixel. The camera therefore
    shows the folded and moving modules and a part of the straight ones.

    Args:
        chain: The chain.
        last: Index of the hinge from which on all hinges are straight.
        stretch: Result of ``straight_stretch`` for the chain.
    """
    module = chain.module
    bent = module.module_after(last - 1) + 1
    return min(len(chain), bent + stretch)


def framing(
    points: Array,
    *,
    radius: float,
    aspect: float = 1.6,
    azimuth_rad: float | None = None,
    elevation_rad: float = ELEVATION_RAD,
    margin: tuple[float, float] = (0.9, 0.72),
) -> View:
    """Return the nearest view that shows all points.

    A slim chain is shown from its side; in an upright window, from closer to its end.

    Args:
        points: (n, 3) centres.
        radius: Radius of a module around its centre, pitches.
        aspect: Aspect ratio of the window, width / height.
        azimuth_rad: Azimuth of the camera; chosen from the points when None.
        elevation_rad: Elevation of the camera above the ground.
        margin: Fractions of the window's width and height to fill.
    """
    sample = few_points(points)
    if azimuth_rad is None:
        azimuth_rad = _azimuth(sample, aspect)
    axes = _axes(azimuth_rad, elevation_rad)
    local = sample @ axes.T
    middle = (local.min(axis=0) + local.max(axis=0)) / 2
    tall = np.tan(FIELD_OF_VIEW_RAD / 2)
    wide = tall * aspect
    distance = radius
    for _ in range(3):  # perspective shifts the middle; a few iterations centre the picture
        x, y, z = (local - middle).T
        distance = max(
            float(((np.abs(x) + radius) / (wide * margin[0]) + z).max()),
            float(((np.abs(y) + radius) / (tall * margin[1]) + z).max()),
            radius * 4,
        )
        depth = distance - z
        shift_x = ((x / depth).max() + (x / depth).min()) / 2 * distance
        shift_y = ((y / depth).max() + (y / depth).min()) / 2 * distance
        middle = middle + np.array([shift_x, shift_y, 0.0])
    return View(
        target=middle @ axes,
        azimuth_rad=azimuth_rad,
        elevation_rad=elevation_rad,
        distance=distance,
    )


def distance_needed(points: Array, view: View, *, radius: float, aspect: float) -> float:
    """Return the minimum distance at which a view with this target shows all points."""
    x, y, depth = view.axes @ (few_points(points) - view.target).T
    tall = np.tan(FIELD_OF_VIEW_RAD / 2)
    sideways = (np.abs(x) + radius) / (tall * aspect) + depth
    upwards = (np.abs(y) + radius) / tall + depth
    return float(max(sideways.max(), upwards.max()))


def _axes(azimuth: float, elevation: float) -> Array:
    flat = np.cos(elevation)
    out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(out, right), out])


def _azimuth(points: Array, aspect: float) -> float:
    spread = points - points.mean(axis=0)
    values, axes = np.linalg.eigh(spread.T @ spread)
    longest = axes[:, 2]
    level = float(np.hypot(longest[0], longest[1]))
    slim = 1.0 - np.sqrt(max(float(values[1]), 0.0) / max(float(values[2]), 1e-12))
    weight = float(np.clip((slim - 0.4) / 0.4, 0.0, 1.0)) * level
    along = float(np.arctan2(longest[1], longest[0]))
    azimuth = np.deg2rad(68.0) if aspect >= 1.0 else np.deg2rad(30.0)
    options = [along + half + side for half in (0.0, np.pi) for side in (-azimuth, azimuth)]
    turns = [(option - AZIMUTH_RAD + np.pi) % (2 * np.pi) - np.pi for option in options]
    return float(AZIMUTH_RAD + weight * min(turns, key=abs))
