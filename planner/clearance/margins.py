"""Margins: how large errors of modules and hinges may be before a motion is no longer proved clear.

Lemmas 11 and 12 of docs/decisions/0012-sweep-bound.md. Each margin is the largest value found, in
steps of a few percent, at which the whole motion is proved to be clear.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.exempt_pairs import Place
from foldback.planner.clearance.rounding_errors import clearance_rounding
from foldback.planner.clearance.sweep import (
    Sweep,
    between_frames,
    disturbed_sweep,
    pair_clearance,
    rest_motions,
    sweep,
)
from foldback.planner.core import allowance
from foldback.planner.core.structures import Levers, Tolerance
from foldback.planner.motion.motion import Motion, as_motion
from foldback.planner.progress import Cancelled, never

FULL_SIZE: Final = 1.0
"""Module size, in pitches, at which neighbouring modules touch: the largest size that is tried when
the largest module size without collisions is searched for a motion."""
REDUCTION_FACTOR: Final = 0.95
"""Factor, from 0 to 1, of the next error of hinges or module size that is tried when a proof that
the motion tolerates an error fails: relative to the error at which the two modules concerned would
touch."""
FAILURE_PROBABILITY: Final = 0.05
"""Upper bound of the probability, 0 to 1, that modules of a robot touch anywhere in a motion if all
its hinges have independent random errors up to the margin that the certificate reports."""
MAX_ERROR_RAD: Final = 0.5
"""Largest error of a single hinge, and sum of independent errors of all hinges, rad, that is tried
when the errors that a motion tolerates are searched; no motion is reported to tolerate more. The
proof for a sum (lemma 12 of decision 0012) holds below 1."""
MAX_MARGIN_MODULES: Final = 2000
"""Maximum number of modules of a chain for which a certificate reports the largest errors of hinges
and module sizes that its motion tolerates; for longer chains it reports none. The time grows with
the square of the number."""
SPARE_PITCH: Final = 1e-4
"""Distance, in pitches, that modules must still keep at the moments at which the effect of
independent hinge errors is bounded; it covers the motion between these moments."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """Largest error at which a motion is proved clear.

    Attributes:
        value: The error; the module size in pitches, or an angle in radians.
        limited_by: Moment and pair of modules for which the next larger value failed.
    """

    value: float
    limited_by: Place


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Errors that a motion is proved to stand.

    Attributes:
        module_size: Size of the modules as a fraction of the pitch, with exact hinges.
        one_hinge_rad: Error of any one hinge at any moment, all others being exact.
        independent_rad: Error of each hinge, the same all the time. Hinges are independent of each
            other, each as likely too far as not far enough.
        failure_probability: Upper bound of the probability that modules of such a robot touch.
    """

    module_size: Margin
    one_hinge_rad: Margin
    independent_rad: Margin
    failure_probability: float = FAILURE_PROBABILITY


def margins(
    chain: Chain,
    motion: Motion,
    closest: Sweep,
    *,
    module_size: float,
    cancelled: Cancelled = never,
) -> Margins | None:
    """Find how large errors may be; None if no modules come near each other, or if cancelled.

    Args:
        chain: The chain.
        motion: A motion that is proved clear.
        closest: Its sweep.
        module_size: Module size as a fraction of the pitch.
        cancelled: Polled between tasks.
    """
    search = _Search.of(chain, motion, closest, cancelled)
    if search is None or len(chain) > MAX_MARGIN_MODULES:
        return None
    kinds = _Kinds.of(chain, motion, module_size, FAILURE_PROBABILITY)
    (larger,) = search.largest(kinds.larger, (FULL_SIZE - module_size,))
    limits = (MAX_ERROR_RAD, MAX_ERROR_RAD / len(chain.folded_rad))
    one_hinge, independent = search.largest(kinds.turned, limits)
    result = Margins(
        module_size=replace(larger, value=module_size + larger.value),
        one_hinge_rad=one_hinge,
        independent_rad=independent,
    )
    return None if cancelled() else result


def largest_size(chain: Chain, motions: Sequence[Motion | Array], *, clear_at: float) -> float:
    """Find the largest module size, within a few percent, at which motions are proved clear.

    Args:
        chain: The chain.
        motions: Motions, or the (F, J) hinge angles of each, rad.
        clear_at: A size at which they are clear.
    """
    size = FULL_SIZE
    for motion in map(as_motion, motions):
        search = _Search.of(chain, motion, sweep(chain, motion, module_size=clear_at))
        if search is not None:
            kinds = _Kinds.of(chain, motion, clear_at, FAILURE_PROBABILITY)
            (larger,) = search.largest(kinds.larger, (FULL_SIZE - clear_at,))
            size = min(size, clear_at + larger.value)
    return size


