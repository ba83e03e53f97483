"""Camera: keeps the whole chain in view, smoothly, until a visitor takes hold of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FIELD_OF_VIEW_RAD: Final = np.deg2rad(32.0)
AZIMUTH_RAD: Final = np.deg2rad(-62.0)
ELEVATION_RAD: Final = np.deg2rad(24.0)
TURN_RAD_S: Final = np.deg2rad(5.0)
SETTLE_S: Final = 0.14
SETTLED: Final = 2e-4
MOST_POINTS: Final = 600
WIDE: Final = 1.6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Where a camera stands and looks: ``target`` (3,), direction angles and distance."""

    target: Array
    azimuth_rad: float
    elevation_rad: float
    distance: float

    @property
    def position(self) -> Array:
        """(3,) where the camera is."""
        return self.target + self.distance * _outward(self.azimuth_rad, self.elevation_rad)


def framing(
    points: Array,
    *,
    radius: float,
    aspect: float = WIDE,
    azimuth_rad: float | None = None,
    elevation_rad: float = ELEVATION_RAD,
    margin: tuple[float, float] = (0.9, 0.72),
) -> View:
    """The nearest view that shows all points.

    A long chain is looked at from its side, on a tall window from nearer its end.

    Args:
        points: (n, 3) centres.
        radius: How far a module reaches from its centre.
        aspect: Width of the window by its height.
        azimuth_rad: Direction to look from; chosen from the points when None.
        elevation_rad: Angle above the ground to look from.
        margin: Shares of the window's width and height to fill.
    """
    some = points[:: max(1, len(points) // MOST_POINTS)].astype(np.float64)
    if azimuth_rad is None:
        azimuth_rad = _azimuth(some, aspect)
    out = _outward(azimuth_rad, elevation_rad)
    right = np.array([-np.sin(azimuth_rad), np.cos(azimuth_rad), 0.0])
    up = np.cross(out, right)
    local = np.column_stack([some @ right, some @ up, some @ out])
    middle = (local.min(axis=0) + local.max(axis=0)) / 2
    tall = np.tan(FIELD_OF_VIEW_RAD / 2)
    wide = tall * aspect
    distance = radius
    for _ in range(3):  # perspective shifts the middle; a few rounds centre the picture
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
    target = middle[0] * right + middle[1] * up + middle[2] * out
    return View(
        target=target,
        azimuth_rad=azimuth_rad,
        elevation_rad=elevation_rad,
        distance=distance,
    )


def distance_needed(points: Array, view: View, *, radius: float, aspect: float) -> float:
    """The least distance from which a view cuts nothing off, for the target that it has."""
    out = _outward(view.azimuth_rad, view.elevation_rad)
    right = np.array([-np.sin(view.azimuth_rad), np.cos(view.azimuth_rad), 0.0])
    off = points[:: max(1, len(points) // MOST_POINTS)] - view.target
    tall = np.tan(FIELD_OF_VIEW_RAD / 2)
    depth = off @ out
    sideways = (np.abs(off @ right) + radius) / (tall * aspect) + depth
    upwards = (np.abs(off @ np.cross(out, right)) + radius) / tall + depth
    return float(max(sideways.max(), upwards.max()))


def blended(views: list[View], weights: Array, *, nearest: View) -> View:
    """A view between several, from as far as the one that must not be cut off needs."""
    share = weights / weights.sum()
    turns = [(v.azimuth_rad - nearest.azimuth_rad + np.pi) % (2 * np.pi) - np.pi for v in views]
    target = np.sum([w * v.target for w, v in zip(share, views, strict=True)], axis=0)
    mean = float(np.exp(share @ np.log([v.distance for v in views])))
    aside = float(np.linalg.norm(target - nearest.target))
    return View(
        target=target,
        azimuth_rad=nearest.azimuth_rad + float(share @ np.array(turns)),
        elevation_rad=nearest.elevation_rad,
        distance=max(mean, nearest.distance + aside),
    )


class Follower:
    """A camera that glides to the view it should have."""

    def __init__(self) -> None:
        self.view: View | None = None
        self._goal: View | None = None

    def aim(self, goal: View, *, at_once: bool = False) -> None:
        """Sets where to go; ``at_once`` jumps there."""
        self._goal = goal
        if at_once or self.view is None:
            self.view = goal

    def move(self, seconds: float) -> bool:
        """Glides on for some time; True while the camera moves."""
        if self.view is None or self._goal is None or self.view is self._goal:
            return False
        goal, view = self._goal, self.view
        share = 1.0 - float(np.exp(-seconds / SETTLE_S))
        turn = (goal.azimuth_rad - view.azimuth_rad + np.pi) % (2 * np.pi) - np.pi
        rise = goal.elevation_rad - view.elevation_rad
        off = float(np.linalg.norm(goal.target - view.target)) / goal.distance
        if max(off, abs(turn), abs(rise), abs(goal.distance / view.distance - 1)) < SETTLED:
            self.view = goal
            return True
        self.view = View(
            target=view.target + (goal.target - view.target) * share,
            azimuth_rad=view.azimuth_rad + turn * share,
            elevation_rad=view.elevation_rad + rise * share,
            distance=view.distance * (goal.distance / view.distance) ** share,
        )
        return True


def angles_of(position: Array, target: Array) -> tuple[float, float]:
    """Azimuth and elevation from which ``position`` looks at ``target``."""
    out = (position - target) / max(float(np.linalg.norm(position - target)), 1e-9)
    return float(np.arctan2(out[1], out[0])), float(np.arcsin(np.clip(out[2], -1.0, 1.0)))


def _outward(azimuth: float, elevation: float) -> Array:
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _azimuth(points: Array, aspect: float) -> float:
    spread = points - points.mean(axis=0)
    values, axes = np.linalg.eigh(spread.T @ spread)
    longest = axes[:, 2]
    level = float(np.hypot(longest[0], longest[1]))
    slim = 1.0 - np.sqrt(max(float(values[1]), 0.0) / max(float(values[2]), 1e-12))
    weight = float(np.clip((slim - 0.4) / 0.4, 0.0, 1.0)) * level
    along = float(np.arctan2(longest[1], longest[0]))
    aside = np.deg2rad(68.0) if aspect >= 1.0 else np.deg2rad(30.0)
    options = [along + half + side for half in (0.0, np.pi) for side in (-aside, aside)]
    turns = [(option - AZIMUTH_RAD + np.pi) % (2 * np.pi) - np.pi for option in options]
    return float(AZIMUTH_RAD + weight * min(turns, key=abs))
