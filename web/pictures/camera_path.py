"""Camera path: the camera of a whole movie, which knows what comes and what was.

A camera that follows a live view can only lag behind. This one is smoothed over the whole movie at
once, the same forwards and backwards in time, and never cuts anything off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from web.pictures.camera import View, distance_needed, framing

Array = NDArray[np.float64]

SMOOTH_S: Final = 0.5
"""Standard deviation, in seconds of the movie, of the filter that smooths a camera's way."""
TURNING_S: Final = 1.2
"""Standard deviation of the filter that smooths its direction."""
LONGEST_SHARE: Final = 0.05
"""Share of the movie that a standard deviation may be, so that short ones still zoom in."""
REACH: Final = 3.0
"""Standard deviations at which the filters are cut off."""
MARGIN: Final = (0.88, 0.82)
"""Shares of the width and the height of a picture that are filled."""
ROOM: Final = 1.12
"""Factor of the distance at which all would just fit in."""
GROUND_GAP: Final = 0.35


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPath:
    """Where the camera and the ground are in each picture.

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
    """The camera of a movie.

    Args:
        pictures: K times (n, 3) centres of some or all modules.
        lows: (K,) heights of the lowest centre of all.
        radius: How far a module reaches from its centre.
        aspect: Width of a picture by its height.
        fps: Pictures a second.
        azimuth_rad: Direction that the last picture is seen from; chosen from the points when None.
        elevation_rad: Angle above the ground to look from.
        turn_rad: How far the camera goes around on its way.
    """
    count = len(pictures)
    smooth = min(SMOOTH_S * fps, LONGEST_SHARE * count)
    turning = min(TURNING_S * fps, 2 * LONGEST_SHARE * count)
    azimuths = np.full(count, azimuth_rad or 0.0)
    if azimuth_rad is None:
        wished = [framing(p, radius=radius, aspect=aspect).azimuth_rad for p in pictures]
        azimuths = _smooth(np.unwrap(wished), turning)
    azimuths = azimuths + turn_rad * (np.linspace(0.0, 1.0, count) - 1.0)
    wanted = [
        framing(
            points,
            radius=radius,
            aspect=aspect,
            azimuth_rad=float(azimuth),
            elevation_rad=elevation_rad,
            margin=MARGIN,
        )
        for points, azimuth in zip(pictures, azimuths, strict=True)
    ]
    targets = _smooth(np.array([view.target for view in wanted]), smooth)
    aimed = [replace(view, target=t) for view, t in zip(wanted, targets, strict=True)]
    needed = [
        max(view.distance, ROOM * distance_needed(points, view, radius=radius, aspect=aspect))
        for points, view in zip(pictures, aimed, strict=True)
    ]
    # In the logarithm, so that coming nearer looks as even as going away.
    distances = np.exp(_above(np.log(needed), smooth))
    return CameraPath(
        views=tuple(
            replace(view, distance=float(d)) for view, d in zip(aimed, distances, strict=True)
        ),
        grounds=-_above(0.5 + GROUND_GAP - lows, smooth),
    )


def _smooth(values: Array, deviation: float) -> Array:
    """(K, …) values smoothed along the first axis; at rest at both ends."""
    return gaussian_filter1d(values, deviation, axis=0, mode="nearest", truncate=REACH)


def _above(values: Array, deviation: float) -> Array:
    """(K,) smooth values that are nowhere below those given."""
    reach = int(REACH * deviation + 0.5)
    highest = maximum_filter1d(values, 2 * reach + 1, mode="nearest")
    return _smooth(highest, deviation)
