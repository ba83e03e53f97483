"""Reference: the smooth curve through configurations that a playback follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from planner.chain import Chain

Array = NDArray[np.float64]
DEGREE: Final = 3
CHUNK: Final = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """A clamped cubic B-spline q(u), u from 0 (straight) to 1 (folded).

    Attributes:
        spline, first, second: q, dq/du, d²q/du².
        length_rad: Length of the record along the curve, see ``record_lengths``.
    """

    spline: Any
    first: Any
    second: Any
    length_rad: float

    @classmethod
    def through(
        cls, chain: Chain, angles: Array, *, spacing_rad: float, distance_weight: float
    ) -> Reference:
        """The reference of a record.

        Args:
            chain: The chain.
            angles: (F, J) configurations in the order of the playback.
            spacing_rad: Distance of the control points along the record.
            distance_weight: Radians that one pitch of displacement counts as.
        """
        lengths = record_lengths(chain, angles, distance_weight)
        total = float(lengths[-1])
        count = max(DEGREE + 1, int(np.ceil(total / spacing_rad)) + 1)
        where = np.linspace(0.0, total, count)
        right = np.clip(np.searchsorted(lengths, where), 1, len(lengths) - 1)
        span = lengths[right] - lengths[right - 1]
        part = np.where(span > 0, (where - lengths[right - 1]) / np.where(span > 0, span, 1), 1.0)
        controls = (1.0 - part)[:, None] * angles[right - 1] + part[:, None] * angles[right]
        controls[0], controls[-1] = angles[0], angles[-1]
        knots = np.concatenate(
            [np.zeros(DEGREE), np.linspace(0.0, 1.0, count - DEGREE + 1), np.ones(DEGREE)]
        )
        spline = BSpline(knots, controls, DEGREE)
        first = spline.derivative()
        return cls(spline=spline, first=first, second=first.derivative(), length_rad=total)


def record_lengths(chain: Chain, angles: Array, distance_weight: float) -> Array:
    """(F,) length of a record up to each configuration, in radians.

    A step counts as its largest hinge motion, or as its largest displacement of a module (centre of
    mass fixed) times the weight, whichever is more: a nearly straight chain whips.
    """
    steps = np.zeros(len(angles))
    origin, upright = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for start in range(0, len(angles) - 1, CHUNK):
        part = angles[start : start + CHUNK + 1]
        centres = chain.poses(part, origin, upright).positions
        centres = centres - centres.mean(axis=1, keepdims=True)
        moved = np.sqrt((np.diff(centres, axis=0) ** 2).sum(axis=2).max(axis=1))
        turned = np.abs(np.diff(part, axis=0)).max(axis=1)
        steps[start + 1 : start + len(part)] = np.maximum(turned, distance_weight * moved)
    return np.cumsum(steps)