def unproved_margins(
    chain: Chain, motion: Motion, stated: Margins, *, module_size: float
) -> list[str]:
    """Return the names of those margins at which a motion is not proved clear.

    Args:
        chain: The chain.
        motion: The motion.
        stated: The margins.
        module_size: Module size as a fraction of the pitch, for the margins of hinges.
    """
    kinds = _Kinds.of(chain, motion, module_size, stated.failure_probability)
    errors_by_name = {
        "module_size": kinds.larger(stated.module_size.value - module_size),
        "one_hinge_rad": kinds.turned(stated.one_hinge_rad.value, 0.0),
        "independent_rad": kinds.turned(0.0, stated.independent_rad.value),
    }
    return [
        name
        for name, errors in errors_by_name.items()
        if not all(
            disturbed_sweep(chain, motion_part, errors.hinges, module_size=errors.size).bound > 0.0
            for motion_part, _ in _proof_motions(chain, motion)
        )
    ]


def limit_at(chain: Chain, motion: Motion, name: str, place: Place, *, module_size: float) -> float:
    """Return the value of a margin at which the two modules of a place may touch there.

    Args:
        chain: The chain.
        motion: The motion.
        name: Name of the margin, a field of ``Margins``.
        place: A moment of the motion and two modules.
        module_size: Module size as a fraction of the pitch, for the margins of hinges.
    """
    kinds = _Kinds.of(chain, motion, module_size, FAILURE_PROBABILITY)
    search = _Search(chain=chain, motion=motion, closest=place, cancelled=never)
    if name == "module_size":
        return module_size + search.touching(place, kinds.larger, (FULL_SIZE - module_size,))[0]
    limits = (MAX_ERROR_RAD, MAX_ERROR_RAD / len(chain.folded_rad))
    return search.touching(place, kinds.turned, limits)[name == "independent_rad"]


def _proof_motions(chain: Chain, motion: Motion) -> list[tuple[Motion, int]]:
    """Return the motions that must be clear, and the frame at which each begins.

    The end of a fold limits most margins, so it comes first: other parts are then seldom proved
    more than once. In a windowed motion the folded and the straight chain stand for modules that
    are rigid with each other.
    """
    last = len(motion) - 1
    tail_start = max(0, len(motion) - 64)  # most trials fail in these frames
    motions = [(motion[tail_start:], tail_start)]
    if tail_start > 0:
        motions.append((motion[: tail_start + 1], 0))
    if not motion.is_windowed:
        return [(motion[last:], last), *motions]
    folded, straight = rest_motions(chain)
    return [(folded, last), *motions, (straight, 0)]


def _deviations(chain: Chain, motion: Motion, probability: float) -> float:
    """Return κ of lemma 12: exp(−κ² / 2) times the number of events is the failure probability."""
    module, n = chain.module, len(chain)
    reach = module.longest_link * n + 2.0 * module.radius
    speed = reach * _largest_turning(chain, motion)
    moments = len(motion) * math.ceil(speed / (2.0 * SPARE_PITCH) + 1.0)
    events = len(module.hull.vertices) * (n * (n - 1) / 2) * moments
    return math.sqrt(2.0 * math.log(events / probability))


