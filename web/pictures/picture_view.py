"""Picture view: the frame and the camera that a link states in its ``view=``."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.plan.tour import CAMERA_PATTERN
from foldback.web.pictures.camera import ELEVATION_RAD, View, distance_needed, framing

Array = NDArray[np.float64]

SHORT_FORM_PATTERN: Final = rf"^\d{{1,9}},{CAMERA_PATTERN}$"
"""Matches a camera view in an address: frame from 1, azimuth and elevation in degrees (or empty),
distance as a multiple of the default one and, if the camera does not follow the chain, its
horizontal and vertical offset."""
MAX_SHORT_FORM_LENGTH: Final = 64
"""Maximum length of the text in a link that states the position of the camera, in characters; a
longer one is ignored, so that the default position is used."""
MAX_ELEVATION_RAD: Final = 1.56
"""Largest elevation of the camera, in rad; at π/2 it would look straight down, where the upward
direction of the picture is undefined. ``js/player/camera_rig.js`` has the same."""
MAX_DISTANCE_SCALE: Final = 40.0
"""Largest distance of the camera from the chain, as a multiple of the default one. ``FARTHEST`` in
``js/player/camera_rig.js`` is the same."""
MIN_DISTANCE_SCALE: Final = 0.02
"""Smallest distance of the camera from the chain, as a multiple of the default one. ``MIN_DEPTH``
in ``js/player/camera_rig.js`` is the same."""
MIN_FOLLOW_DISTANCE_SCALE: Final = 1.08
"""Smallest distance of a camera that follows the chain, as a multiple of the distance at which the
chain touches the picture's edge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureView:
    """A frame of a fold and a camera relative to its chain.

    Attributes:
        frame: Frame, from 0.
        azimuth_rad: Azimuth of the camera; chosen from the chain when None.
        elevation_rad: Elevation of the camera above the ground; the default when None.
        zoom: Distance of the camera, as a multiple of the default.
        aside: Offset of its target from the chain to the right and up, as multiples of the default
            distance; None if it follows.
    """

    frame: int
    azimuth_rad: float | None = None
    elevation_rad: float | None = None
    zoom: float = 1.0
    aside: tuple[float, float] | None = None

    @classmethod
    def from_short(cls, text: str) -> PictureView | None:
        """Return the view of a short form; None if the text is invalid."""
        if len(text) > MAX_SHORT_FORM_LENGTH or not re.fullmatch(
            SHORT_FORM_PATTERN, text, re.ASCII
        ):
            return None
        frame, azimuth, elevation, zoom, *extra = text.split(",")
        return cls(
            frame=max(0, int(frame) - 1),
            azimuth_rad=float(np.deg2rad(float(azimuth))) if azimuth else None,
            elevation_rad=float(np.deg2rad(float(elevation))) if elevation else None,
            zoom=min(MAX_DISTANCE_SCALE, max(MIN_DISTANCE_SCALE, float(zoom))),
            aside=(float(extra[0]), float(extra[1])) if extra else None,
        )

    def camera(
        self, points: Array, *, radius: float, aspect: float, margin: tuple[float, float]
    ) -> View:
        """Return the camera for a chain whose modules are at ``points`` (n, 3)."""
        elevation = ELEVATION_RAD if self.elevation_rad is None else self.elevation_rad
        base = framing(
            points,
            radius=radius,
            aspect=aspect,
            azimuth_rad=self.azimuth_rad,
            elevation_rad=float(np.clip(elevation, -MAX_ELEVATION_RAD, MAX_ELEVATION_RAD)),
            margin=margin,
        )
        target, distance = base.target, self.zoom * base.distance
        if self.aside is None:
            needed = distance_needed(points, base, radius=radius, aspect=aspect)
            distance = max(distance, MIN_FOLLOW_DISTANCE_SCALE * needed)
        else:
            target = target + base.distance * (self.aside @ base.axes[:2])
        return replace(base, target=target, distance=distance)
