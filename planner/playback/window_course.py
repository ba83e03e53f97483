"""Window course: what the playback of a peeled chain follows, stretch by stretch.

The record of a peeling, in reverse, drawn as a uniform cubic B-spline through its windows, at a
speed that the fastest hinge keeps about evenly. Its steps are cut into stretches: of each one joint
after another moves in one model (``planner.simulation.window_body``), and all the rest is rigid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import sweep
from planner.motion.frames import PHASES
from planner.motion.windows import Windows
from planner.parameters.playback import PlaybackParameters
from planner.playback.reference import ROOM, STOP_ROOM_RAD
from planner.playback.setpoints import SETTLE_STEPS
from planner.playback.time_law import TimeLaw, law_from_profile, torque_bounded_profile
from planner.simulation.window_body import Lumps, WindowBody

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
FEWEST_STEPS: Final = 100
"""Steps of a playback, at least."""
SAMPLES_A_RAD: Final = 25
"""Samples of the time law for each radian of the curve's length …"""
MOST_SAMPLES: Final = 2**15
"""… or fewer."""
FRAME_RAD: Final = 0.04
"""Turn of the fastest hinge between two frames that are kept."""
JOINTS_AT_ONCE: Final = 16
"""Models have a multiple of so many joints: few of them are made."""
FEWEST_TOGETHER: Final = 48
"""Steps that a stretch has, at least."""
SPARE_JOINTS: Final = 8
"""Joints that a stretch has above those that move at its beginning, at least."""
MOST_FINER: Final = 8
"""Factor of control points, frames and steps up to which the curve is drawn closer to the record
where it comes too close to something."""
REACH: Final = 4
"""Control points that a place of the curve depends on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Steps in which the same joints may move.

    Attributes:
        first: The first joint's number among all of the chain.
        joints: How many.
        start, stop: Steps.
    """

    first: int
    joints: int
    start: int
    stop: int

    def hinges(self, chain: Chain) -> slice:
        """Where its hinges are among the chain's."""
        k = chain.module.hinges_per_joint
        return slice(k * self.first, k * (self.first + self.joints))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Targets:
    """What the hinges of a stretch are to do.

    Attributes:
        angles: (S + 1, H) at its steps and at its end.
        rates: (S + 1, H) of the step that leads to each, in rad/s.
    """

    angles: Array
    rates: Array


class WindowCurve:
    """A uniform cubic B-spline through windows.

    Args:
        chain: The chain.
        windows: Snapshots in the order of the playback.
        spacing_rad: Turn of the fastest hinge from one control point to the next.
    """

    def __init__(self, chain: Chain, windows: Windows, spacing_rad: float) -> None:
        largest, _ = windows.steps(chain)
        lengths = np.concatenate([[0.0], np.cumsum(largest)])
        self.chain = chain
        self.length_rad = float(lengths[-1])
        count = max(REACH, int(np.ceil(self.length_rad / spacing_rad)) + 1)
        where = np.linspace(0.0, self.length_rad, count)
        after = np.clip(np.searchsorted(lengths, where), 1, max(1, len(windows) - 1))
        span = lengths[after] - lengths[after - 1]
        part = np.where(span > 0.0, (where - lengths[after - 1]) / np.where(span > 0, span, 1), 1.0)
        self._windows = windows
        # Twice again at both ends, where the curve is to begin and to end.
        ends = np.clip(np.arange(-2, count + 2), 0, count - 1)
        self._after, self._part = after[ends], part[ends]
        before = self._after - 1
        self.first = np.minimum(windows.first[before], windows.first[self._after])
        self.last = np.maximum(windows.last[before], windows.last[self._after])
        self._limit = chain.module.angle_limit_rad - STOP_ROOM_RAD

    @property
    def end(self) -> float:
        """The curve runs from 0 to here, about evenly by the turn of its fastest hinge."""
        return float(len(self._after) - REACH + 1)

    def piece(self, u: Array) -> Ints:
        """(U,) the first of the control points that places depend on."""
        return np.clip(u.astype(np.int64), 0, len(self._after) - REACH)

    def at(self, u: Array, hinges: slice, derivative: int = 0) -> Array:
        """(U, H) the angles of some hinges at (U,) places, or how those change with u.

        Args:
            u: Places from 0 to ``end``.
            hinges: Of those it holds all that move there.
            derivative: 0, 1 or 2.
        """
        piece = self.piece(u)
        low, high = int(piece.min()), int(piece.max()) + REACH
        points = np.stack([self._point(k, hinges) for k in range(low, high)])
        weights = _weights(u - piece, derivative)
        parts = (weights[i][:, None] * points[piece - low + i] for i in range(REACH))
        return np.asarray(sum(parts))

    def _point(self, k: int, hinges: slice) -> Array:
        after, part = int(self._after[k]), float(self._part[k])
        before = self._angles(after - 1, hinges)
        found = before + part * (self._angles(after, hinges) - before)
        return np.clip(found, -self._limit, self._limit)

    def _angles(self, frame: int, hinges: slice) -> Array:
        """(H,) of one window, folded before it and straight behind."""
        windows, start, stop = self._windows, hinges.start, hinges.stop
        first, last = int(windows.first[frame]), int(windows.last[frame])
        found = np.zeros(stop - start)
        folded = max(start, min(first, stop))
        found[: folded - start] = self.chain.folded_rad[start:folded]
        low, high = max(first, start), min(last, stop)
        if high > low:
            at = int(windows.offsets[frame]) - first
            found[low - start : high - start] = windows.angles_rad[at + low : at + high]
        return found


