"""Reference: the smooth curve through configurations that a playback follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import sweep

Array = NDArray[np.float64]
DEGREE: Final = 3
CHUNK: Final = 64
MOST_HALVINGS: Final = 5
"""Times that control points are doubled where the curve comes too close: they are then nearer to
each other than the snapshots of a record, and the curve is the record itself."""
AROUND: Final = DEGREE
"""Pieces on either side of a close one that are halved with it: a control point reaches so far."""
ROOM: Final = 0.01
"""Clearance in pitches to keep, or a quarter of the gap between two cells where that is less."""
STOP_ROOM_RAD: Final = 1e-3
"""Angle that a reference keeps from the end of a joint's range, for errors of its playback."""
SAMPLE_RAD: Final = 0.04
"""Turn of a hinge between two places that are checked for overlaps, on the way to the next too."""
WHIP: Final = 8.0
"""Length of a reference that counts as much as its hinges' turn."""


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
        """The reference of a record, its control points evenly spaced.

        Args:
            chain: The chain.
            angles: (F, J) configurations in the order of the playback.
            spacing_rad: Distance of the control points along the record.
            distance_weight: Radians that one pitch of displacement counts as.
        """
        lengths = record_lengths(chain, angles, distance_weight)
        return cls.of_pieces(chain, angles, lengths, _even(float(lengths[-1]), spacing_rad))

    @classmethod
    def of_pieces(cls, chain: Chain, angles: Array, lengths: Array, breaks: Array) -> Reference:
        """The reference whose polynomial pieces meet at given places.

        Args:
            chain: The chain.
            angles: (F, J) configurations in the order of the playback.
            lengths: (F,) length of the record up to each.
            breaks: (P + 1,) where pieces begin and end, rising from 0 to 1.
        """
        total = float(lengths[-1])
        knots = np.concatenate([np.zeros(DEGREE), breaks, np.ones(DEGREE)])
        # At the means of their knots, so that u runs evenly along the record at its ends too.
        where = total * sliding_window_view(knots[1:-1], DEGREE).mean(axis=1)
        right = np.clip(np.searchsorted(lengths, where), 1, len(lengths) - 1)
        span = lengths[right] - lengths[right - 1]
        part = np.where(span > 0, (where - lengths[right - 1]) / np.where(span > 0, span, 1), 1.0)
        controls = (1.0 - part)[:, None] * angles[right - 1] + part[:, None] * angles[right]
        controls[0], controls[-1] = angles[0], angles[-1]
        # The stops of a simulated joint give a little. A B-spline stays within its control points,
        # and what follows it within its joint errors.
        limit = chain.module.angle_limit_rad - STOP_ROOM_RAD
        np.clip(controls, -limit, limit, out=controls)
        from scipy.interpolate import BSpline  # late: who reads a plan draws no curve

        spline = BSpline(knots, controls, DEGREE)
        first = spline.derivative()
        return cls(spline=spline, first=first, second=first.derivative(), length_rad=total)

    def places(self, turn_rad: float) -> Array:
        """(S + 1,) places from 0 to 1, one after each turn of the fastest hinge by so much.

        A nearly straight chain whips: its ends go far while its hinges hardly turn. There the
        length decides, ``WHIP`` times the turn.
        """
        even = np.linspace(0.0, 1.0, max(2, int(np.ceil(self.length_rad / turn_rad))) + 1)
        steps = self.steps_rad(even)
        gone = np.concatenate(
            [[0.0], np.cumsum(np.maximum(steps, np.diff(even) * self.length_rad / WHIP))]
        )
        count = max(2, int(np.ceil(gone[-1] / turn_rad)))
        places = np.interp(np.linspace(0.0, gone[-1], count + 1), gone, even)
        places[0], places[-1] = 0.0, 1.0
        return places

    def steps_rad(self, places: Array) -> Array:
        """(S,) the largest turn of a hinge between each two neighbours of S + 1 places."""
        return np.concatenate(
            [
                np.abs(np.diff(self.spline(places[k : k + CHUNK + 1]), axis=0)).max(axis=1)
                for k in range(0, len(places) - 1, CHUNK)
            ]
        )


def clear_reference(
    chain: Chain, angles: Array, *, spacing_rad: float, distance_weight: float, size: float
) -> Reference:
    """The reference of a record, with control points as dense as it takes to touch nothing.

    A spline cuts corners between its control points. Where that brings modules too close, and there
    alone, pieces are halved, some times at most; the certificate has the last word.

    Args:
        chain: The chain.
        angles: (F, J) configurations in the order of the playback.
        spacing_rad: Distance of the control points along the record, at first.
        distance_weight: Radians that one pitch of displacement counts as.
        size: Module size as a fraction of the pitch.
    """
    # Some room is left for the playback's joint errors: a quarter of the gap between two cells.
    room = min(ROOM, 0.25 * (1.0 - size))
    lengths = record_lengths(chain, angles, distance_weight)
    breaks = _even(float(lengths[-1]), spacing_rad)
    for _ in range(MOST_HALVINGS):
        reference = Reference.of_pieces(chain, angles, lengths, breaks)
        places = reference.places(SAMPLE_RAD)
        close = _too_close(chain, reference.spline(places), size, room)
        if not close.any():
            return reference
        breaks = _halved(breaks, places[close])
    return Reference.of_pieces(chain, angles, lengths, breaks)


def _even(total_rad: float, spacing_rad: float) -> Array:
    """Breaks of pieces for so many control points at that distance, about."""
    count = max(DEGREE + 1, int(np.ceil(total_rad / spacing_rad)) + 1)
    return np.linspace(0.0, 1.0, count - DEGREE + 1)


def _too_close(chain: Chain, samples: Array, size: float, room: float) -> NDArray[np.bool_]:
    """(S,) whether modules come nearer than ``room`` at a sample, or on the way to a next one."""
    swept = sweep(chain, samples, size=size, share=0.0)
    close = swept.per_frame <= room
    if swept.clearance <= room:
        close[[int(np.floor(swept.frame)), int(np.ceil(swept.frame))]] = True
    return close


def _halved(breaks: Array, places: Array) -> Array:
    """Breaks with a new one in the middle of each piece at or beside these places."""
    pieces = len(breaks) - 1
    at = np.clip(np.searchsorted(breaks, places, "right") - 1, 0, pieces - 1)
    near = np.unique((at[:, None] + np.arange(-AROUND, AROUND + 1)).ravel())
    near = near[(near >= 0) & (near < pieces)]
    return np.sort(np.concatenate([breaks, 0.5 * (breaks[near] + breaks[near + 1])]))


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
