"""Smoothing: a shorter and quieter motion between the same two configurations, as clear as before.

Each pass draws a simpler motion: straight lines between some frames, or a running mean of every
hinge over many; a calm motion at first without detours of hinges beyond their first and last angle.
It is followed as far as it is clear. The relative pose of two modules depends on the hinges between
them alone, so where two come too close only those hinges return to their former angles, around
those frames; all others keep the new ones. Where the whole chain gains nothing so, groups of
hinges follow one after the other. These are shortcuts of any part of the chain in any part
of the motion (Geraerts, Overmars: Creating high-quality paths for motion planning, 2007; Hauser,
Ng-Thow-Hing: Fast smoothing of manipulator trajectories using optimal bounded-acceleration
shortcuts, 2010), with the part chosen by collisions instead of at random.

A shorter motion may need more torque: straight lines have kinks, simulated motions have none. So
the cost of a motion is its length plus the time that it takes with bounded torque.

Every motion that is kept has been proved clear by ``planner.clearance.sweep``, also between its
frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import floating_torques
from foldback.planner.clearance.sweep import Sweep, sweep
from foldback.planner.core import mark_blamed_hinges, write_displacements
from foldback.planner.errors import InputError
from foldback.planner.progress import Cancelled, never
from foldback.planner.smoothing.smoothing_targets import (
    along,
    direct,
    mean,
    parts,
    softened,
    straight,
    worthwhile,
)

MAX_EVALUATIONS: Final = 40_000
"""Maximum number of configurations of the chain that smoothing checks for collisions in one motion,
detours aside; then it ends with the shortest motion found so far."""
HINGE_GROUPS: Final = 8
"""Number of groups of successive hinges that follow a simpler motion one after the other, where all
hinges together cannot."""


class Stage(NamedTuple):
    """One stage of smoothing a motion.

    Attributes:
        budget: Fraction of all clearance checks that the stage may use.
        torque_weight: Weight of torque in the minimised cost; at 1 torque counts as much as path
            length at first.
        groups: Number of groups of hinges that follow a simpler motion one after the other.
    """

    budget: float
    torque_weight: float
    groups: int


STAGES: Final = (
    Stage(0.3, 0.15, 1),
    Stage(0.2, 0.6, 1),
    Stage(0.35, 0.05, HINGE_GROUPS),
    Stage(0.15, 0.3, HINGE_GROUPS),
)
"""Stages of smoothing a motion, in their order. Measured: docs/decisions/0016-smoothing.md."""
TIGHT_SIZE: Final = 0.98
"""Smallest module size, as a fraction of the pitch, with which smoothing checks for collisions; it
uses the actual size if that is larger. Modules of this size come no closer than in the recorded
motion."""
SMOOTHED_FRAMES: Final = 150
"""Approximate number of frames with which a motion is smoothed, within the limits of their spacing.
Measured from 105 to 210: clearances of 0.021 and 0.024 pitches instead of 0.029, in 0.7 and 0.9
times the time (decision 0051)."""
FRAME_SPACING_RANGE_RAD: Final = (0.015, 0.06)
"""Minimum and maximum length of motion between two frames of a smoothed motion, in rad of joint
motion."""
MIN_PART_FRAMES: Final = 4
"""Minimum mean number of frames of the parts into which smoothing divides a motion; it is divided
no further. Measured from 3 to 6: clearances of 0.033 and 0.035 pitches instead of 0.029 (decision
0051)."""
MIN_FOLLOWED_SHARE: Final = 0.02
"""Smallest step of a hinge, as a fraction of the difference between its angle and that in the
shorter motion towards which smoothing moves it. A hinge that collisions restrict to less keeps its
angle. Measured from 0.014 to 0.028: clearances of 0.033 and 0.035 pitches instead of 0.029
(decision 0051)."""
MIN_PASS_GAIN: Final = 0.005
"""Minimum relative decrease of a motion's cost (length and torque) by one pass of smoothing; two
passes in a row with less end the smoothing. Measured from 0.0035 to 0.007: the same clearance, one
motion of ten is another (decision 0051)."""
DISTANCE_WEIGHT: Final = 0.03
"""Radians of hinge rotation that count as much as a displacement of a module by one pitch, where
smoothing measures the length of a motion that it shortens. As in playbacks. Measured from 0.021 to
0.042: clearances of 0.018 and 0.022 pitches instead of 0.029 (decision 0051)."""
SWEEP_STEPS: Final = 6
"""Number of consecutive intervals between frames that one sweep checks for collisions in smoothing;
a sweep reports its closest place only. Measured from 4 to 8: equally good (decision 0051)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smoothed:
    """Smoothed motion.

    Attributes:
        angles: (F, J) hinge angles, rad; the first and the last frame are the given ones.
        looks: Number of configurations that were checked.
    """

    angles: Array
    looks: int