def _weights(t: Array, derivative: int) -> tuple[Array, Array, Array, Array]:
    """What the four control points of a uniform cubic B-spline count in a piece, t from 0 to 1."""
    if derivative == 0:
        last = t**3 / 6.0
        third = (-3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0) / 6.0
        first = (1.0 - t) ** 3 / 6.0
        return first, 1.0 - first - third - last, third, last
    if derivative == 1:
        last, third, first = 0.5 * t**2, -1.5 * t**2 + t + 0.5, -0.5 * (1.0 - t) ** 2
        return first, -first - third - last, third, last
    return 1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t


class WindowCourse:
    """What is followed, once for all robots.

    Args:
        chain: The chain.
        record: What was recorded, from folded on.
        parameters: Of the playback.
        module_size: Size of the modules as a fraction of the pitch.
        finer: How many times as many steps and frames there are.
    """

    def __init__(
        self,
        chain: Chain,
        record: Windows,
        parameters: PlaybackParameters,
        module_size: float,
        finer: int,
    ) -> None:
        self.chain = chain
        self.parameters = parameters
        self.module_size = module_size
        self.robots = parameters.robot.runs
        self._backwards = record[::-1]
        self._bodies: dict[int, WindowBody] = {}
        # Some room is left for the robots' joint errors.
        room = min(ROOM, 0.25 * (1.0 - module_size))
        while True:
            self._draw(finer)
            found = sweep(chain, self.reference, size=module_size, share=0.0)
            if found.clearance > room or finer >= MOST_FINER:
                break
            finer *= 2
        self._torques = self._all_torques()
        self.peak_torque = max(float(np.abs(one).max()) for one in self._torques)
        """Largest torque that a robot without faults needs."""

    def _draw(self, finer: int) -> None:
        """Draws the curve, with so many times as many control points, steps and frames."""
        p, backwards = self.parameters, self._backwards
        self._bodies.clear()
        self.step_s = p.step_s / finer
        self.curve = WindowCurve(self.chain, backwards, p.spacing_rad / finer)
        length = self.curve.length_rad
        steps = max(FEWEST_STEPS, int(finer * p.steps_per_rad * length))
        law = self._law(steps)
        self._u = self.curve.end * law.u
        gone = np.floor(law.u * length * finer / FRAME_RAD)
        self.is_kept = np.concatenate([[True], np.diff(gone) > 0.0])
        """(S + 1,) whether a frame is kept before a step."""
        self.is_kept[-1] = True
        self.stretches = tuple(_stretches(self.chain, self.curve, self._u))
        self.reference = self._reference()
        """What the kept frames should be; the pose of module 0 is that at the beginning."""

    def _law(self, steps: int) -> TimeLaw:
        """How fast to run along the curve, so that the largest torque is about the least."""
        count = max(FEWEST_STEPS, min(MOST_SAMPLES, int(SAMPLES_A_RAD * self.curve.length_rad)))
        u = np.linspace(0.0, self.curve.end, count)
        stretches = tuple(_stretches(self.chain, self.curve, u))
        widest = max(stretch.joints for stretch in stretches) * self.chain.module.hinges_per_joint
        a, b = np.zeros((count, widest)), np.zeros((count, widest))
        lumps = Lumps(self.chain, np.ones(len(self.chain)))
        for number, stretch in enumerate(stretches):
            body = self.body(stretch.joints)
            body.take(stretch.first, lumps)
            stop = stretch.stop + (number == len(stretches) - 1)
            places, hinges = u[stretch.start : stop], stretch.hinges(self.chain)
            angles, first, second = (self.curve.at(places, hinges, k) for k in range(3))
            still = np.zeros_like(first[0])
            for k in range(len(places)):
                row = stretch.start + k
                a[row, : len(still)] = body.floating_torques(angles[k], still, first[k])
                b[row, : len(still)] = body.floating_torques(angles[k], first[k], second[k])
        share = u / self.curve.end
        return law_from_profile(share, torque_bounded_profile(share, a, b), steps, self.step_s)

    def _reference(self) -> Windows:
        first, angles = [], []
        for number, stretch in enumerate(self.stretches):
            hinges = stretch.hinges(self.chain)
            stop = stretch.stop + (number == len(self.stretches) - 1)
            kept = np.flatnonzero(self.is_kept[stretch.start : stop])
            first += [hinges.start] * len(kept)
            angles += list(self.curve.at(self._u[stretch.start + kept], hinges))
        steps = np.flatnonzero(self.is_kept)
        steps[-1] += SETTLE_STEPS
        backwards = self._backwards
        return Windows(
            time_s=self.step_s * steps.astype(np.float64),
            phase=np.full(len(steps), PHASES.index("playback"), dtype=np.uint8),
            first=np.array(first, dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum([len(one) for one in angles])]),
            angles_rad=np.concatenate(angles).astype(np.float32),
            base_position=np.repeat(backwards.base_position[:1], len(steps), axis=0),
            base_wxyz=np.repeat(backwards.base_wxyz[:1], len(steps), axis=0),
        )

    def __len__(self) -> int:
        """Number of steps."""
        return len(self._u) - 1

    def body(self, joints: int) -> WindowBody:
        """A body of so many joints, which must not be changed."""
        if joints not in self._bodies:
            self._bodies[joints] = WindowBody(
                self.chain, joints, geom_size=self.module_size, step_s=self.step_s
            )
        return self._bodies[joints]

    def targets(self, number: int) -> Targets:
        """What hinges are to do in a stretch, step by step.

        Semi-implicit Euler goes from q to q + h (q̇ + h q̈). So q̇ is the way of the last step, and
        q̈ what makes the next one another: finite differences of the angles, not derivatives.
        """
        stretch = self.stretches[number]
        # The law rests before its first step and after its last one.
        steps = np.clip(np.arange(stretch.start - 1, stretch.stop + 1), 0, len(self))
        angles = self.curve.at(self._u[steps], stretch.hinges(self.chain))
        rates = np.diff(angles, axis=0) / self.step_s
        return Targets(angles=angles[1:], rates=rates)

    def torques(self, number: int) -> NDArray[np.float32]:
        """(S, H) that a robot without faults needs for the steps of a stretch."""
        return self._torques[number]

    def _all_torques(self) -> list[NDArray[np.float32]]:
        """(S, H) of each stretch: torques that a robot without faults needs for its steps."""
        lumps = Lumps(self.chain, np.ones(len(self.chain)))
        found: list[NDArray[np.float32]] = []
        for number, stretch in enumerate(self.stretches):
            body = self.body(stretch.joints)
            body.take(stretch.first, lumps)
            targets = self.targets(number)
            torques = np.empty((stretch.stop - stretch.start, len(body.dofs)), dtype=np.float32)
            for k, (angles, rates, following) in enumerate(
                zip(targets.angles, targets.rates, targets.rates[1:], strict=False)
            ):
                accelerations = (following - rates) / self.step_s
                torques[k] = body.floating_torques(angles, rates, accelerations)
            found.append(torques)
        return found