def _largest_turning(chain: Chain, motion: Motion) -> float:
    """Return the largest sum of the steps of all hinges between two frames, rad."""
    before, largest = motion.angles_at(chain, 0), 0.0
    for k in range(1, len(motion)):
        angles = motion.angles_at(chain, k)
        largest = max(largest, float(np.abs(angles - before).sum()))
        before = angles
    return largest


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors that a motion is tried with.

    Attributes:
        size: Module size as a fraction of the pitch.
        hinges: Errors of the hinges.
    """

    size: float
    hinges: Tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kinds:
    """Kinds of errors, each a function of one value; 0 stands for no errors.

    Attributes:
        size: Module size as a fraction of the pitch, but for ``larger``.
        rounding: Bound of rounding, in pitches, for modules of any size.
        deviations: κ of lemma 12.
    """

    size: float
    rounding: float
    deviations: float

    @classmethod
    def of(cls, chain: Chain, motion: Motion, module_size: float, probability: float) -> _Kinds:
        """Return the kinds of errors of a motion, with the failure probability of random ones."""
        rounding = clearance_rounding(chain, motion, FULL_SIZE)
        deviations = _deviations(chain, motion, probability)
        return cls(size=module_size, rounding=rounding, deviations=deviations)

    def larger(self, increase: float) -> Errors:
        """Return modules that are larger by ``increase`` pitches."""
        return Errors(size=self.size + increase, hinges=Tolerance(0.0, 0.0, 0.0, self.rounding))

    def turned(self, one_hinge_rad: float, independent_rad: float) -> Errors:
        """Return one hinge that is off, and besides, hinges that are all off independently."""
        spare = SPARE_PITCH + self.rounding
        return Errors(
            size=self.size, hinges=Tolerance(one_hinge_rad, independent_rad, self.deviations, spare)
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """Search for the largest errors at which a motion is proved clear.

    It begins with the value at which the closest modules of the exact motion would touch, and goes
    down to the one at which those modules would touch for which a proof failed.

    Attributes:
        chain, motion: The chain and its motion.
        closest: Closest place of the exact motion.
        cancelled: Polled between tasks.
    """

    chain: Chain
    motion: Motion
    closest: Place
    cancelled: Cancelled

    @classmethod
    def of(
        cls, chain: Chain, motion: Motion, closest: Sweep, cancelled: Cancelled = never
    ) -> _Search | None:
        """Return the search in a motion with this sweep; None if it is not clear, or always far."""
        if closest.modules is None or closest.bound <= 0.0:
            return None
        place = Place(frame=closest.frame, modules=closest.modules)
        return cls(chain=chain, motion=motion, closest=place, cancelled=cancelled)

    def largest(self, errors: Callable[..., Errors], limits: tuple[float, ...]) -> list[Margin]:
        """Return the largest values found at which the motion is proved clear.

        Args:
            errors: Makes errors of as many values as ``limits`` has; 0 makes none.
            limits: Largest value of each kind that is tried.
        """
        margins = [
            Margin(value=REDUCTION_FACTOR * value, limited_by=self.closest)
            for value in self.touching(self.closest, errors, limits)
        ]
        motions = _proof_motions(self.chain, self.motion)
        steps = 0
        while motions and not self.cancelled():
            motion, start = motions[0]
            errors_at_margins = errors(*(margin.value for margin in margins))
            swept = disturbed_sweep(
                self.chain,
                motion,
                errors_at_margins.hinges,
                module_size=errors_at_margins.size,
                cancelled=self.cancelled,
            )
            if swept.bound > 0.0:
                motions.pop(0)
                continue
            steps += 1
            if steps > 12:
                return [replace(margin, value=0.0) for margin in margins]
            place, touching = self.closest, [0.0] * len(limits)
            if swept.modules is not None:
                place = Place(frame=start + swept.frame, modules=swept.modules)
                touching = self.touching(place, errors, limits)
            failing = [
                touch <= margin.value for touch, margin in zip(touching, margins, strict=True)
            ]
            for k, margin in enumerate(margins):
                if failing[k] and touching[k] > 0.0:
                    margins[k] = Margin(value=REDUCTION_FACTOR * touching[k], limited_by=place)
                elif not any(failing) or touching[k] == 0.0:
                    # Bounds over an interval are what fails, and not the modules.
                    margins[k] = Margin(
                        value=REDUCTION_FACTOR ** max(1, steps // 2) * margin.value,
                        limited_by=place,
                    )
        return margins

    def touching(
        self, place: Place, errors: Callable[..., Errors], limits: tuple[float, ...]
    ) -> list[float]:
        """Return the value of each kind of error at which two modules may touch at a moment."""
        from scipy.optimize import brentq  # late: pages start without it

        def left(value: float, kind: int) -> float:
            values = [value if k == kind else 0.0 for k in range(len(limits))]
            return self._gap(place, errors(*values))

        return [
            top
            if left(top, kind) > 0.0
            else cast(float, brentq(left, 0.0, top, args=(kind,), xtol=1e-9))
            for kind, top in enumerate(limits)
        ]

    def _gap(self, place: Place, errors: Errors) -> float:
        """Return what errors leave of the clearance of two modules at a moment, in pitches."""
        chain, module = self.chain, self.chain.module
        assert place.modules is not None
        i, j = place.modules
        poses = forward_kinematics(module, between_frames(chain, self.motion, place.frame))
        clearance = pair_clearance(module, poses, place.modules, module_size=errors.size)
        x = poses.positions
        anchors = np.linalg.norm(module.joint.anchor, axis=1)
        arm = module.radius * errors.size + float(anchors.max())
        from_a, from_b = (np.linalg.norm(x[i:j] - x[k], axis=1) + arm for k in (i, j))
        longest = float(np.minimum(from_a, from_b).max())
        levers = Levers(longest, float(from_b.sum()), float(from_b @ from_b))
        joints, hinges = float(j - i), float(module.hinges_per_joint)
        return clearance - allowance(errors.hinges, levers, joints, hinges)
