"""Camera path: the camera of a whole movie, smoothed over past and future.

The camera of a live view can only lag behind. This one is smoothed over the whole movie,
symmetrically in time, and never cuts anything off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from foldback.web.pictures.camera import GROUND_GAP_PITCH, View, distance_needed, framing

Array = NDArray[np.float64]

MAX_SMOOTHING_FRACTION: Final = 0.05
"""Maximum standard deviation of the filter for the target and distance of a movie's camera, as a
fraction of the movie; for the viewing direction it is twice that."""
FILTER_TRUNCATION_SIGMA: Final = 3.0
"""Number of standard deviations at which the Gaussian filters of a movie's camera path are cut off
(``truncate`` of scipy)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPath:
    """Camera and height of the ground in each picture of a movie.

    Attributes:
        views: K cameras, in pitches.
        grounds: (K,) heights of the ground.
    """

    views: tuple[View, ...]
    grounds: Array


def camera_path(
    pictures: Sequence[Array],
    *,
    lows: Array,
    radius: float,
    aspect: float,
    fps: float,
    azimuth_rad: float | None,
    elevation_rad: float,
    turn_rad: float,
) -> CameraPath:
    """Return the camera of a movie.

    Args:
        pictures: (n, 3) centres of some or all modules, for each of K pictures.
        lows: (K,) heights of the lowest module centre.
        radius: Radius of a module around its centre, pitches.
        aspect: Aspect ratio of a picture, width / height.
        fps: Pictures per second.
        azimuth_rad: Azimuth of the camera in the last picture; chosen from the points when None.
        elevation_rad: Elevation of the camera above the ground.
        turn_rad: Angle by which the camera orbits around the chain, rad.
    """
    count = len(pictures)
    smooth = min(0.5 * fps, MAX_SMOOTHING_FRACTION * count)
    turning = min(1.2 * fps, 2 * MAX_SMOOTHING_FRACTION * count)
    azimuths = np.full(count, azimuth_rad or 0.0)
    if azimuth_rad is None:
        wished = [framing(p, radius=radius, aspect=aspect).azimuth_rad for p in pictures]
        azimuths = _smooth(np.unwrap(wished), turning)
    azimuths = azimuths + turn_rad * (np.linspace(0.0, 1.0, count) - 1.0)
    views = [
        framing(
            points,
            radius=radius,
            aspect=aspect,
            azimuth_rad=float(azimuth),
            elevation_rad=elevation_rad,
            margin=(0.88, 0.82),
        )
        for points, azimuth in zip(pictures, azimuths, strict=True)
    ]
    targets = _smooth(np.array([view.target for view in views]), smooth)
    aimed = [replace(view, target=t) for view, t in zip(views, targets, strict=True)]
    needed = [
        max(
            view.distance,
            1.12 * distance_needed(points, view, radius=radius, aspect=aspect),
        )
        for points, view in zip(pictures, aimed, strict=True)
    ]
    # In the logarithm, so that approaching and receding look equally smooth.
    distances = np.exp(_above(np.log(needed), smooth))
    return CameraPath(
        views=tuple(
            replace(view, distance=float(d)) for view, d in zip(aimed, distances, strict=True)
        ),
        grounds=-_above(0.5 + GROUND_GAP_PITCH - lows, smooth),
    )


def _smooth(values: Array, deviation: float) -> Array:
    """Smooth (K, …) values along the first axis; the end values continue beyond both ends."""
    return gaussian_filter1d(
        values, deviation, axis=0, mode="nearest", truncate=FILTER_TRUNCATION_SIGMA
    )


def _above(values: Array, deviation: float) -> Array:
    """Return (K,) smooth values that are nowhere below ``values``."""
    reach = int(FILTER_TRUNCATION_SIGMA * deviation + 0.5)
    highest = maximum_filter1d(values, 2 * reach + 1, mode="nearest")
    return _smooth(highest, deviation)
