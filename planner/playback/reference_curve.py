"""Reference curve: the smooth curve through configurations that a playback follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep

SPLINE_DEGREE: Final = 3
"""Degree of the B-spline through hinge angles that a playback follows: cubic, the lowest degree
with continuous accelerations."""
REFERENCE_CHUNK_FRAMES: Final = 64
"""Maximum number of configurations of the chain whose turns and displacements are computed at
once."""
MAX_PIECE_HALVINGS: Final = 5
"""Maximum number of times that the spacing of a curve's control points is halved where the curve
brings modules too close together, as it cuts corners of the recorded motion."""
HALVED_NEIGHBOURS: Final = SPLINE_DEGREE
"""Number of neighbouring polynomial pieces of a curve, on either side, that are halved together
with a piece on which modules come too close. Equal to the spline's degree, because the control
points of a piece shape no piece further away."""
REFERENCE_CLEARANCE_PITCH: Final = 0.01
"""Clearance between modules, pitches, that the planned curve of a playback must exceed, or a
quarter of the gap between two cells if that is less: room for the joint errors of robots."""
JOINT_LIMIT_MARGIN_RAD: Final = 1e-3
"""Margin, rad, between the planned angles of a playback and the end of a joint's range, so that
joint errors of the simulated chain do not leave the range. Measured from 0.0007 to 0.0014: the same
clearance (decision 0051)."""
ARC_LENGTH_PER_TURN: Final = 8.0
"""Maximum length of a planned curve (displacements included) between two samples, as a multiple of
the turn of the fastest hinge between them: the ends of a nearly straight chain travel far while its
hinges hardly turn."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """Clamped B-spline q(u), u from 0 (straight) to 1 (folded); cubic unless it has rests.

    Attributes:
        spline, first, second: q, dq/du, d²q/du².
        length_rad: Length of the record along the curve, see ``record_lengths``.
        rests: (R,) parameters at which the chain rests, the first and the last among them; None if
            it moves all the way.
    """

    spline: Any
    first: Any
    second: Any
    length_rad: float
    rests: Array | None = None

    @classmethod
    def through(
        cls, chain: Chain, angles: Array, *, spacing_rad: float, distance_weight: float
    ) -> Reference:
        """Build the reference of a record with evenly spaced control points.

        Args:
            chain: The chain.
            angles: (F, J) configurations in the order of the playback.
            spacing_rad: Distance of the control points along the record, rad.
            distance_weight: Arc length of one pitch of displacement, rad/pitch.
        """
        lengths = record_lengths(chain, angles, distance_weight)
        return cls.of_pieces(chain, angles, lengths, _even(float(lengths[-1]), spacing_rad))

    @classmethod
    def of_pieces(cls, chain: Chain, angles: Array, lengths: Array, breaks: Array) -> Reference:
        """Build the reference whose polynomial pieces meet at given parameters.

        Args:
            chain: The chain.
            angles: (F, J) configurations in the order of the playback.
            lengths: (F,) arc length of the record up to each, rad.
            breaks: (P + 1,) ends of the pieces, rising from 0 to 1.
        """
        total = float(lengths[-1])
        knots = np.concatenate([np.zeros(SPLINE_DEGREE), breaks, np.ones(SPLINE_DEGREE)])
        # At the means of their knots, so that u runs evenly along the record at its ends too.
        positions = total * sliding_window_view(knots[1:-1], SPLINE_DEGREE).mean(axis=1)
        right, part = frames_around(lengths, positions)
        controls = (1.0 - part)[:, None] * angles[right - 1] + part[:, None] * angles[right]
        controls[0], controls[-1] = angles[0], angles[-1]
        # The stops of a simulated joint give a little. A B-spline stays within its control points,
        # and what follows it within its joint errors.
        low, high = chain.stops_rad(JOINT_LIMIT_MARGIN_RAD).T
        np.clip(controls, low, high, out=controls)
        from scipy.interpolate import BSpline  # late: who reads a plan draws no curve

        spline = BSpline(knots, controls, SPLINE_DEGREE)
        first = spline.derivative()
        return cls(spline=spline, first=first, second=first.derivative(), length_rad=total)

    def places(self, turn_rad: float) -> Array:
        """Return (S + 1,) parameters from 0 to 1, ``turn_rad`` of the fastest hinge apart.

        A nearly straight chain whips: its ends go far while its hinges hardly turn. There the
        arc length decides, ``ARC_LENGTH_PER_TURN`` times the turn.
        """
        even = np.linspace(0.0, 1.0, max(2, int(np.ceil(self.length_rad / turn_rad))) + 1)
        steps = self.steps_rad(even)
        distances = np.concatenate(
            [
                [0.0],
                np.cumsum(np.maximum(steps, np.diff(even) * self.length_rad / ARC_LENGTH_PER_TURN)),
            ]
        )
        count = max(2, int(np.ceil(distances[-1] / turn_rad)))
        places = np.interp(np.linspace(0.0, distances[-1], count + 1), distances, even)
        places[0], places[-1] = 0.0, 1.0
        return places

    def steps_rad(self, places: Array) -> Array:
        """Return the (S,) largest turn of a hinge between neighbours of S + 1 parameters, rad."""
        return np.concatenate(
            [
                np.abs(
                    np.diff(self.spline(places[k : k + REFERENCE_CHUNK_FRAMES + 1]), axis=0)
                ).max(axis=1)
                for k in range(0, len(places) - 1, REFERENCE_CHUNK_FRAMES)
            ]
        )


def resting_reference(rests: Array) -> Reference:
    """Return the reference that goes from one pose to the next in straight lines.

    It has corners, which only a motion that rests there can follow: ``resting_scaling``.

    Args:
        rests: (R, J) configurations in the order of the playback.
    """
    from scipy.interpolate import BSpline  # as above

    lengths = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(rests, axis=0)).max(axis=1))])
    total = float(lengths[-1])
    at = lengths / total if total else np.linspace(0.0, 1.0, len(rests))
    spline = BSpline(np.concatenate([at[:1], at, at[-1:]]), rests, 1)
    first = spline.derivative()

    def second(u: Array) -> Array:
        return 0.0 * first(u)

    return Reference(spline=spline, first=first, second=second, length_rad=total, rests=at)


def frames_around(lengths: Array, at: Array) -> tuple[Ints, Array]:
    """Find the frames of a record between which some arc lengths lie.

    Args:
        lengths: (F,) arc length of the record up to each frame, rad.
        at: (P,) arc lengths, rad.

    Returns:
        (P,) numbers of the later frames, and (P,) fractions of the way from the earlier ones.
    """
    after = np.clip(np.searchsorted(lengths, at), 1, max(1, len(lengths) - 1))
    span = lengths[after] - lengths[after - 1]
    part = np.where(span > 0, (at - lengths[after - 1]) / np.where(span > 0, span, 1), 1.0)
    return after, part


def clear_reference(
    chain: Chain, angles: Array, *, spacing_rad: float, distance_weight: float, module_size: float
) -> Reference:
    """Return the reference of a record, with control points dense enough to keep clear.

    A spline cuts corners between its control points. Pieces that bring modules too close, and only
    those, are halved, ``MAX_PIECE_HALVINGS`` times at most; the certificate has the last word.

    Args:
        chain: The chain.
        angles: (F, J) configurations in the order of the playback.
        spacing_rad: Distance of the control points along the record at first, rad.
        distance_weight: Arc length of one pitch of displacement, rad/pitch.
        module_size: Module size as a fraction of the pitch.
    """
    # Some room is left for the playback's joint errors: a quarter of the gap between two cells.
    room = min(REFERENCE_CLEARANCE_PITCH, 0.25 * (1.0 - module_size))
    lengths = record_lengths(chain, angles, distance_weight)
    breaks = _even(float(lengths[-1]), spacing_rad)
    for _ in range(MAX_PIECE_HALVINGS):
        reference = Reference.of_pieces(chain, angles, lengths, breaks)
        places = reference.places(0.04)
        close = _too_close(chain, reference.spline(places), module_size, room)
        if not close.any():
            return reference
        breaks = _halved(breaks, places[close])
    return Reference.of_pieces(chain, angles, lengths, breaks)


def _even(total_rad: float, spacing_rad: float) -> Array:
    """Return even breaks of pieces for control points about ``spacing_rad`` apart."""
    count = max(SPLINE_DEGREE + 1, int(np.ceil(total_rad / spacing_rad)) + 1)
    return np.linspace(0.0, 1.0, count - SPLINE_DEGREE + 1)


def _too_close(chain: Chain, samples: Array, module_size: float, room: float) -> Flags:
    """Return (S,) True if modules are nearer than ``room`` at a sample, or beside it."""
    swept = sweep(chain, samples, module_size=module_size, share=0.0)
    close = swept.per_frame <= room
    if swept.clearance <= room:
        close[[int(np.floor(swept.frame)), int(np.ceil(swept.frame))]] = True
    return close


def _halved(breaks: Array, places: Array) -> Array:
    """Return breaks with a new one in the middle of each piece at or beside ``places``."""
    pieces = len(breaks) - 1
    at = np.clip(np.searchsorted(breaks, places, "right") - 1, 0, pieces - 1)
    near = np.unique((at[:, None] + np.arange(-HALVED_NEIGHBOURS, HALVED_NEIGHBOURS + 1)).ravel())
    near = near[(near >= 0) & (near < pieces)]
    return np.sort(np.concatenate([breaks, 0.5 * (breaks[near] + breaks[near + 1])]))


def record_lengths(chain: Chain, angles: Array, distance_weight: float) -> Array:
    """Return the (F,) arc length of a record up to each configuration, rad.

    A step counts as its largest hinge motion, or as its largest displacement of a module (centre of
    mass fixed) times the weight, whichever is more: a nearly straight chain whips.
    """
    steps = np.zeros(len(angles))
    origin, upright = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for start in range(0, len(angles) - 1, REFERENCE_CHUNK_FRAMES):
        part = angles[start : start + REFERENCE_CHUNK_FRAMES + 1]
        centres = chain.poses(part, origin, upright).positions
        centres = centres - centres.mean(axis=1, keepdims=True)
        moved = np.sqrt((np.diff(centres, axis=0) ** 2).sum(axis=2).max(axis=1))
        turned = np.abs(np.diff(part, axis=0)).max(axis=1)
        steps[start + 1 : start + len(part)] = np.maximum(turned, distance_weight * moved)
    return np.cumsum(steps)