def _stretches(chain: Chain, curve: WindowCurve, u: Array) -> Iterator[Stretch]:
    """The stretches of steps from each of (S + 1,) places to the next."""
    steps = len(u) - 1
    k = chain.module.hinges_per_joint
    most = len(chain.folded_rad) // k
    piece = curve.piece(u)
    low = sliding_window_view(curve.first, REACH).min(axis=1)[piece] // k
    high = -(-sliding_window_view(curve.last, REACH).max(axis=1)[piece] // k)
    start = 0
    while start < steps:
        # The step before a stretch and the one behind it belong to its finite differences.
        begin = max(0, start - 1)
        lows = np.minimum.accumulate(low[begin:])
        highs = np.maximum.accumulate(high[begin:])
        soon = min(start + FEWEST_TOGETHER, steps) - begin
        needed = int(highs[soon] - lows[soon]) + SPARE_JOINTS
        joints = min(most, JOINTS_AT_ONCE * -(-needed // JOINTS_AT_ONCE))
        fits = highs - lows <= joints
        last = begin + (len(fits) if fits.all() else int(fits.argmin())) - 1
        stop = steps if last == steps else max(start + 1, last - 1)
        within = slice(begin, min(stop + 1, steps) + 1)
        first = min(int(low[within].min()), most - joints)
        yield Stretch(first=first, joints=joints, start=start, stop=stop)
        start = stop