def smooth(
    chain: Chain,
    angles: Array,
    *,
    module_size: float,
    seed: int = 0,
    looks: int = MAX_EVALUATIONS,
    calm: bool = False,
    report: Callable[[float], None] | None = None,
    cancelled: Cancelled = never,
) -> Smoothed:
    """Smooth a motion. The result depends on the arguments alone.

    Args:
        chain: The chain.
        angles: (F, J) configurations in either order of time, hinges running evenly between them.
        module_size: Module size at which the motion is verified, as a fraction of the pitch. At the
            larger of it and ``TIGHT_SIZE`` the smoothed motion is as clear as the given one at the
            checked configurations, and clear in between.
        seed: Seed of the starts of straight lines.
        looks: Approximate maximum number of configurations to check. One costs some 0.6 µs of
            processor time for each cube, three times as much for each tetrahedron.
        calm: True if hinges are to make few detours, even at the cost of torque.
        report: Receives the used fraction of ``looks``, after each part.
        cancelled: Returns True to stop; the motion found so far is then taken.

    Raises:
        InputError: ``wrong-shape`` for angles that are not frames of this chain.
    """
    hinges = len(chain.folded_rad)
    if angles.ndim != 2 or angles.shape[1] != hinges or not len(angles):
        raise InputError(
            "wrong-shape",
            f"got an array of shape {angles.shape}, expected one row of {hinges} hinge angles for "
            "each frame.",
        )
    angles = np.ascontiguousarray(angles, dtype=np.float64)
    run = _Smoothing(chain, angles, module_size, looks, np.random.default_rng(seed), report)
    return Smoothed(angles=run.smoothed(cancelled, calm=calm), looks=run.looks)


def spacing_of(length_rad: float) -> float:
    """Return the arc length between frames of a motion, rad, by its length."""
    return float(np.clip(length_rad / SMOOTHED_FRAMES, *FRAME_SPACING_RANGE_RAD))


