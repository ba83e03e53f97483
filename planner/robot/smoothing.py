"""Smoothing: a shorter and quieter motion between the same two configurations, as clear as before.

Time and again a simpler motion is drawn up: straight lines between some frames, or a running mean
of every hinge over many. It is followed as far as it is clear. Two modules lie to each other as the
hinges between them have it, so where two come too close only those hinges go back to what they did,
around those frames; all others keep what they gained. These are shortcuts of any part of the chain
in any part of the motion (Geraerts, Overmars: Creating high-quality paths for motion planning,
2007; Hauser, Ng-Thow-Hing: Fast smoothing of manipulator trajectories using optimal
bounded-acceleration shortcuts, 2010), with collisions to choose the part instead of chance.

A shorter motion may take more torque: straight lines have kinks, and what a simulation recorded has
none. So what a motion costs is its length and the time that it takes with bounded torque.

Every motion that is kept has been proved clear by ``planner.clearance.sweep``, all between its
frames too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from planner.chain.chain import Chain
from planner.chain.dynamics import floating_torques
from planner.clearance.sweep import Sweep, sweep
from planner.errors import InputError
from planner.kernels.smoothing import mark_blamed_hinges, write_displacements
from planner.progress import Cancelled, never
from planner.robot.smoothing_targets import along, mean, parts, softened, straight, worthwhile

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

LOOKS: Final = 20_000
"""Configurations whose clearance one smoothing may check."""
TORQUE_WEIGHTS: Final = ((0.6, 0.15), (1.0, 0.6))
"""(share of the looks, weight of torque in units of the length's weight): up to that share it
weighs so much. Little at first, as what is tangled gets shorter by way of more torque."""
TIGHT: Final = 0.98
"""Module size, of a pitch, at which modules must not come nearer than in the record."""
FRAMES: Final = 150
"""Frames of a motion that is smoothed, about."""
SPACING_RAD: Final = (0.015, 0.06)
"""Smallest and largest length between two frames, in rad."""
SLACK: Final = 0.001
"""Clearance in pitches that frames, and places halfway between, have beyond what is asked for."""
PIECES: Final = (1, 3, 6, 12, 24, 48)
"""Parts of a motion that are simplified in turn."""
FEWEST_FRAMES: Final = 4
GENTLE_ROUNDS: Final = 1
STERN_ROUNDS: Final = 6
MOST_ROUNDS: Final = 14
LEAST_SHARE: Final = 0.02
WORTHWHILE: Final = 0.005
"""Share of the effort that a pass must gain; after one that gains less there is one more."""
MOST_REPAIRS: Final = 6
ROUNDING: Final = 1e-9
LEAST_BOUND: Final = 1e-9
LEAST_EFFORT: Final = 1e-9
LEAST_SPAN_RAD: Final = 1e-6
DISTANCE_WEIGHT: Final = 0.03
"""Radians that a displacement of one pitch counts as: ``PlaybackParameters.distance_weight``."""
RUN: Final = 6
"""Steps that one sweep checks."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smoothed:
    """A motion that was smoothed.

    Attributes:
        angles: (F, J) hinge angles; the first and the last frame are those that were given.
        looks: Configurations that were looked at.
    """

    angles: Array
    looks: int


def smooth(
    chain: Chain,
    angles: Array,
    *,
    size: float,
    seed: int = 0,
    looks: int = LOOKS,
    told: Callable[[float], None] | None = None,
    cancelled: Cancelled = never,
) -> Smoothed:
    """Smooths a motion. What comes of it depends on the arguments alone.

    Args:
        chain: The chain.
        angles: (F, J) configurations in either order of time, hinges running evenly between them.
        size: Module size that the motion is to be verified at, as a fraction of the pitch. At the
            larger of it and ``TIGHT`` the smoothed motion is as clear as the given one where both
            are looked at, and clear in between.
        seed: Decides where straight lines begin.
        looks: About how many configurations may be looked at. One costs some 0.6 µs of processor
            time for each cube, three times as much for each tetrahedron.
        told: Is told which part of the looks is used up, now and then.
        cancelled: Asked now and then whether to stop and take what there is.

    Raises:
        InputError: ``wrong-shape`` for angles that are not frames of this chain.
    """
    hinges = len(chain.folded_rad)
    if angles.ndim != 2 or angles.shape[1] != hinges or not len(angles):
        raise InputError(
            "wrong-shape",
            f"got angles of the shape {angles.shape}, expected frames of {hinges} hinge angles.",
        )
    angles = np.ascontiguousarray(angles, dtype=np.float64)
    run = _Smoothing(chain, angles, size, looks, np.random.default_rng(seed), told)
    return Smoothed(angles=run.smoothed(cancelled), looks=run.looks)


def spacing_of(length_rad: float) -> float:
    """How far apart the frames of a motion of some length are."""
    return float(np.clip(length_rad / FRAMES, *SPACING_RAD))


class _Smoothing:
    def __init__(
        self,
        chain: Chain,
        angles: Array,
        size: float,
        looks: int,
        rng: np.random.Generator,
        told: Callable[[float], None] | None,
    ) -> None:
        self.chain = chain
        self.all_looks = looks
        self.told = told
        self.size = size
        self.tight = max(size, TIGHT)
        self.most_looks = looks
        self.looks = 0
        self.rng = rng
        self.given = angles
        found = self._swept(angles)
        self.margin = found.clearance
        self.bound = min(found.bound, LEAST_BOUND)
        length = float(self._measured(angles)[0].sum())
        self.spacing = spacing_of(length)
        self.torque_weight = 0.0

    def smoothed(self, cancelled: Cancelled) -> Array:
        """(F, J) the best motion found."""
        best = self._resampled(self.given)
        if len(best) < FEWEST_FRAMES:
            return best
        lengths, costs = self._measured(best)
        unit = costs.sum() / max(float(self._efforts(best, lengths).sum()), LEAST_EFFORT)
        whole = self.most_looks
        for share, weight in TORQUE_WEIGHTS:
            self.most_looks = int(share * whole)
            self.torque_weight = weight * unit
            best = self._cheaper(best, cancelled)
        return best

    def _cheaper(self, best: Array, cancelled: Cancelled) -> Array:
        """(F, J) a motion that costs as little as passes can bring it to."""
        stale = 0
        while stale < 2 and self.looks < self.most_looks and not cancelled():
            found = self._resampled(self._simplified(best, cancelled))
            gain = 1.0 - self._costs(found).sum() / self._costs(best).sum()
            if gain <= 0.0:
                break
            best = found
            stale = stale + 1 if gain < WORTHWHILE else 0
        return best

    def _simplified(self, angles: Array, cancelled: Cancelled) -> Array:
        """One pass of straight lines and means over ever smaller parts."""
        costs = self._costs(angles)
        for lines in (True, False):
            for pieces in PIECES:
                if self.looks >= self.most_looks or cancelled():
                    return angles
                if self.told is not None:
                    self.told(self.looks / self.all_looks)
                if len(angles) < FEWEST_FRAMES * pieces:
                    break
                begins = parts(len(angles), pieces, self.rng)
                target = straight(angles, begins) if lines else mean(angles, pieces)
                worth = worthwhile(costs, self._costs(target), begins)
                if not worth.any():
                    continue
                found = self._followed(angles, target, worth, float(costs.sum()))
                if found is not None:
                    angles = self._refined(found)
                    costs = self._costs(angles)
        return angles

    def _followed(
        self, angles: Array, target: Array, worth: Flags, most_cost: float
    ) -> Array | None:
        """A motion on the way to a target, as far as frames and some places between are clear.

        Args:
            angles, target: (F, J), the first and last frame the same.
            worth: (F,) whether the target is to be followed there at all.
            most_cost: It must cost less than this.
        """
        shares = softened(np.repeat(worth.astype(np.float64)[:, None], angles.shape[1], axis=1))
        unknown: Flags = np.ones(len(angles), dtype=np.bool_)
        unknown_ways: Flags = unknown.copy()
        for turn in range(MOST_ROUNDS):
            found = angles + shares * (target - angles)
            moved: Flags = shares.max(axis=1) > 0.0
            blamed = np.zeros(angles.shape, dtype=np.bool_)
            rows = np.flatnonzero(unknown & moved)
            blamed[rows] = self._blamed(found[rows])
            unknown_ways |= unknown
            if not blamed.any():
                if not moved.any() or self._costs(found).sum() >= most_cost:
                    return None
                ways = np.flatnonzero(
                    (unknown_ways[:-1] | unknown_ways[1:]) & (moved[:-1] | moved[1:])
                )
                unknown_ways[:] = False
                unknown_ways[self._blame_between(found, ways, blamed)] = True
                if not blamed.any():
                    return found
            if turn >= STERN_ROUNDS:
                blamed[blamed.any(axis=1)] = True
            kept = np.where(blamed, 0.5 if turn < GENTLE_ROUNDS else 0.0, 1.0)
            lower = shares * minimum_filter1d(kept, 3, axis=0)
            lower[lower < LEAST_SHARE] = 0.0
            lower = softened(lower)
            unknown = np.abs(lower - shares).max(axis=1) > 0.0
            shares = lower
        return None

    def _blamed(self, angles: Array, *, slack: float = SLACK) -> Flags:
        """(F, J) the hinges between modules that are closer than they may be."""
        module = self.chain.module
        blamed = np.zeros(angles.shape, dtype=np.bool_)
        self.looks += len(angles)
        mark_blamed_hinges(
            angles,
            module.joint,
            module.hull,
            module.apart,
            self.tight,
            self.margin + slack,
            blamed,
        )
        return blamed

    def _blame_between(self, angles: Array, ways: Ints, blamed: Flags) -> Ints:
        """Marks the hinges that bring modules too close between frames, at both ends of the step.

        Of several steps in a row only those at the closest place are marked.

        Args:
            angles: (F, J).
            ways: (W,) numbers of the steps that are looked at.
            blamed: (F, J) written.

        Returns:
            The steps among which there may be more.
        """
        module = self.chain.module
        left: list[Ints] = []
        ends = np.flatnonzero(np.diff(ways, append=-1) != 1) + 1
        for run in np.split(ways, ends[:-1]) if len(ways) else ():
            for start in range(int(run[0]), int(run[-1]) + 1, RUN):
                stop = min(start + RUN, int(run[-1]) + 1)
                found = self._swept(angles[start : stop + 1])
                if found.modules is None or self._clear(found):
                    continue
                frame = start + min(int(found.frame), stop - start - 1)
                first, second = (max(0, m - module.rigid_links) for m in found.modules)
                hinges = module.hinges_per_joint
                blamed[frame : frame + 2, first * hinges : second * hinges] = True
                left.append(np.arange(start, stop))
        return np.concatenate([np.zeros(0, dtype=np.int64), *left])

    def _measured(self, angles: Array) -> tuple[Array, Array]:
        """(F − 1,) the lengths of all steps, and what they cost without torque.

        A step costs its length and, as a length is that of what goes farthest, how far hinges turn
        and modules move on average.
        """
        module = self.chain.module
        largest, mean = np.zeros(len(angles) - 1), np.zeros(len(angles) - 1)
        write_displacements(
            angles,
            module.joint,
            largest,
            mean,
        )
        turned = np.abs(np.diff(angles, axis=0))
        lengths = np.maximum(turned.max(axis=1), DISTANCE_WEIGHT * largest)
        return lengths, lengths + turned.mean(axis=1) + DISTANCE_WEIGHT * mean

    def _efforts(self, angles: Array, lengths: Array) -> Array:
        """(F − 1,) the time that each step takes when no hinge may have more torque than 1.

        Along a curve that is run through evenly the torque is b(u) u̇², see
        ``planner.playback.time_law``, so a place is passed at 1 / √|b|. Rates along the length are
        those of parabolas through frames.
        """
        spans = np.maximum(lengths, LEAST_SPAN_RAD)[:, None]
        slopes = np.diff(angles, axis=0) / spans
        rates = np.concatenate([slopes[:1], slopes])
        bends = np.zeros_like(angles)
        both = spans[1:] + spans[:-1]
        rates[1:-1] = (slopes[:-1] * spans[1:] + slopes[1:] * spans[:-1]) / both
        bends[1:-1] = 2.0 * np.diff(slopes, axis=0) / both
        torques = floating_torques(self.chain.module, angles, rates, bends)
        paces = np.sqrt(np.abs(torques).max(axis=1))
        return 0.5 * (paces[1:] + paces[:-1]) * spans[:, 0]

    def _costs(self, angles: Array) -> Array:
        """(F − 1,) what all steps cost."""
        lengths, costs = self._measured(angles)
        return costs + self.torque_weight * self._efforts(angles, lengths)

    def _refined(self, angles: Array) -> Array:
        """The same motion with frames halfway of steps that are too long."""
        steps = self._measured(angles)[0]
        count = np.maximum(1, np.ceil(steps / (2.0 * self.spacing))).astype(np.int64)
        of = np.repeat(np.arange(len(steps)), count)
        number = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        places = np.append(of + number / np.repeat(count, count), len(steps))
        return along(angles, np.arange(len(angles) * 1.0), places)

    def _resampled(self, angles: Array) -> Array:
        """A motion with frames at even lengths; where that cuts a corner too close, as it was."""
        lengths = np.concatenate([[0.0], np.cumsum(self._measured(angles)[0])])
        count = int(np.ceil(lengths[-1] / self.spacing))
        if not count:
            return angles[[0, -1]]
        even = np.linspace(0.0, lengths[-1], count + 1)
        places = even
        for _ in range(MOST_REPAIRS):
            found = along(angles, lengths, places)
            between = self._blamed(0.5 * (found[:-1] + found[1:]), slack=0.0)
            close: Flags = between.max(axis=1)
            if not close.any():
                swept = self._swept(found)
                if self._clear(swept):
                    return found
                close[min(int(swept.frame), len(close) - 1)] = True
            # There the motion keeps all the frames that it had.
            of = np.searchsorted(places, lengths, side="right") - 1
            bad = close[np.clip(of, 0, len(close) - 1)] & (np.diff(lengths, prepend=-1.0) > 0.0)
            more = np.union1d(places, lengths[bad])
            if len(more) == len(places):
                break
            places = more
        return angles

    def _swept(self, angles: Array) -> Sweep:
        """The closest place of a motion at the tight size.

        To prove more than that it is clear would take most of the looks: of the mallet of 64
        nothing was left to make its motion shorter.
        """
        found = sweep(self.chain, angles, size=self.tight, share=0.0)
        self.looks += len(angles) + found.in_betweens
        return found

    def _clear(self, found: Sweep) -> bool:
        """Whether a motion is as clear as the given one where both are looked at, without gaps."""
        return found.clearance >= self.margin - ROUNDING and found.bound >= self.bound