class _Smoothing:
    def __init__(
        self,
        chain: Chain,
        angles: Array,
        module_size: float,
        looks: int,
        rng: np.random.Generator,
        report: Callable[[float], None] | None,
    ) -> None:
        self.chain = chain
        self.all_looks = looks
        self.report = report
        self.size = module_size
        self.tight = max(module_size, TIGHT_SIZE)
        self.max_looks = looks
        self.looks = 0
        self.rng = rng
        self.given_angles = angles
        swept = self._swept(angles)
        self.margin = swept.clearance
        self.bound = min(swept.bound, 1e-9)  # just above 0, because of rounding
        length = float(self._measured(angles)[0].sum())
        self.spacing = spacing_of(length)
        self.torque_weight = 0.0

    def smoothed(self, cancelled: Cancelled, *, calm: bool) -> Array:
        """Return the (F, J) best motion found, if ``calm`` after detours have been removed."""
        best = self._resampled(self.given_angles)
        if len(best) < MIN_PART_FRAMES:
            return best
        lengths, costs = self._measured(best)
        # no division by 0
        unit = costs.sum() / max(float(self._efforts(best, lengths).sum()), 1e-9)
        if calm:
            best = self._without_detours(best)
        for stage in STAGES:
            self.max_looks = self.looks + int(stage.budget * self.all_looks)
            self.torque_weight = stage.torque_weight * unit
            best = self._cheaper(best, stage.groups, cancelled)
        return best

    def _without_detours(self, angles: Array) -> Array:
        """Return the (F, J) motion with hinges between their first and last angle, where clear.

        All hinges try it together at first, then by groups.
        """
        # so that hinges do not stop suddenly: docs/decisions/0034-calm-motion.md
        target = mean(direct(angles), 12)
        for groups in (1, HINGE_GROUPS):
            angles = self._followed_by_groups(angles, target, groups)
        return self._refined(angles)

    def _cheaper(self, best: Array, groups: int, cancelled: Cancelled) -> Array:
        """Return the (F, J) motion after passes by groups of hinges until they gain too little."""
        stale = 0
        while stale < 2 and self.looks < self.max_looks and not cancelled():
            motion = self._resampled(self._simplified(best, groups, cancelled))
            gain = 1.0 - self._costs(motion).sum() / self._costs(best).sum()
            if gain <= 0.0:
                break
            best = motion
            stale = stale + 1 if gain < MIN_PASS_GAIN else 0
        return best

    def _simplified(self, angles: Array, groups: int, cancelled: Cancelled) -> Array:
        """Make one pass of straight lines and means over ever smaller parts."""
        for lines in (True, False):
            for pieces in (1, 3, 6, 12, 24, 48):  # parts that become straight, or a mean
                if self.looks >= self.max_looks or cancelled():
                    return angles
                if self.report is not None:
                    self.report(self.looks / self.all_looks)
                if len(angles) < MIN_PART_FRAMES * pieces:
                    break
                begins = parts(len(angles), pieces, self.rng)
                target = straight(angles, begins) if lines else mean(angles, pieces)
                motion = self._followed_by_groups(angles, target, 1, begins)
                if motion is angles and groups > 1:
                    motion = self._followed_by_groups(angles, target, groups, begins)
                if motion is not angles:
                    angles = self._refined(motion)
        return angles

    def _followed_by_groups(
        self, angles: Array, target: Array, groups: int, begins: Ints | None = None
    ) -> Array:
        """Return a motion towards a target by one group of hinges after the other, where clear.

        While two modules are close, all hinges between them keep their angles; a group may still
        follow where the whole chain cannot.

        Args:
            angles, target: (F, J) motions with the same first and last frame.
            groups: Number of groups of successive hinges.
            begins: Frames at which the target's parts begin, and its last frame: those parts are
                followed that cost less. None to follow all of it at any cost.
        """
        everywhere: Flags = np.ones(len(angles), dtype=np.bool_)
        for hinges in np.array_split(np.arange(angles.shape[1]), groups):
            part = angles.copy()
            part[:, hinges] = target[:, hinges]
            worth, max_cost = everywhere, inf
            if begins is not None:
                if self.looks >= self.max_looks:
                    break
                costs = self._costs(angles)
                worth, max_cost = worthwhile(costs, self._costs(part), begins), float(costs.sum())
                if not worth.any():
                    continue
            motion = self._followed(angles, part, worth, max_cost)
            angles = angles if motion is None else motion
        return angles

    def _followed(
        self, angles: Array, target: Array, worth: Flags, max_cost: float
    ) -> Array | None:
        """Return a motion towards a target, as far as frames and the motion between are clear.

        Args:
            angles, target: (F, J) motions with the same first and last frame.
            worth: (F,) True if the target is to be followed at a frame.
            max_cost: Upper limit of its cost.
        """
        from scipy.ndimage import minimum_filter1d  # late: most folds are not smoothed

        shares = softened(np.repeat(worth.astype(np.float64)[:, None], angles.shape[1], axis=1))
        unknown: Flags = np.ones(len(angles), dtype=np.bool_)
        unknown_ways: Flags = unknown.copy()
        for turn in range(14):
            candidate = angles + shares * (target - angles)
            moved: Flags = shares.max(axis=1) > 0.0
            blamed = np.zeros(angles.shape, dtype=np.bool_)
            rows = np.flatnonzero(unknown & moved)
            blamed[rows] = self._blamed(candidate[rows])
            unknown_ways |= unknown
            if not blamed.any():
                if not moved.any() or self._costs(candidate).sum() >= max_cost:
                    return None
                ways = np.flatnonzero(
                    (unknown_ways[:-1] | unknown_ways[1:]) & (moved[:-1] | moved[1:])
                )
                unknown_ways[:] = False
                unknown_ways[self._blame_between(candidate, ways, blamed)] = True
                if not blamed.any():
                    return candidate
            if turn >= 6:  # not the blamed hinges alone, but all of their frames
                blamed[blamed.any(axis=1)] = True
            # half a step first, then none
            factors = np.where(blamed, 0.5 if turn < 1 else 0.0, 1.0)
            lower = shares * minimum_filter1d(factors, 3, axis=0)
            lower[lower < MIN_FOLLOWED_SHARE] = 0.0
            lower = softened(lower)
            unknown = np.abs(lower - shares).max(axis=1) > 0.0
            shares = lower
        return None

    def _blamed(self, angles: Array, *, slack: float = 0.001) -> Flags:
        """Return (F, J), True for the hinges between modules that are closer than allowed."""
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
        """Mark the hinges that bring modules too close between frames, at both ends of the step.

        In several steps in a row only the closest configuration is marked.

        Args:
            angles: (F, J) angles, rad.
            ways: (W,) numbers of the steps that are checked.
            blamed: (F, J) output, True for marked hinges.

        Returns:
            The steps among which there may be more.
        """
        module = self.chain.module
        unfinished: list[Ints] = []
        ends = np.flatnonzero(np.diff(ways, append=-1) != 1) + 1
        for run in np.split(ways, ends[:-1]) if len(ways) else ():
            for start in range(int(run[0]), int(run[-1]) + 1, SWEEP_STEPS):
                stop = min(start + SWEEP_STEPS, int(run[-1]) + 1)
                swept = self._swept(angles[start : stop + 1])
                if swept.modules is None or self._clear(swept):
                    continue
                frame = start + min(int(swept.frame), stop - start - 1)
                first, second = (max(0, module.joint_after(m)) for m in swept.modules)
                hinges = module.hinges_per_joint
                blamed[frame : frame + 2, first * hinges : second * hinges] = True
                unfinished.append(np.arange(start, stop))
        return np.concatenate([np.zeros(0, dtype=np.int64), *unfinished])

    def _measured(self, angles: Array) -> tuple[Array, Array]:
        """Return the (F − 1,) lengths of all steps, rad, and their (F − 1,) costs without torque.

        The length of a step is its largest motion; its cost also includes the mean turn of hinges
        and the mean displacement of modules.
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
        """Return the (F − 1,) time of each step if no hinge torque exceeds 1.

        Along a curve that is run through evenly the torque is b(u) u̇², see
        ``planner.playback.time_scaling``, so a place is passed at 1 / √|b|. Rates along the length
        are those of parabolas through frames.
        """
        spans = np.maximum(lengths, 1e-6)[:, None]  # no division by 0
        slopes = np.diff(angles, axis=0) / spans
        rates = np.concatenate([slopes[:1], slopes])
        bends = np.zeros_like(angles)
        span_sums = spans[1:] + spans[:-1]
        rates[1:-1] = (slopes[:-1] * spans[1:] + slopes[1:] * spans[:-1]) / span_sums
        bends[1:-1] = 2.0 * np.diff(slopes, axis=0) / span_sums
        torques = floating_torques(self.chain.module, angles, rates, bends)
        paces = np.sqrt(np.abs(torques).max(axis=1))
        return 0.5 * (paces[1:] + paces[:-1]) * spans[:, 0]

    def _costs(self, angles: Array) -> Array:
        """Return the (F − 1,) costs of all steps."""
        lengths, costs = self._measured(angles)
        return costs + self.torque_weight * self._efforts(angles, lengths)

    def _refined(self, angles: Array) -> Array:
        """Return the motion with additional frames in steps that are too long."""
        steps = self._measured(angles)[0]
        count = np.maximum(1, np.ceil(steps / (2.0 * self.spacing))).astype(np.int64)
        of = np.repeat(np.arange(len(steps)), count)
        number = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        places = np.append(of + number / np.repeat(count, count), len(steps))
        return along(angles, np.arange(len(angles) * 1.0), places)

    def _resampled(self, angles: Array) -> Array:
        """Return the motion with frames at even lengths; corners cut too close keep theirs."""
        lengths = np.concatenate([[0.0], np.cumsum(self._measured(angles)[0])])
        count = int(np.ceil(lengths[-1] / self.spacing))
        if not count:
            return angles[[0, -1]]
        even = np.linspace(0.0, lengths[-1], count + 1)
        places = even
        for _ in range(6):
            samples = along(angles, lengths, places)
            between = self._blamed(0.5 * (samples[:-1] + samples[1:]), slack=0.0)
            close: Flags = between.max(axis=1)
            if not close.any():
                swept = self._swept(samples)
                if self._clear(swept):
                    return samples
                close[min(int(swept.frame), len(close) - 1)] = True
            # There the motion keeps all the frames that it had.
            of = np.searchsorted(places, lengths, side="right") - 1
            bad = close[np.clip(of, 0, len(close) - 1)] & (np.diff(lengths, prepend=-1.0) > 0.0)
            more_places = np.union1d(places, lengths[bad])
            if len(more_places) == len(places):
                break
            places = more_places
        return angles

    def _swept(self, angles: Array) -> Sweep:
        """Return the closest configuration of a motion at the tight size.

        A proof of more than no contact would take most of the evaluations: with the mallet of 64
        none would remain to shorten its motion.
        """
        swept = sweep(self.chain, angles, module_size=self.tight, share=0.0)
        self.looks += len(angles) + swept.in_betweens
        return swept

    def _clear(self, swept: Sweep) -> bool:
        """Return True if a motion is as clear as the given one, and proved without contact."""
        return swept.clearance >= self.margin - 1e-9 and swept.bound >= self.bound  # rounding
